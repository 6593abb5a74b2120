# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wiring of the emulated stand: plant blocks become volts, the real client package reads them, metres come back."""

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import CeilingState, Event, SampleBlock

from atpid_common.nodes.handshake import empty_block
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, doubles
from atpid_driver import DriverError
from atpid_driver.nodes.feed_node import FeedNode
from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.standins import Control, Feed, StandinError, build

CHANNELS = ["support_displacement", "beam_displacement"]
CALIBRATIONS = ["emulated_support.yaml", "emulated_beam.yaml"]


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def plant_block(first: int, values: np.ndarray, rate: float = 1000.0) -> SampleBlock:
    return SampleBlock(first_index=first, rate=rate, channels=CHANNELS, data=doubles(values))


@pytest.mark.slow
def test_the_plants_metres_come_back_through_the_device(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "feed"
    monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{path}")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(tmp_path / "no-faults"))
    plant = bench.peer.create_publisher(SampleBlock, "emulated/sensors/laser", BLOCKS)
    answers: list[CeilingState] = []
    bench.peer.create_subscription(CeilingState, "emulated/ceiling/state", answers.append, STATES)
    bench.start(FeedNode, feed=str(path), calibrations=CALIBRATIONS, noise=0.0, rest=[0.0, -8.25e-3])
    bench.until(lambda: plant.get_subscription_count())
    plant.publish(empty_block(tuple(CHANNELS), ("m", "m")))
    library = str(build() / "libLabJackM.so")
    values = {"rate": 1000.0, "channels": CHANNELS, "terminals": ["AIN0", "AIN1"], "calibrations": CALIBRATIONS}
    values["frozen_time"] = 600.0  # without noise a body at rest is a frozen sensor
    bench.start(LabJackNode, **values, library=library, handshake=False)
    bench.until(lambda: bench.blocks)  # a body at rest
    at_rest = np.frombuffer(bench.blocks[-1].data).reshape(-1, 2)
    np.testing.assert_allclose(at_rest, np.tile([0.0, -8.25e-3], (len(at_rest), 1)), atol=1e-12)
    assert not answers  # no handshake is passed on before the device streams
    while not answers:
        plant.publish(empty_block(tuple(CHANNELS), ("m", "m")))
        bench.executor.spin_once(timeout_sec=0.05)
    assert answers[0].handshake

    motion = np.random.default_rng(2).uniform(-0.5, 0.5, (2000, 2))
    motion[700, 1] = np.nan  # saturated
    for start in range(0, 2000, 50):
        plant.publish(plant_block(start, motion[start : start + 50]))

    def seen() -> np.ndarray:
        data = np.concatenate([np.frombuffer(block.data).reshape(-1, 2) for block in bench.blocks])
        moving = np.flatnonzero(data[:, 0])
        return data[moving[0] :] if len(moving) else data[:0]

    bench.until(lambda: len(seen()) >= 1900)
    read = seen()[:1900]
    # the second channel is sampled 15 us later, so that it lies between two frames
    assert np.abs(read[:, 0] - motion[:1900, 0]).max() < 1e-12
    between = motion[:-1, 1] + 0.015 * np.diff(motion[:, 1])
    assert np.nanmax(np.abs(read[:, 1] - between[:1900])) < 1e-9
    assert np.isnan(read[700, 1])
    events = bench.peer.create_publisher(Event, "events", EVENTS)
    bench.until(lambda: events.get_subscription_count() >= 2)
    events.publish(Event(kind="finished"))
    bench.until(lambda: len(seen()) >= 2400)  # the sensors go on when the plant has finished
    assert seen()[2399, 0] == pytest.approx(motion[-1, 0])
    last = bench.blocks[-1]
    assert last.dropped == 0


def test_the_motors_states_are_passed_on(bench: Bench, tmp_path: Path) -> None:
    passed: list[CeilingState] = []
    bench.peer.create_subscription(CeilingState, "emulated/ceiling/state", passed.append, STATES)
    bench.start(FeedNode, feed=str(tmp_path / "feed"), calibrations=CALIBRATIONS)
    bench.until(lambda: bench.state.get_subscription_count())
    state = CeilingState(height=0.25, mode=CeilingState.MOVING)
    state.header.frame_id = "motor_node"
    handshake = CeilingState()
    handshake.handshake = True
    while not passed:
        bench.state.publish(handshake)
        bench.state.publish(state)
        bench.executor.spin_once(timeout_sec=0.05)
    assert {(one.header.frame_id, one.height) for one in passed} == {("motor_node", 0.25)}


def test_the_feed_is_removed_with_the_node(bench: Bench, tmp_path: Path) -> None:
    node = bench.start(FeedNode, feed=str(tmp_path / "feed"), calibrations=CALIBRATIONS)
    assert (tmp_path / "feed").exists()
    bench.nodes.clear()
    bench.executor.remove_node(node)
    node.destroy_node()
    assert not (tmp_path / "feed").exists()


def test_another_file_in_the_feeds_place_stays(tmp_path: Path) -> None:
    with closing(Feed(tmp_path / "feed", channels=2, rate=1000.0)):
        (tmp_path / "feed").unlink()
        (tmp_path / "feed").write_text("mine")
    assert (tmp_path / "feed").read_text() == "mine"
    with pytest.raises(StandinError, match="cannot be made: No such file"):
        Feed(tmp_path / "nowhere" / "feed", channels=2, rate=1000.0)


def test_a_feed_without_a_file_is_refused(bench: Bench) -> None:
    with pytest.raises(DriverError, match="feed_node needs"):
        bench.start(FeedNode, calibrations=CALIBRATIONS)


def test_a_reading_at_rest_for_another_number_of_channels_is_refused(bench: Bench, tmp_path: Path) -> None:
    with pytest.raises(DriverError, match="allowed: one number, or one for each of 2 calibrations"):
        bench.start(FeedNode, feed=str(tmp_path / "feed"), calibrations=CALIBRATIONS, rest=[0.0, 0.0, 0.0])


def test_a_file_that_is_no_feed_is_neither_replaced_nor_removed(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(DriverError, match="exists and is no feed"):
        bench.start(FeedNode, feed=str(tmp_path / "thesis.tex"))
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    Feed(tmp_path / "feed", channels=2, rate=1000.0)  # left behind by a killed node
    bench.start(FeedNode, feed=str(tmp_path / "feed"))


@pytest.mark.slow
def test_a_feed_reports_what_it_waits_for(bench: Bench, tmp_path: Path) -> None:
    bench.start(FeedNode, feed=str(tmp_path / "feed"))
    bench.until(lambda: bench.diagnostics)
    status = bench.diagnostics[-1]
    assert (status.name, status.hardware_id) == ("feed_node: feed", "emulated device")
    assert status.message == f"waiting for sensors/laser of the device that reads {tmp_path / 'feed'}"


def test_a_feed_keeps_its_newest_frames_and_checks_their_width(tmp_path: Path) -> None:
    with closing(Feed(tmp_path / "feed", channels=2, rate=100.0, capacity=8)) as feed:
        feed.write(np.arange(40.0).reshape(20, 2))
        assert feed.written == 20
        with pytest.raises(StandinError, match="2 volts"):
            feed.write(np.zeros((3, 1)))
    with pytest.raises(StandinError, match="positive"):
        Feed(tmp_path / "feed", channels=0, rate=100.0)


def test_another_file_is_not_taken_for_a_control(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("x" * 5000)
    with pytest.raises(StandinError, match="control file"):
        Control(path)
    assert os.path.getsize(path) == 5000
