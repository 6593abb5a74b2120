# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two bags beside each other: what is the same, a known difference, a common time axis, bad input."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bag_files import BAG, ROOT
from recorded import EVENTS, LASER, Capture, block, make, record, refused, short, write_bag
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs.decode import stamp_of
from atpid_control.runs.read import Bag, open_bag
from atpid_control.views.report.stages import Stage
from atpid_control.views.report.view import view_of
from atpid_lab import comparison as compare
from atpid_lab.comparison import BagComparisonError, Compared, Row, compare_bags
from atpid_lab.traces.file import TraceError, Tracer
from atpid_sim.scene import load_scene
from atpid_sim.simulation.excitation import amplitude_at
from atpid_sim.simulation.integration import undamped_amplitude

RATE = 1000.0
START = 1_000_000_000
BEAMS = "beam, second less first, root mean square"


def written(folder: Path, amplitude: float = 0.1, delay: float = 0.0, lost: int = 0, start_ns: int = START) -> Path:
    """Write 4 s of two tones at 5 Hz whose event `moved` is at 1 s, all of it `delay` [s] later."""
    time = np.arange(4000) / RATE - delay
    data = np.column_stack([0.01 * np.sin(10.0 * np.pi * time), amplitude * np.sin(10.0 * np.pi * time - 1.0)])
    kept = [first for first in range(0, 4000, 50) if not 2000 <= first < 2000 + lost]
    messages = [(LASER, block(first, data[first : first + 50], RATE, start_ns)) for first in kept]
    moved = make("Event", start_ns + round((1.0 + delay) * 1e9), "motor_node", kind="moved", text="moved")
    return write_bag(folder, [*messages, (EVENTS, moved)], topics=(LASER, EVENTS))


def rows_of(found: Compared) -> dict[str, Row]:
    return {row.name: row for row in found.rows}


def test_a_known_difference(tmp_path: Path) -> None:
    found = compare_bags(written(tmp_path / "a", 0.1), written(tmp_path / "b", 0.12, lost=100))
    rows = rows_of(found)
    order = rows["order 1 of the beam, last part"]
    assert (order.first, order.second, order.difference) == pytest.approx((0.1, 0.12, 0.02), rel=1e-5)
    assert rows[BEAMS].second == pytest.approx(0.02 / np.sqrt(2.0), rel=1e-2)
    lost = rows["samples lost"]
    assert (lost.first, lost.second, lost.difference) == (0.0, 100.0, 100.0)
    gap = (found.time > 2.0) & (found.time < 2.099)
    assert np.isnan(found.difference[gap]).all()
    assert np.isfinite(found.difference[~((found.time > 1.99) & (found.time < 2.11))]).all()
    assert any(" 100 " in line for line in found.doubts)


def test_runs_are_aligned_by_an_event_or_by_the_clock(tmp_path: Path) -> None:
    first = written(tmp_path / "a")
    late = written(tmp_path / "b", delay=0.25)
    elsewhere = written(tmp_path / "c", delay=0.25, start_ns=START - 250_000_000)
    assert rows_of(compare_bags(first, late))[BEAMS].second > 0.05
    for other, align in ((late, "moved"), (elsewhere, "clock")):
        found = compare_bags(first, other, align)
        assert found.runs[1].shift == pytest.approx(-0.25)
        assert rows_of(found)[BEAMS].second < 1e-12
        assert (found.time[0], found.time[-1]) == pytest.approx((0.0, 3.749), abs=2e-3)


def test_no_common_time_and_no_such_event(tmp_path: Path, capsys: Capture) -> None:
    first, later = written(tmp_path / "a"), written(tmp_path / "b", start_ns=START + 60_000_000_000)
    with pytest.raises(BagComparisonError, match=r"--align: .*clock; .* 60 to 63\.999 s.*start"):
        compare_bags(first, later, "clock")
    with pytest.raises(BagComparisonError, match=r"'rumble'; .*moved; .*start, clock"):
        compare_bags(first, later, "rumble")
    refused(capsys, ["bag", "compare", first, tmp_path, "--out", tmp_path / "out"], str(tmp_path))


def test_the_scatter_of_an_irregular_stage_stands_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = written(tmp_path / "a")
    stage = Stage(0.0, 4.0, 0.01, 0.01, 5.47, 0.3, 0.05, 0.2, 0.75, 0.1, 0.5, amplitude_spread=(0.04, 0.06))
    regular = replace(stage, amplitude=0.08, amplitude_spread=None)
    views = iter([replace(view_of(bag), stages=[one]) for one in (stage, regular)])

    monkeypatch.setattr(compare, "view_of", lambda _run: next(views))
    found = compare_bags(bag, bag)
    rows = rows_of(found)
    for name, first, spread in (("beam amplitude", 0.05, 0.01), ("efficiency", 0.75, 0.05), ("reduction", 0.5, 0.1)):
        row = rows[f"stage 1: {name}"]
        assert (row.first, *row.spreads) == pytest.approx((first, spread, 0.0))
    assert rows["stage 1: beam, without damper"].spreads == (0.0, 0.0)


