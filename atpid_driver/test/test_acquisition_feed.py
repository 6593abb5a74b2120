# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wiring of the emulated stand, and a laser that dies or freezes: plant blocks become volts, metres come back."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import CeilingState, Event, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus

from atpid_common.nodes.handshake import empty_block
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, doubles
from atpid_driver import DriverError
from atpid_driver.nodes.feed_node import FeedNode
from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.standins import Feed, StandinError, build

CHANNELS = ["support_displacement", "beam_displacement"]
CALIBRATIONS = ["emulated_support.yaml", "emulated_beam.yaml"]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with closing(Bench()) as made:
        yield made


def test_the_plants_metres_come_back_measured(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
        data = doubles(motion[start : start + 50])
        plant.publish(SampleBlock(first_index=start, rate=1000.0, channels=CHANNELS, data=data))

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


def test_the_motors_states_are_passed_on_and_the_feed_is_removed_with_the_node(bench: Bench, tmp_path: Path) -> None:
    passed: list[CeilingState] = []
    bench.peer.create_subscription(CeilingState, "emulated/ceiling/state", passed.append, STATES)
    node = bench.start(FeedNode, feed=str(tmp_path / "feed"), calibrations=CALIBRATIONS)
    bench.until(lambda: bench.diagnostics)
    assert bench.status.name.startswith("feed_node: ")
    assert {"waiting", "sensors/laser", str(tmp_path / "feed")} <= set(bench.status.message.split())
    bench.until(lambda: bench.state.get_subscription_count())
    state = CeilingState(height=0.25, mode=CeilingState.MOVING)
    state.header.frame_id = "motor_node"
    while not passed:
        bench.state.publish(CeilingState(handshake=True))
        bench.state.publish(state)
        bench.executor.spin_once(timeout_sec=0.05)
    assert {(one.header.frame_id, one.height) for one in passed} == {("motor_node", 0.25)}
    assert (tmp_path / "feed").exists()
    bench.added.remove(node)
    bench.executor.remove_node(node)
    node.destroy_node()
    assert not (tmp_path / "feed").exists()


def test_a_node_that_cannot_feed_is_refused_and_replaces_no_file(bench: Bench, tmp_path: Path) -> None:
    feed, mine = str(tmp_path / "feed"), tmp_path / "thesis.tex"
    mine.write_text("mine")
    wrong: list[tuple[dict[str, object], str]] = [
        ({"calibrations": CALIBRATIONS}, "feed_node.*feed"),
        ({"feed": feed, "calibrations": CALIBRATIONS, "rest": [0.0, 0.0, 0.0]}, r"rest.*0\.0, 0\.0, 0\.0.* 2 "),
        ({"feed": str(mine)}, r"thesis\.tex"),
    ]
    for values, parts in wrong:
        with pytest.raises(DriverError, match=parts):
            bench.start(FeedNode, **values)
    assert mine.read_text() == "mine"
    Feed(Path(feed), channels=2, rate=1000.0)  # left behind by a killed node
    bench.start(FeedNode, feed=feed)


def test_a_feed_keeps_its_newest_frames_and_touches_no_other_file(tmp_path: Path) -> None:
    with closing(Feed(tmp_path / "feed", channels=2, rate=100.0, capacity=8)) as feed:
        feed.write(np.arange(40.0).reshape(20, 2))
        assert feed.written == 20
        with pytest.raises(StandinError, match="2 volts"):
            feed.write(np.zeros((3, 1)))
        (tmp_path / "feed").unlink()
        (tmp_path / "feed").write_text("mine")
    assert (tmp_path / "feed").read_text() == "mine"


SUPPORT, BEAM = "support_displacement", "beam_displacement"


class Lasers:
    """Two lasers behind LabJack's own package, which see a stand in the time of the feed: faster than the clock's."""

    def __init__(self, bench: Bench, feed: Feed) -> None:
        self.bench, self.feed, self._random = bench, feed, np.random.default_rng(3)
        self.support: float | None = None  # what the support's laser gives instead of its reading [V]
        self._ahead, self._wrote = 4, time.monotonic()  # blocks written and not yet received; when the last was
        channels = {"channels": [SUPPORT, BEAM], "terminals": ["AIN0", "AIN1"]}
        files = {"calibrations": ["laser_support.yaml", "laser_beam.yaml"]}
        library = str(build() / "libLabJackM.so")
        bench.start(LabJackNode, rate=1000.0, library=library, handshake=False, **channels, **files)
        self.until(lambda: bench.blocks)

    def until(self, what: Callable[[], object]) -> None:
        """Let the lasers see noise and a vibration of the beam until something has happened."""
        bench = self.bench

        def happened() -> bool:
            if time.monotonic() - self._wrote > 0.5:  # what was written before the stream began is never received
                self._ahead += 1
            if self.feed.written < 50 * (len(bench.blocks) + self._ahead):
                self._wrote = time.monotonic()
                t = (self.feed.written + np.arange(50)) / 1000.0
                volts = 3.0 + np.outer(np.sin(2.0 * np.pi * 5.5 * t), [0.0, 0.5])
                volts += self._random.normal(0.0, 2.7e-4, volts.shape)
                if self.support is not None:
                    volts[:, 0] = self.support
                self.feed.write(volts)
            return bool(what())

        bench.until(happened)

    def stand(self, seconds: float, support: float | None = None) -> None:
        """Go on for some seconds of the feed."""
        self.support = support
        end = len(self.bench.blocks) + round(seconds / 0.05)
        self.until(lambda: len(self.bench.blocks) >= end)


@pytest.fixture
def lasers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lasers]:
    bench = Bench()
    monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{tmp_path / 'feed'}")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(tmp_path / "no-faults"))
    with closing(Feed(tmp_path / "feed", channels=2, rate=1000.0)) as feed:
        yield Lasers(bench, feed)
        bench.close()


def test_a_laser_that_dies_or_freezes_is_an_event_a_status_and_nan_and_so_is_its_return(lasers: Lasers) -> None:
    bench = lasers.bench
    lasers.stand(10.0)
    assert bench.faults() == []  # of a support at rest
    lasers.until(lambda: SUPPORT in bench.channels)
    assert bench.channels[SUPPORT].level == DiagnosticStatus.OK
    for volts, parts in ((0.2, {"0.200", "0.9"}), (3.1, {"3.100", "1"})):
        bench.events.clear()
        lasers.stand(2.0, support=volts)
        lasers.until(bench.faults)
        (fault,) = (event for event in bench.events if event.kind == Event.FAULT)
        assert fault.severity == Event.ALARM
        assert {f"{SUPPORT}:", *parts} <= set(fault.text.split())
        assert fault.value == pytest.approx(volts)
        # at once, not with the next second
        lasers.until(lambda: bench.channels[SUPPORT].level == DiagnosticStatus.ERROR)
        status = bench.channels[SUPPORT]
        assert fault.text == f"{SUPPORT}: {status.message}"
        assert {pair.key: pair.value for pair in status.values}["reading [V]"] == f"{volts:.4f}"
        assert bench.channels[BEAM].level == DiagnosticStatus.OK
        data = np.frombuffer(bench.blocks[-1].data).reshape(-1, 2)
        assert np.isnan(data[:, 0]).all()
        assert np.isfinite(data[:, 1]).all()
        lasers.stand(2.5)
        lasers.until(bench.recovered)
        lasers.stand(0.1)
        assert np.isfinite(np.frombuffer(bench.blocks[-1].data)).all()
        assert len(bench.faults()) == 1
