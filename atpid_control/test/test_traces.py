# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag with its traces for Foxglove and PlotJuggler."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bag_files import BAG, ROOT
from recorded import LASER, Capture, refused
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs.losses import stamp_of
from atpid_control.runs.read import Bag, open_bag
from atpid_control.views.traces.tracer import TraceError, Tracer
from atpid_sim.scene import load_scene
from atpid_sim.simulation.excitation import amplitude_at
from atpid_sim.simulation.integration import undamped_amplitude


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
