# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two bags beside each other: what is the same, a known difference, a common time axis, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
from recorded import SHORT, block, make, record

from atpid_control.cli import main
from atpid_control.commands.compare_bags import _cells
from atpid_control.runs.metadata import new_run
from atpid_control.runs.writer import BagWriter
from atpid_control.views.comparison.compare import _STAGE, BagComparisonError, Row, compare_bags
from atpid_control.views.report.stages import Stage

BAGS = Path(__file__).parents[2] / "bags"
RATE = 1000.0
START = 1_000_000_000


def written(folder: Path, amplitude: float, delay: float = 0.0, lost: int = 0, start_ns: int = START) -> Path:
    """Write 4 s of two tones at 5 Hz whose event `moved` is at 1 s, all of it `delay` [s] later."""
    writer = BagWriter(folder, new_run(run_id="two", commit="none"))
    for topic, kind in {"/sensors/laser": "SampleBlock", "/events": "Event"}.items():
        writer.add_topic(topic, f"atpid_interfaces/msg/{kind}")
    time = np.arange(4000) / RATE - delay
    data = np.column_stack([0.01 * np.sin(10.0 * np.pi * time), amplitude * np.sin(10.0 * np.pi * time - 1.0)])
    for first in range(0, 4000, 50):
        if not 2000 <= first < 2000 + lost:
            at = start_ns + round(first / RATE * 1e9)
            writer.write("/sensors/laser", block(first, data[first : first + 50], RATE, start_ns), at, at)
    at = start_ns + round((1.0 + delay) * 1e9)
    writer.write("/events", make("Event", at, "motor_node", kind="moved", text="moved"), at, at)
    writer.close({"finished": "yes"})
    return folder


def value(found: object, name: str) -> tuple[float, float, float]:
    row = next(row for row in found.rows if row.name == name)  # type: ignore[attr-defined]
    return row.first, row.second, row.difference


def test_a_known_difference(tmp_path: Path) -> None:
    found = compare_bags(written(tmp_path / "a", 0.1), written(tmp_path / "b", 0.12, lost=100))
    assert value(found, "order 1 of the beam, last part") == pytest.approx((0.1, 0.12, 0.02), rel=1e-5)
    assert value(found, "beam, second less first, root mean square")[1] == pytest.approx(0.02 / np.sqrt(2.0), rel=1e-2)
    assert value(found, "samples lost") == (0.0, 100.0, 100.0)
    gap = (found.time > 2.0) & (found.time < 2.099)
    assert np.isnan(found.difference[gap]).all()
    assert np.isfinite(found.difference[~((found.time > 1.99) & (found.time < 2.11))]).all()
    assert any("100 samples lost" in line for line in found.doubts)


def test_runs_are_aligned_by_an_event_or_by_the_clock(tmp_path: Path) -> None:
    first = written(tmp_path / "a", 0.1)
    late = written(tmp_path / "b", 0.1, delay=0.25)
    elsewhere = written(tmp_path / "c", 0.1, delay=0.25, start_ns=START - 250_000_000)
    assert value(compare_bags(first, late), "beam, second less first, root mean square")[1] > 0.05
    for other, align in ((late, "moved"), (elsewhere, "clock")):
        found = compare_bags(first, other, align)
        assert found.runs[1].shift == pytest.approx(-0.25)
        assert value(found, "beam, second less first, root mean square")[1] < 1e-12
        assert (found.time[0], found.time[-1]) == pytest.approx((0.0, 3.749), abs=2e-3)


def test_no_common_time_and_no_such_event(tmp_path: Path) -> None:
    first = written(tmp_path / "a", 0.1)
    later = written(tmp_path / "b", 0.1, start_ns=START + 60_000_000_000)
    with pytest.raises(BagComparisonError, match="no common time"):
        compare_bags(first, later, "clock")
    with pytest.raises(BagComparisonError, match=r"no event 'rumble'; in this bag: moved; or start, clock"):
        compare_bags(first, later, "rumble")


def test_a_run_is_named_by_its_scene_and_time_and_by_its_folder_where_that_is_the_same(tmp_path: Path) -> None:
    same = compare_bags(written(tmp_path / "a", 0.1), written(tmp_path / "b", 0.1))
    assert [placed.label for placed in same.runs] == [str(tmp_path / "a"), str(tmp_path / "b")]
    own, other = (compare_bags(BAGS / "thesis_4_3_short", BAGS / name) for name in ("rumble", "laser_stuck"))
    assert own.runs[0].label == other.runs[0].label == "thesis_4_3_short.yaml · 2026-11-21 19:18"
    assert len({placed.label for placed in (*own.runs, *other.runs)}) == 3


def test_what_an_irregular_stage_scatters_by_stands_beside_its_values() -> None:
    stage = Stage(0.0, 4.0, 0.01, 0.01, 5.47, 0.3, 0.05, 0.2, 0.75, 0.1, 0.5, amplitude_spread=(0.04, 0.06))
    spreads = {name: found(stage) for name, _, found in _STAGE}
    assert spreads["beam amplitude"] == pytest.approx((0.05, 0.01))
    assert spreads["efficiency"] == pytest.approx((0.75, 0.05))
    assert spreads["reduction"] == pytest.approx((0.5, 0.1))
    assert spreads["beam, without damper"] == (0.1, 0.0)
    row = Row("beam amplitude", "m", 0.05, 0.08, spreads=(0.03, 0.04))
    assert _cells(row, 1e3) == ["50 ± 30", "80 ± 40", "30 ± 50", "+60.00 %"]
    row = Row("efficiency", "-", 0.644712, 0.794741, spreads=(0.0581, 0.0))
    assert _cells(row, 1.0) == ["0.645 ± 0.058", "0.79474", "0.150 ± 0.058", "+23.27 %"]


@pytest.mark.slow
def test_the_command_compares_stages_and_writes_numbers_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "short.yaml"
    scene.write_text(SHORT.replace("duration:   8.0", "duration:   4.0").replace("[7.0, 8.0]", "[3.0, 4.0]"))
    bags = [str(record(tmp_path / name, scene, [(0.8, height, 0.01)])) for name, height in (("a", 0.15), ("b", 0.2))]
    assert main(["bag", "compare", *bags, "--out", str(tmp_path / "out"), "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["stage 1: ceiling height"]["difference"] == pytest.approx(0.05, abs=1e-3)
    assert rows["stage 1: efficiency"]["difference"] > 0.02
    for name, limit in (("reduction", "beam, without damper"), ("efficiency", "beam, closed damper")):
        amplitude, reference = rows["stage 1: beam amplitude"]["second"], rows[f"stage 1: {limit}"]["second"]
        assert rows[f"stage 1: {name}"]["second"] == pytest.approx(1.0 - amplitude / reference)
    assert "sample to command, p99" not in rows  # simulated in lockstep
    assert (tmp_path / "out" / "bags.png").stat().st_size > 20_000
    page = (tmp_path / "out" / "bags.html").read_text(encoding="utf-8")
    assert "stage 1: reduction [-]" in page
    assert '<svg role="img"' in page
    assert json.loads((tmp_path / "out" / "bags.json").read_text())["aligned_by"] == "start"


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = written(tmp_path / "a", 0.1)
    assert main(["bag", "compare", str(first), str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "not a bag" in capsys.readouterr().err
