# SPDX-License-Identifier: Apache-2.0
"""Results of a run, how long after a sample its command is out among them: summary.json, and the same as a table."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from atpid_control.bags.read import Bag, stamp_of
from atpid_control.report.latency import laser_blocks, latency_of, summary_line
from atpid_control.report.stages import Printed, Stage, beside
from atpid_control.report.view import View, not_arrived
from atpid_sim.scene import Scene

_COLUMNS = (
    "time\n[s]", "excited\n[m]", "identified\n[m]", "f\n[Hz]", "height\n[m]", "beam\n[m]", "closed\n[m]",
    "effi-\nciency",
)  # fmt: skip


def summary_of(view: View, scene: Scene, mode: str) -> dict[str, Any]:
    """Return summary.json's object: the results, and what they depend on. NaN: unknown."""
    bag = view.run.bag
    own, closed = view.decrements or (math.nan, math.nan)
    return {
        "stages": [stage.as_dict() for stage in view.stages],
        "decrement": own,
        "undamped_decrement": closed,
        "real_time_factor": real_time_factor(bag, mode),
        "bag": str(bag.path),
        "mode": mode,
        "run_id": bag.run.get("run_id", ""),
        "seed": scene.seed,
        "lost_scans": lost_scans(bag),
        "unanswered_blocks": unanswered_blocks(bag),
        "latency": latency_of(bag) if mode != "lockstep" else None,
        "events": dict(sorted(Counter(kind for kind, _ in notable(bag)).items())),
        "defaults": scene.defaults(),
        "warnings": scene.warnings(),
    }


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write it; NaN, which JSON does not have, as null."""
    path.write_text(json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def lost_scans(bag: Bag) -> int:
    """Return how many scans are missing between and inside the blocks of all sensors, by their indices."""
    lost = 0
    for topic in bag.topics_of("SampleBlock"):
        expected: int | None = None
        for _, block in bag.messages(topic):
            scans = len(block.data) // max(1, len(block.channels))
            lost += max(0, int(block.first_index) - (int(block.first_index) if expected is None else expected))
            expected = int(block.first_index) + scans
    return lost


def real_time_factor(bag: Bag, mode: str) -> float:
    """Return simulated over wall time [-]: by the recorder or, in real time, between its first and last block."""
    if mode == "lockstep":
        return float(bag.result.get("real_time_factor", "nan"))
    laser = next((topic for topic in bag.topics_of("SampleBlock") if topic.endswith("laser")), "")
    received = [(log_ns, stamp_of(block)) for log_ns, block in bag.messages(laser)]
    if len(received) < 2:
        return math.nan
    (wall_first, first), (wall_last, last) = received[0], received[-1]
    return (last - first) / max(1, wall_last - wall_first)


def unanswered_blocks(bag: Bag) -> int:
    """Return how many blocks of the laser have no estimate, or whose estimate has no command.

    A device goes on after the plant has finished: blocks after that are not answered.
    """
    finished = (received for received, event in bag.of_kind("Event") if event.kind == "finished")
    end = min(finished, default=2**63)
    blocks = sum(1 for received, _ in laser_blocks(bag) if received <= end)
    answers = (len({stamp_of(m) for _, m in bag.of_kind(kind)}) for kind in ("Excitation", "CeilingCommand"))
    return max(0, blocks - min(answers))


def notable(bag: Bag) -> list[tuple[str, str]]:
    """Return (kind, text) of all warnings and alarms in order."""
    return [(str(event.kind), str(event.text)) for _, event in bag.of_kind("Event") if event.severity > 0]


def show(summary: Mapping[str, Any], view: View, scene: Scene, console: Console) -> None:
    """Print the table of stages and the facts below it."""

    def line(text: str, style: str | None = None) -> None:
        console.print(text, style=style, soft_wrap=True, markup=False, highlight=False)

    if view.stages:
        console.print(stage_table(view.stages, beside(view.run, view.stages)))
    for text in not_arrived(view):
        line(f"not reached: {text}")
    line(
        f"{summary['mode']}: {summary['real_time_factor']:.1f} x real time; lost scans: {summary['lost_scans']}; "
        f"unanswered blocks: {summary['unanswered_blocks']}; seed {summary['seed']}"
    )
    if summary["latency"]:
        console.print(summary_line(summary["latency"]), soft_wrap=True)
    if summary["lost_scans"] or summary["unanswered_blocks"]:
        line("INCOMPLETE: samples or answers are missing; the figures above are not to be relied on", "bold")
    for kind, text in notable(view.run.bag):
        line(f"{kind}: {text}")
    used = "; ".join(scene.decisive_defaults(measured=True))
    if used:
        line(f"defaults: {used}", "dim")


def stage_table(stages: Sequence[Stage], printed: Sequence[Printed] | None) -> Table:
    """Return the table, with what the thesis prints beside where it is the thesis's scene."""
    title = "at the end of each stage; amplitudes are half peak-to-peak"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in _COLUMNS:
        table.add_column(Text(name), justify="right", no_wrap=True)
    for name in ("thesis:\nheight", "\nbeam", "\nclosed", "\neff.") if printed else ():
        table.add_column(Text(name), justify="right", no_wrap=True, style="dim", header_style="dim")
    for stage, other in zip_longest(stages, printed or ()):
        table.add_row(*_row(stage), *(_printed(other) if other else ()))
    return table


def _row(stage: Stage) -> list[str]:
    efficiency = f"{round(100 * stage.efficiency, 1) + 0.0:.1f} %" if math.isfinite(stage.efficiency) else "nan"
    if stage.amplitude_spread is not None:
        efficiency = stage.efficiency_text()
    shown = (
        f"{stage.excitation_amplitude:.5f}",
        f"{stage.identified_amplitude:.5f}",
        f"{stage.identified_frequency:.3f}",
        f"{stage.height:.4f}{'' if stage.arrived else '*'}",
        f"{stage.amplitude:.4f}",
        f"{stage.undamped_amplitude:.3f}",
        efficiency,
    )
    return [f"{stage.t0:g} to {stage.t1:g}", *("" if "nan" in text else text for text in shown)]


def _printed(stage: Printed) -> list[str]:
    height = f"{stage.height_sign}{stage.height:g}"
    return [height, f"{stage.amplitude:g}", f"{stage.closed:g}", f"{100 * stage.efficiency:.0f} %"]
