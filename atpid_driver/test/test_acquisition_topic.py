# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples of another ROS driver: the contract, and a real publisher in a process of its own that is late and loses."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import SampleBlock
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_driver import DriverError
from atpid_driver.acquisition import Acquisition, Channel, topic
from atpid_driver.acquisition.contract import AcquisitionContract
from atpid_driver.acquisition.protocol import StreamLostError
from atpid_driver.acquisition.topic import TopicAcquisition, TopicSettings
from atpid_driver.clock import earliest_line
from atpid_driver.nodes.acquisition_node import AcquisitionNode

LONG = settings.get_current_profile_name() == "long"
DRIVER = Path(__file__).with_name("driver_of_others.py")
RATE = 200.0
CHANNELS = (Channel(name="a", terminal="data[0]"), Channel(name="b", terminal="data[1]"))


def acquisition(**more: Any) -> TopicAcquisition:
    told: dict[str, Any] = {"channels": CHANNELS, "rate": RATE, "scans_per_block": 10, "source": "imu/data"}
    return TopicAcquisition(TopicSettings(**told | more))


@contextmanager
def publishing(publish: Callable[[int], None]) -> Iterator[None]:
    """Call `publish` with 0, 1, 2, ... at the rate, in a thread of its own."""
    end = threading.Event()

    def run() -> None:
        began, index = time.monotonic(), 0
        while not end.wait(max(0.0, began + index / RATE - time.monotonic())):
            publish(index)
            index += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


@pytest.fixture
def soon_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(topic, "_MEASURED_S", 0.7)


@pytest.mark.usefixtures("soon_measured")
class TestContract(AcquisitionContract):
    """The tests of every backend, with a thread that publishes."""

    @pytest.fixture(autouse=True)
    def _publishing(self) -> Iterator[None]:
        self._devices: list[TopicAcquisition] = []

        def publish(index: int) -> None:
            for device in self._devices:
                device.arrived(np.array([[index, -index]], float), None, index)

        with publishing(publish):
            yield

    def make(self, serial: int = 0) -> Acquisition:
        self._devices.append(acquisition(serial=serial))
        return self._devices[-1]

    def serial(self) -> int:
        return 0


@settings(max_examples=200 if LONG else 50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(20.0, 5000.0), late=st.floats(0.0, 5.0))
def test_the_earliest_arrivals_give_the_line(seed: int, rate: float, late: float) -> None:
    random = np.random.default_rng(seed)
    places = np.arange(max(40, int(2.0 * rate)), dtype=np.float64)
    delays = random.exponential(late / rate, len(places)) * (random.random(len(places)) < 0.7)  # some are not delayed
    slope, offset = earliest_line(places, 5.0 + places / rate + delays)
    assert slope * rate == pytest.approx(1.0, abs=2e-2)
    assert -0.5 / rate < offset - 5.0 < (1.0 + late) / rate


def test_what_comes_twice_is_counted_and_messages_with_and_without_stamps_end_the_stream(soon_measured: None) -> None:
    device = acquisition(channels=CHANNELS[:1])

    def publish(index: int) -> None:
        stamp = None if index % 300 == 299 else 10**18 + round(index / RATE * 1e9)
        for _ in range(1 + (index % 10 == 0)):
            device.arrived(np.array([[float(index)]]), stamp, None)

    with publishing(publish):
        device.start()
        with pytest.raises(StreamLostError, match=r"imu/data.*stamps"):
            list(iter(device.read, None))
    assert device.late


@pytest.fixture
def bench() -> Iterator[Bench]:
    with closing(Bench()) as made:
        yield made


@pytest.fixture
def drivers() -> Iterator[list["subprocess.Popen[bytes]"]]:
    running: list[subprocess.Popen[bytes]] = []
    yield running
    for one in running:
        one.kill()
        one.communicate()


def driver(running: list["subprocess.Popen[bytes]"], *streams: str) -> None:
    running.append(subprocess.Popen([sys.executable, str(DRIVER), "60", *streams], stdout=subprocess.PIPE))


TERMINALS = {
    "state": ("atpid_interfaces/msg/CeilingState", ["height", "target"]),
    "array": ("std_msgs/msg/Float64MultiArray", ["data[0]", "data[1]"]),
    "number": ("std_msgs/msg/Float64", ["data"]),
    "scans": ("std_msgs/msg/Float64MultiArray", ["data[0]", "data[1]"]),
}


def listen(bench: Bench, kind: str, to: str, **more: object) -> None:
    """Start a node, of a name of its own, that publishes what it hears of a kind."""
    source_type, terminals = TERMINALS[kind]
    names = ["beam_acceleration", "turn"][: len(terminals)]
    bench.start(
        type("Listening", (AcquisitionNode,), {"NAME": f"node_of_{to.replace('/', '_')}"}),
        backend="topic", topic=to, source=f"others/{kind}", source_type=source_type, channels=names,
        terminals=terminals, units=["m/s^2", "rad/s"][: len(names)], factors=[2.0], handshake=False,
        **{"rate": RATE, "frozen_time": 600.0, "columns": 2 if kind == "scans" else 0, **more},
    )  # fmt: skip


