# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes the report of a bag: pictures, and a page, light or dark by the reader's setting, of data/report.html."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_common.vocabulary import Drive
from atpid_control.analysis.analyse import Analysis, analyse
from atpid_control.analysis.rows import rows, shown_unit
from atpid_control.analysis.signals import AnalysisError, signals_of
from atpid_control.runs.run import Run
from atpid_control.views.report import charts, panels
from atpid_control.views.report.latency import latency_of
from atpid_control.views.report.picture import save_pictures
from atpid_control.views.report.stages import Printed, Stage, measured_decrement, per_cent
from atpid_control.views.report.view import View, headline, not_arrived, origin_of, view_of
from atpid_control.views.static_page import document, filled, scripts
from atpid_sim.scene import Scene
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.quantities import modes_in

_COLUMNS = (
    "stage; {} amplitude; identified; error; frequency; ceiling height; beam, closed; beam; "
    "efficiency; without damper; reduction"
)


def page(view: View) -> str:
    """Return the whole page as HTML."""
    analysis = analysis_of(view.run)
    drawn = {"overview": panels.overview(view), "grain": panels.grain(view)}
    shown = {name: charts.draw(chart) for name, chart in drawn.items() if chart is not None}
    if analysis is not None:
        modes = modes_in(view.run.scene) if view.run.scene is not None else []
        shown["spectra"] = charts.spectra(analysis, [mode.frequency for mode in modes])
    body = filled("report.html", __package__, _contents(view, analysis))
    return document(headline(view), [body, scripts(shown)])


def _contents(view: View, analysis: Analysis | None) -> Document:
    """Return the names the template uses, `view` itself among them."""
    run = view.run
    printed: Sequence[Printed | None] = view.printed or [None] * len(view.stages)
    return {
        "view": view,
        "headline": headline(view),
        "origin": origin_of(view),
        "tiles": list(_tiles(view)),
        "columns": _COLUMNS.format(run.drive.name).split("; "),
        "stages": [_cells(run.drive, *row) for row in zip(view.stages, printed, strict=True)],
        "not_arrived": not_arrived(view),
        "modes": _modes(run.scene),
        "energy": _energy(run),
        "latency": latency_of(run) if run.about.get("clock") == "real time" else None,
        "analysis": list(rows(analysis)) if analysis else [],
        "doubts": [*analysis.doubts, *run.faults(-math.inf, math.inf)] if analysis else [],
        "about": _about(view),
    }


def analysis_of(run: Run) -> Analysis | None:
    """Return the analysis of what the sensor measured; None where nothing moves, or the run is too short."""
    try:
        return analyse(signals_of(run, both=False)[0])
    except AnalysisError:
        return None


def _tiles(view: View) -> Iterator[Document]:
    """Yield the main results: one a stage, or the decrements of a free decay."""
    scene = view.run.scene
    if view.always_closed:
        return
    if view.decrements is None:
        for stage in view.stages:
            if math.isfinite(stage.efficiency):
                scale, unit = shown_unit(view.run.drive.unit)
                what = f"reduction, {view.run.drive.name} ±{scale * stage.excitation_amplitude:.4g} {unit}"
                below = (
                    f"without the damper ±{1e3 * stage.bare_amplitude:.3g} mm → {_beam_amplitude(stage)}; "
                    f"closed ±{1e3 * stage.undamped_amplitude:.3g} mm, efficiency {per_cent(stage.efficiency_range)}"
                )
                yield _tile(per_cent(stage.reduction_range), what, below)
    elif scene is not None:
        own, closed = view.decrements
        free, still = measured_decrement(scene, scene.ceiling.heights[0][1]), measured_decrement(scene, 0.0)
        ratio = "largest ratio of successive peaks"
        yield _tile(f"{own:.2f}", "with the grain free", ratio, free)
        yield _tile(f"{closed:.2f}", "with the damper closed", ratio, still, reference=True)


def _beam_amplitude(stage: Stage) -> str:
    if stage.amplitude_spread is None:
        return f"±{1e3 * stage.amplitude:.3g} mm"
    least, largest = (1e3 * value for value in stage.amplitude_spread)
    return f"±{least:.3g} to {largest:.3g} mm: irregular; this run: ±{1e3 * stage.amplitude:.3g} mm"


def _tile(value: str, what: str, below: str, measured: float | None = None, *, reference: bool = False) -> Document:
    said = f"{measured:.4g}" if measured else ""
    return {"value": value, "what": what, "below": below, "reference": reference, "measured": said}


#: Form and unit of a mode's figures.
_OF_MODE = ((".5g", "Hz"), (".5g", "Hz"), (".4g", "kg"), (".3g", "%"), (".4g", ""))


def _modes(scene: Scene | None) -> list[list[str]]:
    """Return the rows of the table of modes; none where there is one."""
    found = modes_in(scene) if scene is not None else []
    figures = [
        (mode.frequency, mode.held_frequency, mode.mass, 100.0 * mode.damping_ratio, mode.drive_factor)
        for mode in (found if len(found) > 1 else ())
    ]
    return [[number(value, *form).strip() for value, form in zip(row, _OF_MODE, strict=True)] for row in figures]


