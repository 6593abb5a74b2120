# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples of another ROS driver: the contract, and a real publisher in a process of its own that is late and loses."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import Bench
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_driver import DriverError
from atpid_driver.acquisition import Acquisition, Channel
from atpid_driver.acquisition.contract import AcquisitionContract
from atpid_driver.acquisition.errors import StreamLostError
from atpid_driver.acquisition.topic import TopicAcquisition, TopicSettings
from atpid_driver.clock import earliest_line
from atpid_driver.nodes.acquisition_node import AcquisitionNode

LONG = settings.get_current_profile_name() == "long"
DRIVER = Path(__file__).with_name("driver_of_others.py")
RATE = 200.0
CHANNELS = (Channel(name="a", terminal="data[0]"), Channel(name="b", terminal="data[1]"))


class TestContract(AcquisitionContract):
    """The tests of every backend, with a thread that publishes."""

    @pytest.fixture(autouse=True)
    def _publishing(self) -> Iterator[None]:
        self._devices: list[TopicAcquisition] = []
        end = threading.Event()

        def publish() -> None:
            began, index = time.monotonic(), 0
            while not end.wait(max(0.0, began + index / RATE - time.monotonic())):
                for device in self._devices:
                    device.arrived(np.array([[index, -index]], float), None, index)
                index += 1

        thread = threading.Thread(target=publish)
        thread.start()
        yield
        end.set()
        thread.join()

    def make(self, serial: int = 0) -> Acquisition:
        told = {"serial": serial, "rate": RATE, "scans_per_block": 10, "source": "imu/data"}
        device = TopicAcquisition(TopicSettings(channels=CHANNELS, **told))
        self._devices.append(device)
        return device

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


def test_messages_with_and_without_stamps_end_the_stream() -> None:
    device = TopicAcquisition(TopicSettings(channels=CHANNELS[:1], rate=RATE, scans_per_block=10, source="x"))
    end = threading.Event()

    def publish() -> None:
        began, index = time.monotonic(), 1
        while not end.wait(max(0.0, began + index / RATE - time.monotonic())):
            device.arrived(
                np.array([[float(index)]]), 10**18 + round(index / RATE * 1e9) if index % 900 else None, None
            )
            index += 1

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        device.start()
        with pytest.raises(StreamLostError, match="with and without stamps"):
            list(iter(device.read, None))
    finally:
        end.set()
        thread.join()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.fixture
def drivers() -> Iterator[list["subprocess.Popen[bytes]"]]:
    running: list[subprocess.Popen[bytes]] = []
    yield running
    for one in running:
        one.kill()
        one.communicate()


def driver(running: list["subprocess.Popen[bytes]"], kind: str, *how: float) -> None:
    command = [sys.executable, str(DRIVER), kind, *map(str, how)]
    running.append(subprocess.Popen(command, stdout=subprocess.PIPE))


TERMINALS = {
    "imu": ("sensor_msgs/msg/Imu", ["linear_acceleration.z", "angular_velocity.x"]),
    "state": ("atpid_interfaces/msg/CeilingState", ["height", "target"]),
    "array": ("std_msgs/msg/Float64MultiArray", ["data[0]", "data[1]"]),
    "number": ("std_msgs/msg/Float64", ["data"]),
    "scans": ("std_msgs/msg/Float64MultiArray", ["data[0]", "data[1]"]),
}


def listen(bench: Bench, kind: str, **more: object) -> None:
    source_type, terminals = TERMINALS[kind]
    names = ["beam_acceleration", "turn"][: len(terminals)]
    bench.start(
        AcquisitionNode, backend="topic", topic="sensors/laser", source="imu/data", source_type=source_type,
        channels=names, terminals=terminals, units=["m/s^2", "rad/s"][: len(names)], factors=[2.0], handshake=False,
        **{"rate": RATE, "frozen_time": 600.0, "columns": 2 if kind == "scans" else 0, **more},
    )  # fmt: skip


