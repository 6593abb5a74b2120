# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of a run, how long after a sample its command is out among them: summary.json, and the same as a table."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from itertools import zip_longest
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from atpid_common.files import Document
from atpid_common.output import finite
from atpid_common.vocabulary import EventKind, Severity
from atpid_control.runs.run import Run
from atpid_control.views.report.latency import laser_blocks, latency_of, received_of, summary_line
from atpid_control.views.report.stages import Printed, Stage, per_cent
from atpid_control.views.report.view import View, not_arrived
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import modes_in, worse_than_without

_COLUMNS = "time\n[s];excited\n[{}];iden-\ntified;f\n[Hz];height\n[m];beam\n[m];closed\n[m];effi-\nciency;reduc-\ntion"


def summary_of(view: View, scene: Scene, mode: str) -> Document:
    """Return summary.json's object: the results, and what they depend on. NaN: unknown."""
    run = view.run
    own, closed = view.decrements or (math.nan, math.nan)
    return {
        "stages": [asdict(stage) for stage in view.stages],
        "drive": run.drive._asdict(),
        "modes": [mode._asdict() for mode in modes_in(scene)],
        "decrement": own,
        "undamped_decrement": closed,
        "real_time_factor": real_time_factor(run, mode),
        "origin": run.motion.origin,
        "bag": str(run.path),
        "mode": mode,
        "run_id": run.about.get("run_id", ""),
        "seed": scene.seed,
        "lost_scans": lost_scans(run),
        "missing": run.missing,
        "unanswered_blocks": unanswered_blocks(run),
        "latency": latency_of(run) if mode != "lockstep" else None,
        "events": dict(sorted(Counter(kind for kind, _ in _notable(run)).items())),
        "defaults": scene.defaults(),
        "warnings": scene.warnings(),
    }


def write_summary(summary: Document, path: Path) -> None:
    """Write it; NaN, which JSON does not have, as null."""
    path.write_text(json.dumps(finite(summary), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def lost_scans(run: Run) -> int:
    """Return how many scans are missing between the blocks of all sensors, by their indices, where these go on."""
    return sum(table.lost for table, _ in run.streams())


def real_time_factor(run: Run, mode: str) -> float:
    """Return simulated over wall time [-]: by the recorder or, in real time, between its first and last block."""
    if mode == "lockstep":
        return float(run.result.get("real_time_factor", "nan"))
    blocks = laser_blocks(run)
    if len(blocks) < 2:
        return math.nan
    (first, _, wall_first), (last, _, wall_last) = blocks[0], blocks[-1]
    return (last - first) / max(1, wall_last - wall_first)


def unanswered_blocks(run: Run) -> int:
    """Return how many blocks of the laser have no estimate, or whose estimate has no command.

    A device goes on after the plant has finished: blocks after that are not answered.
    """
    events = run.messages("Event")
    finished = events["received"][events["kind"] == EventKind.FINISHED] if events else []
    end = run.start_ns + round(1e9 * min(finished)) if len(finished) else 2**63
    blocks = sum(1 for _, _, received in laser_blocks(run) if received <= end)
    answers = (len({stamp for stamp, _ in received_of(run, kind)}) for kind in ("Excitation", "CeilingCommand"))
    return max(0, blocks - min(answers))


def _notable(run: Run) -> list[tuple[str, str]]:
    """Return (kind, text) of all warnings and alarms in order."""
    return [(event.kind, event.text) for event in run.all_events if event.severity > Severity.INFO]


def show(summary: Document, view: View, scene: Scene, console: Console) -> None:
    """Print the table of stages and the facts below it."""

    def line(text: str, style: str | None = None) -> None:
        console.print(text, style=style, soft_wrap=True, markup=False, highlight=False)

    if view.stages:
        console.print(stage_table(view.stages, view.printed, view.run.drive.unit))
    for text in [*(f"not reached: {text}" for text in not_arrived(view)), *_made_worse(view.stages)]:
        line(text)
    line(
        f"{summary['mode']}: {summary['real_time_factor']:.1f} x real time; lost scans: {summary['lost_scans']}; "
        f"unanswered blocks: {summary['unanswered_blocks']}; seed {summary['seed']}"
    )
    if summary["latency"]:
        console.print(summary_line(summary["latency"]), soft_wrap=True)
    for text in summary["missing"]:
        line(f"missing: {text}")
    if summary["lost_scans"] or summary["unanswered_blocks"] or summary["missing"]:
        line("INCOMPLETE: samples or answers are missing; the figures above are not to be relied on", "bold")
    for kind, text in _notable(view.run):
        line(f"{kind}: {text}")
    used = "; ".join(scene.decisive_defaults(measured=True))
    if used:
        line(f"defaults: {used}", "dim")


def _made_worse(stages: Sequence[Stage]) -> list[str]:
    """Return a line for each stage in which the damper makes it worse."""
    found = ((stage, text) for stage in stages for text in worse_than_without(stage.reduction))
    return [f"{stage.t0:g} to {stage.t1:g} s: {text}" for stage, text in found]


def stage_table(stages: Sequence[Stage], printed: Sequence[Printed] | None, unit: str) -> Table:
    """Return the table, excitations in `unit`, with what the thesis prints beside where it is the thesis's scene."""
    title = "at the end of each stage; amplitudes are half peak-to-peak"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in _COLUMNS.format(unit).split(";"):
        table.add_column(Text(name), justify="right", no_wrap=True)
    for name in ("thesis:\nheight", "\nbeam", "\nclosed", "\neff.") if printed else ():
        table.add_column(Text(name), justify="right", no_wrap=True, style="dim", header_style="dim")
    for stage, other in zip_longest(stages, printed or ()):
        cells = _row(stage)
        if other:
            height = f"{other.height_sign}{other.height:g}"
            cells += [height, f"{other.amplitude:g}", f"{other.closed:g}", f"{100 * other.efficiency:.0f} %"]
        table.add_row(*cells)
    return table


def _row(stage: Stage) -> list[str]:
    shares = [per_cent(stage.efficiency_range), per_cent(stage.reduction_range)]
    if stage.amplitude_spread is None:
        known = (stage.efficiency, stage.reduction)
        shares = [f"{round(100 * share, 1) + 0.0:.1f} %" if math.isfinite(share) else "nan" for share in known]
    shown = (
        f"{stage.excitation_amplitude:.5f}",
        f"{stage.identified_amplitude:.5f}",
        f"{stage.identified_frequency:.3f}",
        f"{stage.height:.4f}{'' if stage.arrived else '*'}",
        f"{stage.amplitude:.4f}",
        f"{stage.undamped_amplitude:.3f}",
        *shares,
    )
    return [f"{stage.t0:g} to {stage.t1:g}", *("" if "nan" in text else text for text in shown)]
