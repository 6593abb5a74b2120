# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag with its traces for Foxglove and PlotJuggler."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bag_files import BAG, ROOT
from recorded import LASER, refused
from rosbags.typesys import Stores, get_typestore
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs.losses import stamp_of
from atpid_control.runs.read import Bag, open_bag
from atpid_control.views.traces.records import MARKERS, NUMBER, TEXT
from atpid_control.views.traces.tracer import TraceError, Tracer
from atpid_sim.scene import load_scene
from atpid_sim.simulation.excitation import amplitude_at
from atpid_sim.simulation.integration import undamped_amplitude


@pytest.fixture(scope="module")
def bag() -> Bag:
    return open_bag(BAG)


@pytest.fixture(scope="module")
def truth(bag: Bag) -> list[Any]:
    return [block for _, block in bag.messages("/plant/truth")]


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


def test_the_efficiency_is_that_of_the_true_motion(bag: Bag, truth: list[Any], traced: Traced) -> None:
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


def test_the_damper_stands_as_the_plant_does(truth: list[Any], traced: Traced) -> None:
    beam, grain, ceiling = (np.concatenate([getattr(b, name) for b in truth]) for name in ("beam", "grain", "ceiling"))
    shown = [(time, array) for time, array in traced.messages["/traces/damper"] if len(array.markers) == 4]
    assert len(shown) == pytest.approx(25 * 8, abs=2)  # 25 pictures a second of 8 s
    for time, array in shown:
        parts = {marker.ns: marker for marker in array.markers}
        place = round(time * 1e-9 * truth[0].rate)
        thick = parts["floor"].scale.z
        assert {marker.header.frame_id for marker in array.markers} == {"stand"}
        heights = {name: parts[name].pose.position.z for name in ("floor", "ceiling", "grain")}
        assert heights == pytest.approx({
            "floor": beam[place] - 0.5 * thick,
            "ceiling": beam[place] + ceiling[place] + 0.5 * thick,
            "grain": grain[place] + 0.5 * parts["grain"].scale.z,
        })  # fmt: skip


def test_a_slower_rate_takes_every_nth_sample(bag: Bag, traced: Traced, tmp_path: Path) -> None:
    file = tmp_path / "slow.mcap"
    assert main(["bag", "traces", str(BAG), "--out", str(file), "--rate", "170"]) == 0
    times, values = Traced(file).series("/traces/beam_displacement")
    all_times, all_values = traced.series("/traces/beam_displacement")
    every = math.ceil(next(bag.messages(LASER))[1].rate / 170.0)
    assert np.array_equal(times, all_times[::every])
    assert np.array_equal(values, all_values[::every], equal_nan=True)


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "traces.mcap"
    file.write_bytes(b"mine")
    refused(capsys, ["bag", "traces", BAG, "--out", file], "traces.mcap: exists")
    assert file.read_bytes() == b"mine"


def test_without_the_plants_truth_the_damper_is_drawn_from_the_laser() -> None:
    tracer = Tracer()
    head = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="x")
    state = SimpleNamespace(header=head, handshake=False, height=0.2, mode=3)
    block = SimpleNamespace(
        header=head, handshake=False, first_index=0, rate=1000.0, skew=np.zeros(2), data=np.array([0.01, -0.02]),
        channels=["support_displacement", "beam_displacement"],
    )  # fmt: skip
    assert [record.type for record in tracer.push("CeilingState", state)] == [TEXT]
    records = list(tracer.push("SampleBlock", block))
    assert [record.type for record in records] == [NUMBER, NUMBER, MARKERS]
    drawn: Any = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(records[-1].data, MARKERS)
    assert [marker.ns for marker in drawn.markers] == ["support", "floor", "ceiling"]
    block.skew = np.array([0.0, 1e308])
    with pytest.raises(TraceError, match=r"1e\+308 s; .*\b0 to 1 s"):
        list(tracer.push("SampleBlock", block))