def samples(bench: Bench) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return index, stamp [s] and value (n, channels) of every sample."""
    index, stamp, value = [], [], []
    for block in bench.blocks:
        data = np.frombuffer(block.data).reshape(-1, len(block.channels))
        rows = np.arange(len(data))
        index.append(block.first_index + rows)
        stamp.append(block.header.stamp.sec + 1e-9 * block.header.stamp.nanosec + rows / block.rate)
        value.append(data)
    return np.concatenate(index), np.concatenate(stamp), np.concatenate(value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "loss", "jitter", "reorder"),
    [("array", 0.0, 0.004, 0.0), ("number", 0.0, 0.004, 0.0), ("scans", 0.0, 0.004, 0.0), ("state", 0.0, 0.0, 0.0),
     ("imu" if find_spec("sensor_msgs") else "state", 0.05, 0.004, 0.1)],
)  # fmt: skip
def test_a_driver_in_another_process(
    bench: Bench, drivers: list["subprocess.Popen[bytes]"], kind: str, loss: float, jitter: float, reorder: float
) -> None:
    listen(bench, kind)
    driver(drivers, kind, RATE / (10 if kind == "scans" else 1), loss, jitter, reorder, 60.0)
    bench.until(lambda: len(bench.blocks) > 60)
    index, stamp, value = samples(bench)
    assert np.array_equal(index, np.arange(len(index)))
    got = np.isfinite(value[:, 0])
    away = value[got, 0] / 2.0 - index[got]
    assert np.ptp(away) == 0.0  # every number stands where it belongs
    assert bench.blocks[-1].dropped == np.count_nonzero(~got)
    assert (loss == 0.0) == (bench.blocks[-1].dropped == 0)
    assert loss == 0.0 or np.count_nonzero(~got) / len(got) < 2.0 * loss
    # without stamps both are of arrivals, which a busy machine delays
    stamped = kind in ("imu", "state")
    assert bench.blocks[-1].rate == pytest.approx(RATE, rel=5e-3 if stamped else 3e-2)
    assert bench.blocks[-1].units[0] == "m/s^2"
    if value.shape[1] > 1:
        np.testing.assert_array_equal(value[got, 1], -value[got, 0])
    assert drivers[0].stdout is not None
    began = int(drivers[0].stdout.readline()) * 1e-9
    late = stamp - began - (index + away[0]) / RATE
    if kind == "scans":  # a message holds what was taken before it
        late += 9 / RATE
    assert (-0.02 if stamped else -0.2) < late.min() <= late.max() < (0.01 if stamped else 0.2)


@pytest.mark.slow
def test_a_driver_that_stops_is_reported_and_comes_back(bench: Bench, drivers: list["subprocess.Popen[bytes]"]) -> None:
    listen(bench, "state", silence=0.5)
    driver(drivers, "state", RATE, 0.0, 0.0, 0.0, 60.0)
    bench.until(lambda: len(bench.blocks) > 10)
    bench.events.clear()  # a driver that took long to start was reported, too
    drivers[0].kill()
    bench.until(lambda: bench.has_event("no message of type atpid_interfaces/msg/CeilingState on imu/data for 0.5 s"))
    bench.events.clear()
    driver(drivers, "state", RATE, 0.0, 0.0, 0.0, 60.0)
    bench.until(lambda: bench.has_event("streaming again"))
    blocks = len(bench.blocks)
    bench.until(lambda: len(bench.blocks) > blocks + 5)
    before, after = bench.blocks[blocks - 2], bench.blocks[-1]
    gone = (
        after.header.stamp.sec
        - before.header.stamp.sec
        + 1e-9 * (after.header.stamp.nanosec - before.header.stamp.nanosec)
    )
    assert (after.first_index - before.first_index) / after.rate == pytest.approx(gone, abs=0.5 / after.rate)
    assert after.dropped > RATE * 0.5


@pytest.mark.slow
def test_another_rate_than_stated_is_refused(bench: Bench, drivers: list["subprocess.Popen[bytes]"]) -> None:
    listen(bench, "state", rate=100.0)
    driver(drivers, "state", RATE, 0.0, 0.0, 0.0, 60.0)
    bench.until(lambda: bench.has_event("scans/s, `rate` is 100: set it within 2 %"))


@pytest.mark.parametrize(
    ("more", "reason"),
    [({"source": ""}, "give the topic of the driver"), ({"source_type": "nowhere/msg/Data"}, "is not in this shell"),
     ({"source_type": "std_msgs/msg/Header"}, "terminals: given 'height', which std_msgs/msg/Header does not have"),
     ({"units": ["m"]}, "give one of each for a channel"), ({"factors": [0.0]}, "factors not 0"),
     ({"calibrations": ["laser_beam.yaml", "x"]}, "and no calibrations")],
)  # fmt: skip
def test_what_cannot_be_listened_to_is_one_line(bench: Bench, more: dict[str, object], reason: str) -> None:
    source_type, terminals = TERMINALS["state"]
    told = {"source": "x", "source_type": source_type, "units": ["m", "m"], "factors": [1.0]} | more
    with pytest.raises(DriverError, match=reason) as caught:
        bench.start(AcquisitionNode, backend="topic", rate=10.0, channels=["a", "b"], terminals=terminals, **told)
    assert "\n" not in str(caught.value)


def test_without_calibration_or_unit_is_refused(bench: Bench) -> None:
    with pytest.raises(DriverError, match="give a file for each channel, or units and factors"):
        bench.start(AcquisitionNode, backend="simulated", rate=10.0, channels=["a"], terminals=["x"])