def test_the_command_compares_stages_and_writes_numbers_and_picture(tmp_path: Path, capsys: Capture) -> None:
    scene = short(tmp_path, 4.0)
    bags = [str(record(tmp_path / name, scene, [(0.8, height, 0.01)])) for name, height in (("a", 0.15), ("b", 0.2))]
    assert main(["bag", "compare", *bags, "--out", str(tmp_path / "out"), "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["stage 1: ceiling height"]["difference"] == pytest.approx(0.05, abs=1e-3)
    assert rows["stage 1: efficiency"]["difference"] > 0.02
    for name, limit in (("reduction", "beam, without damper"), ("efficiency", "beam, closed damper")):
        amplitude, reference = rows["stage 1: beam amplitude"]["second"], rows[f"stage 1: {limit}"]["second"]
        assert rows[f"stage 1: {name}"]["second"] == pytest.approx(1.0 - amplitude / reference)
    assert json.loads((tmp_path / "out" / "bags.json").read_text())["aligned_by"] == "start"


@pytest.fixture(scope="module")
def bag() -> Bag:
    return open_bag(BAG)


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    file = tmp_path_factory.mktemp("traces") / "traces.mcap"
    assert main(["bag", "traces", str(BAG), "--out", str(file)]) == 0
    return Traced(file)


def test_every_sample_has_its_number_at_its_time(bag: Bag, traced: Traced) -> None:
    blocks = [block for _, block in bag.messages(LASER)]
    for place, name in enumerate(blocks[0].channels):
        times, values = traced.series(f"/traces/{name}")
        data = np.concatenate([block.data.reshape(-1, len(block.channels))[:, place] for block in blocks])
        assert np.array_equal(values, data, equal_nan=True)
        late = 1e9 * blocks[0].skew[place]
        index = np.arange(len(data))
        assert np.abs(times - (stamp_of(blocks[0]) + 1e9 * index / blocks[0].rate + late)).max() <= 2.0  # ns, rounded


def test_the_messages_of_the_bag_are_in_the_file_unchanged(bag: Bag, traced: Traced) -> None:
    for topic, kind in bag.types.items():
        assert traced.types[topic] == kind
        copied = [message for _, message in traced.messages[topic]]
        own = [message for _, message in bag.messages(topic)]
        assert [str(message) for message in copied] == [str(message) for message in own]


def test_the_efficiency_is_that_of_the_true_motion(bag: Bag, traced: Traced) -> None:
    truth = [block for _, block in bag.messages("/plant/truth")]
    beam = np.concatenate([block.beam for block in truth])
    scene = load_scene(BAG.with_suffix(".yaml"))
    found = {stamp_of(message): message for _, message in bag.messages("/excitation")}
    times, values = traced.series("/traces/efficiency")
    assert len(times) > 50
    for time, value in zip(times, values, strict=True):
        last = round(time * 1e-9 * truth[0].rate)
        window = beam[last - round(found[time].window * truth[0].rate) : last + 1]
        closed = scene.linear_amplitude(amplitude_at(scene, time * 1e-9), grain=True)
        assert value == pytest.approx(1.0 - 0.5 * np.ptp(window) / closed, abs=0.01)


@pytest.mark.parametrize("name", ["thesis_4_3", "standard"])
def test_the_closed_damper_is_the_simulated_one(name: str) -> None:
    tone = {"amplitude": 0.01, "frequency": "resonance"}
    scene = load_scene(ROOT / f"scenes/{name}.yaml").with_(excitation=tone, duration=60.0)
    assert scene.linear_amplitude(0.01, grain=True) == pytest.approx(undamped_amplitude(scene), rel=2e-3)


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "traces.mcap"
    file.write_bytes(b"mine")
    refused(capsys, ["bag", "traces", BAG, "--out", file], "traces.mcap: exists")
    assert file.read_bytes() == b"mine"


def test_a_time_that_cannot_be_is_refused() -> None:
    head = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="x")
    block = SimpleNamespace(
        header=head, handshake=False, first_index=0, rate=1000.0, skew=np.array([0.0, 1e308]),
        data=np.array([0.01, -0.02]), channels=["support_displacement", "beam_displacement"],
    )  # fmt: skip
    with pytest.raises(TraceError, match=r"1e\+308 s; .*\b0 to 1 s"):
        list(Tracer().push("SampleBlock", block))