def samples(blocks: list[SampleBlock]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return index, stamp [s] and value (n, channels) of every sample."""
    data = [np.frombuffer(block.data).reshape(-1, len(block.channels)) for block in blocks]
    rows = [np.arange(len(part)) for part in data]
    stamps = [block.header.stamp.sec + 1e-9 * block.header.stamp.nanosec for block in blocks]
    index = [block.first_index + row for block, row in zip(blocks, rows, strict=True)]
    stamp = [at + row / block.rate for at, block, row in zip(stamps, blocks, rows, strict=True)]
    return np.concatenate(index), np.concatenate(stamp), np.concatenate(data)


@pytest.mark.wall_time  # what has no stamp has its time by its arrival
def test_a_driver_in_another_process(bench: Bench, drivers: list["subprocess.Popen[bytes]"]) -> None:
    late = f"{RATE}:0:0.004:0"
    streams = {"array": late, "number": late, "scans": f"{RATE / 10}:0:0.004:0", "state": f"{RATE}:0.05:0.004:0.1"}
    blocks: dict[str, list[SampleBlock]] = {kind: [] for kind in streams}
    for kind, found in blocks.items():
        bench.peer.create_subscription(SampleBlock, f"of/{kind}", found.append, 1000)
        listen(bench, kind, f"of/{kind}")
    driver(drivers, *(f"{kind}:{how}" for kind, how in streams.items()))
    bench.until(lambda: min(map(len, blocks.values())) > 60)
    assert drivers[0].stdout is not None
    began = int(drivers[0].stdout.readline()) * 1e-9
    for kind, found in blocks.items():
        stamped, last = kind == "state", found[-1]
        index, stamp, value = samples(found)
        assert np.array_equal(index, np.arange(len(index)))
        got = np.isfinite(value[:, 0])
        away = value[got, 0] / 2.0 - index[got]
        assert np.ptp(away) == 0.0  # every number stands where it belongs
        assert last.dropped == np.count_nonzero(~got)
        assert stamped == (last.dropped > 0)
        assert last.dropped / len(got) < 2.0 * 0.05
        # without stamps both are of arrivals, which a busy machine delays
        assert last.rate == pytest.approx(RATE, rel=5e-3 if stamped else 3e-2)
        assert last.units[0] == "m/s^2"
        if value.shape[1] > 1:
            np.testing.assert_array_equal(value[got, 1], -value[got, 0])
        before = 9 / RATE if kind == "scans" else 0.0  # a message holds what was taken before it
        off = stamp - began - (index + away[0]) / RATE + before
        low, high = (-0.02, 0.01) if stamped else (-0.2, 0.2)
        assert low < off.min() <= off.max() < high


def test_a_driver_that_stops_is_reported_and_comes_back(bench: Bench, drivers: list["subprocess.Popen[bytes]"]) -> None:
    listen(bench, "state", "sensors/laser", silence=0.5)
    listen(bench, "state", "wrong", rate=100.0)  # another one than is stated
    driver(drivers, f"state:{RATE}:0:0:0")
    bench.until(lambda: len(bench.blocks) > 10)
    bench.until(lambda: bench.has_event("`rate`"))
    (refusal,) = (text for text in bench.faults() if "`rate`" in text)
    assert {"others/state", "100:", "2"} <= set(refusal.split())
    bench.events.clear()  # a driver that took long to start was reported, too
    drivers[0].kill()
    bench.until(lambda: any({"CeilingState", "others/state", "0.5"} <= set(text.replace("/msg/", " ").split())
                            for text in bench.faults()))  # fmt: skip
    bench.events.clear()
    driver(drivers, f"state:{RATE}:0:0:0")
    bench.until(bench.recovered)
    blocks = len(bench.blocks)
    bench.until(lambda: len(bench.blocks) > blocks + 5)
    before, after = bench.blocks[blocks - 2], bench.blocks[-1]
    times = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in (before, after)]
    steps = (after.first_index - before.first_index) / after.rate
    assert steps == pytest.approx(times[1] - times[0], abs=0.5 / after.rate)
    assert after.dropped > RATE * 0.5


@pytest.mark.parametrize(
    ("more", "parts"),
    [({"source": ""}, "topic"), ({"source_type": "nowhere/msg/Data"}, "nowhere/msg/Data"),
     ({"source_type": "std_msgs/msg/Header"}, "terminals.*'height'.*std_msgs/msg/Header"),
     ({"units": ["m"]}, "units"), ({"factors": [0.0]}, "factors.* 0"),
     ({"calibrations": ["laser_beam.yaml", "x"]}, "calibrations"),
     ({"backend": "simulated", "units": None, "factors": None}, "units.*factors")],
)  # fmt: skip
def test_what_cannot_be_listened_to_is_one_line(bench: Bench, more: dict[str, object], parts: str) -> None:
    source_type, terminals = TERMINALS["state"]
    told = {"backend": "topic", "source": "x", "source_type": source_type, "units": ["m", "m"], "factors": [1.0]} | more
    told = {name: value for name, value in told.items() if value is not None}
    with pytest.raises(DriverError, match=f"^.*{parts}.*$"):
        bench.start(AcquisitionNode, rate=10.0, channels=["a", "b"], terminals=terminals, **told)