def _energy(run: Run) -> Document | None:
    """Return where the energy of the run went; None of hardware."""
    ledger = run.ledger
    if ledger is None:
        return None
    parts = [
        ("contacts of the grain", ledger.contact_loss, "own"),
        ("the beam's own damping", ledger.beam_loss, "given"),
        ("still in motion", max(0.0, ledger.stored), "accent"),
    ]
    total = sum(value for _, value, _ in parts) or 1.0
    left = abs(ledger.residual)
    mantissa, power = f"{left:.0e}".split("e")
    exponent = str(int(power)).replace("-", "−") if left else ""
    shown = [(name, value, value / total, colour) for name, value, colour in parts if value > 0.0]
    return {"supplied": _supplied(ledger, run.drive), "mantissa": mantissa, "exponent": exponent, "parts": shown}


def _supplied(ledger: Ledger, drive: Drive) -> str:
    supplied = [f"The {drive.name} supplied {ledger.input:.4g} J"] if ledger.input else []
    if ledger.ceiling_work:
        verb = "supplied" if ledger.ceiling_work > 0.0 else "took up"
        supplied.append(f"the ceiling's motor {verb} {abs(ledger.ceiling_work):.3g} J")
    if ledger.stored < 0.0:
        supplied.append(f"{-ledger.stored:.4g} J were stored at the start")
    return ", ".join(supplied)


def _about(view: View) -> dict[str, str]:
    """Return where the run comes from, and what was lost."""
    run, about, result, scene = view.run, view.run.about, view.run.result, view.run.scene
    clock, factor = about.get("clock", "–"), result.get("real_time_factor")
    if factor and clock == "lockstep":
        clock = f"{clock}, {float(factor):.1f} times as fast as real time"
    return {
        "scene": run.scene_problem or about.get("scene", "–"),
        "seed": str(scene.seed) if scene else "–",
        "run": about.get("run_id", "–"),
        "commit": about.get("commit", "–"),
        "clock": clock,
        "lost": f"{run.lost} scans of {len(run.measured.time)}, in {run.blocks} blocks",
        "answers": f"{len(run.estimates.time)} estimates, {len(run.commands.time)} commands",
        "recording": {"yes": "whole", "": "states no end"}.get(result.get("finished", ""), "ended before the run did"),
    }


def _cells(drive: Drive, stage: Stage, printed: Printed | None) -> list[dict[str, str]]:
    """Return a stage's cells, with what the thesis prints and the best that is known beneath."""
    scale, unit = shown_unit(drive.unit)
    error = 100.0 * (stage.identified_amplitude / stage.excitation_amplitude - 1.0)
    thesis: dict[str, str] = {}
    best: dict[str, str] = {}
    if printed is not None:
        thesis["height"] = f"{printed.height_sign}{1e3 * printed.height:.0f} mm"
        thesis["closed"] = f"{1e3 * printed.closed:.0f} mm"
        thesis["beam"] = f"{1e3 * printed.amplitude:.0f} mm"
        thesis["efficiency"] = f"{100.0 * printed.efficiency:.0f} %"
        best["height"] = f"{1e3 * printed.best_height:.0f} mm"
        best["efficiency"] = f"{100.0 * printed.best_efficiency:.0f} %"
    efficiency, reduction = per_cent(stage.efficiency_range), per_cent(stage.reduction_range)
    if stage.amplitude_spread is None:
        efficiency, reduction = (number(100.0 * share, ".1f", "%") for share in (stage.efficiency, stage.reduction))
    cells = [
        (f"{stage.t0:.4g} to {stage.t1:.4g} s", ""),
        (number(scale * stage.excitation_amplitude, ".4g", unit), ""),
        (number(scale * stage.identified_amplitude, ".3f", unit), ""),
        (number(error, "+.3f", "%"), ""),
        (number(stage.identified_frequency, ".3f", "Hz"), ""),
        (number(1e3 * stage.height, ".4g", "mm") + ("" if stage.arrived else " *"), "height"),
        (number(1e3 * stage.undamped_amplitude, ".4g", "mm"), "closed"),
        (number(1e3 * stage.amplitude, ".4g", "mm"), "beam"),
        (efficiency, "efficiency"),
        (number(1e3 * stage.bare_amplitude, ".4g", "mm"), ""),
        (reduction, ""),
    ]
    return [{"text": text, "thesis": thesis.get(name, ""), "best": best.get(name, "")} for text, name in cells]


def number(value: float, form: str, unit: str) -> str:
    """Return a value in the page's form: a true minus sign, no sign on zero, a dash for NaN."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:{form}}"
    if float(text) == 0.0:  # rounded to zero, it has no sign
        text = text.lstrip("+-")
    return f"{text} {unit}".replace("-", "−")


PAGE = "report.html"
#: Marks a folder of the bench (stand/outdir.py).
_RUN = "bench.json"
_FILES = {PAGE, *(f"{name}{scheme}.png" for name in ("overview", "grain") for scheme in ("", "-dark"))}


class ReportError(InputError):
    """A report that cannot be written."""


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


def report(bag: Path, out: Path) -> Path:
    """Write report.html and the pictures of a recorded run into `out`; return the page. Raises BagError too."""
    return write_report(view_of(bag), out)


def write_report(view: View, out: Path) -> Path:
    """Write page and pictures of a run that has been read; return the page. Raises ReportError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        save_pictures(view, out)
        (out / PAGE).write_text(page(view), encoding="utf-8")
    except OSError as error:
        raise ReportError(f"{out}: cannot write the report ({error.strerror}); choose another folder") from None
    return out / PAGE
