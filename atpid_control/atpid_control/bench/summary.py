# SPDX-License-Identifier: Apache-2.0
"""What a run amounts to: summary.json, and the same as a table for a person."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from atpid_sim.scene import HarmonicExcitation, Scene
from rich.console import Console
from rich.table import Table

from atpid_control.bagread import Bag

#: Thesis section 4.3: points of the excitation [s, m], and for each stage height, beam amplitude, closed amplitude [m].
THESIS_EXCITATION = (
    (0.0, 0.0), (0.5, 0.015), (6.0, 0.015), (8.0, 0.04), (13.0, 0.04), (14.0, 0.03), (20.0, 0.03),
)  # fmt: skip
THESIS_STAGES = (("0.3", 0.07, 0.3), ("> 0.7", 0.17, 0.85), ("0.57", 0.13, 0.65))

Stage = Mapping[str, Any]


def summary_of(bag: Bag, stages: Sequence[Stage], scene: Scene, mode: str) -> dict[str, Any]:
    """Return summary.json's object: DESIGN's keys, and what makes the numbers trustworthy."""
    return {
        "stages": [dict(stage) for stage in stages],
        "real_time_factor": real_time_factor(bag, mode),
        "bag": str(bag.path),
        "mode": mode,
        "run_id": bag.run.get("run_id", ""),
        "seed": scene.seed,
        "lost_scans": lost_scans(bag),
        "unanswered_blocks": unanswered_blocks(bag),
        "events": dict(sorted(Counter(kind for kind, _ in notable(bag)).items())),
        "defaults": scene.defaults(),
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
    """Return simulated over wall time [-]: as the recorder measured it or, in real time, between its first and last block."""
    if mode == "lockstep":
        return float(bag.result.get("real_time_factor", "nan"))
    laser = next((topic for topic in bag.topics_of("SampleBlock") if topic.endswith("laser")), "")
    received = [(log_ns, _nanoseconds(block)) for log_ns, block in bag.messages(laser)]
    if len(received) < 2:
        return math.nan
    (wall_first, first), (wall_last, last) = received[0], received[-1]
    return (last - first) / max(1, wall_last - wall_first)


def unanswered_blocks(bag: Bag) -> int:
    """Return how many blocks of the laser have no estimate, or whose estimate has no command."""
    blocks = sum(1 for topic in bag.topics_of("SampleBlock") if topic.endswith("laser") for _ in bag.messages(topic))
    answers = [
        len({_nanoseconds(message) for topic in bag.topics_of(kind) for _, message in bag.messages(topic)})
        for kind in ("Excitation", "CeilingCommand")
    ]
    return blocks - min(answers)


def _nanoseconds(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def notable(bag: Bag) -> list[tuple[str, str]]:
    """Return (kind, text) of all warnings and alarms in the order they were said."""
    found = (event for topic in bag.topics_of("Event") for _, event in bag.messages(topic))
    return [(str(event.kind), str(event.text)) for event in found if event.severity > 0]


def show(summary: Mapping[str, Any], bag: Bag, scene: Scene, console: Console) -> None:
    """Print the table of stages and the facts below it."""
    console.print(stage_table(summary["stages"], is_thesis_scene(scene)))
    console.print(
        f"{summary['mode']}: {summary['real_time_factor']:.1f} x real time; lost scans: {summary['lost_scans']}; "
        f"unanswered blocks: {summary['unanswered_blocks']}; seed {summary['seed']}"
    )
    if summary["lost_scans"] or summary["unanswered_blocks"]:
        console.print("INCOMPLETE: samples or answers are missing; the figures above are not to be relied on", style="bold")
    for kind, text in notable(bag):
        console.print(f"{kind}: {text}", soft_wrap=True, markup=False)
    for line in summary["defaults"]:
        console.print(f"default {line}", style="dim", soft_wrap=True, markup=False, highlight=False)


def is_thesis_scene(scene: Scene) -> bool:
    """Whether the excitation is that of thesis section 4.3, with its grain."""
    excitation = scene.excitation
    same = isinstance(excitation, HarmonicExcitation) and excitation.amplitude == THESIS_EXCITATION
    return same and math.isclose(scene.grain.mass_fraction, 0.1)


def stage_table(stages: Sequence[Stage], beside_thesis: bool) -> Table:
    """Return the table, with the thesis's figures beside where it is the thesis's scene."""
    table = Table(title="stages (amplitudes: half peak-to-peak, last 2 s of each)", title_justify="left")
    for name in ("time [s]", "excitation [m]", "identified [m]", "f [Hz]", "height [m]", "beam [m]", "closed [m]", "left"):
        table.add_column(name, justify="right", no_wrap=True)
    if beside_thesis:
        for name in ("thesis: height", "beam", "closed", "left"):
            table.add_column(name, justify="right", no_wrap=True, style="dim")
    for number, stage in enumerate(stages):
        row = _row(stage)
        if beside_thesis and number < len(THESIS_STAGES):
            height, beam, closed = THESIS_STAGES[number]
            row += [height, f"{beam:g}", f"{closed:g}", f"{100 * beam / closed:.0f} %"]
        table.add_row(*row)
    return table


def _row(stage: Stage) -> list[str]:
    digits = {
        "excitation_amplitude": 5, "identified_amplitude": 5, "identified_frequency": 3,
        "height": 4, "amplitude": 4, "undamped_amplitude": 3,
    }  # fmt: skip
    values = [_number(stage[key], count) for key, count in digits.items()]
    left = stage["amplitude"] / stage["undamped_amplitude"]
    return [f"{stage['t0']:g} to {stage['t1']:g}", *values, f"{100 * left:.1f} %" if math.isfinite(left) else ""]


def _number(value: float | None, digits: int) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"
