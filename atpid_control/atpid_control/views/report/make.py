# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes the report of a bag: its page and its pictures."""

from dataclasses import dataclass
from pathlib import Path

from atpid_common.errors import InputError
from atpid_control.views.report.comparison import Closed
from atpid_control.views.report.page import page
from atpid_control.views.report.picture import save_pictures
from atpid_control.views.report.stages import Stage
from atpid_control.views.report.view import View, headline, view_of

PAGE = "report.html"
#: Marks a folder of the bench (stand/outdir.py).
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
    return Report(out / PAGE, pictures, view.stages, headline(view), view.run.missing)
