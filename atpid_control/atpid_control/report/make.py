# SPDX-License-Identifier: Apache-2.0
"""Makes the report of a bag: a self-contained page, light or dark by the reader's setting, and its pictures."""

import json
from dataclasses import asdict, dataclass
from html import escape
from importlib.resources import files
from pathlib import Path

from plotly.offline import get_plotlyjs

from atpid_common.errors import InputError
from atpid_control.report import charts, sections
from atpid_control.report.analysis import analysis_of, section
from atpid_control.report.comparison import Closed
from atpid_control.report.picture import DARK, LIGHT, Palette, save_pictures
from atpid_control.report.sections import table
from atpid_control.report.stages import Stage
from atpid_control.report.view import View, headline, view_of


def page(view: View) -> str:
    """Return the whole page as HTML."""
    title = escape(headline(view))
    found = analysis_of(view)
    figures = {"overview": charts.overview(view), "grain": charts.grain(view)}
    figures["spectra"] = charts.spectra(found) if found is not None else None
    shown = {name: figure for name, figure in figures.items() if figure is not None}
    colours = f":root{{{_colours(LIGHT)}}}@media (prefers-color-scheme: dark){{:root{{{_colours(DARK)}}}}}\n"
    # a closing tag inside the text would end the script element
    data = json.dumps(shown, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    first = (
        sections.header,
        sections.tiles,
        sections.overview,
        table,
        sections.grain,
        sections.energy,
        sections.latency,
    )
    parts = [*(make(view) for make in first), section(found), sections.events(view.run.events), sections.facts(view)]
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<style>{colours}{_data('page.css')}</style></head><body><main>",
            *(part for part in parts if part),
            "<footer>Made by <code>python -m atpid_control report</code> from the bag alone. Drag in a chart to zoom, "
            "double-click to go back.</footer></main>",
            f'<script type="application/json" id="figures">{data}</script>',
            f"<script>{get_plotlyjs()}</script>",
            f"<script>{_data('page.js')}</script>",
            "</body></html>\n",
        ]
    )


def _data(name: str) -> str:
    return files("atpid_control.report").joinpath("data", name).read_text(encoding="utf-8")


def _colours(palette: Palette) -> str:
    return "".join(f"--{name}:{value};" for name, value in asdict(palette).items())


PAGE = "report.html"
#: Marks a folder of the bench (bench/outdir.py).
_RUN = "bench.json"
_FILES = {PAGE, *(f"{name}{scheme}.png" for name in ("overview", "grain") for scheme in ("", "-dark"))}


class ReportError(InputError):
    """A report that cannot be written."""


@dataclass(frozen=True)
class Report:
    """What was made."""

    page: Path
    pictures: list[Path]
    stages: list[Stage]
    headline: str
    missing: list[str]  # what is not in the bag and should be


def check_folder(out: Path) -> None:
    """Raise ReportError where `out` holds anything but an earlier report or a run of the bench."""
    if not out.is_dir() or (out / _RUN).is_file():
        return
    foreign = sorted(item.name for item in out.iterdir() if item.name not in _FILES)
    if foreign:
        raise ReportError(
            f"--out: given {out}, which holds files that are not a report's ({', '.join(foreign[:3])}); "
            "give an empty or a new folder"
        )


def report(bag: Path, out: Path, closed: Closed | None = None) -> Report:
    """Write `out`/report.html and the pictures of a recorded run; return what was made.

    `closed` gives the closed damper's beam for a scene at given times; default: it is simulated.
    Raises BagError where the bag cannot be read, ReportError where `out` cannot be written.
    """
    return write_report(view_of(bag, closed), out)


def write_report(view: View, out: Path) -> Report:
    """Write page and pictures of a run that has been read; see `report`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        pictures = save_pictures(view, out)
        (out / PAGE).write_text(page(view), encoding="utf-8")
    except OSError as error:
        raise ReportError(f"{out}: cannot write the report ({error.strerror}); choose another folder") from None
    return Report(out / PAGE, pictures, view.stages, headline(view), view.run.bag.missing)
