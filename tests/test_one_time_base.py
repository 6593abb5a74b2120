# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two devices with clocks of their own on one time base: in bags, joined channels and exports."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recorded import make

from atpid_control.analysis import frequency_response, orders
from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.recording.session import RecordingSession
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.run import Run, open_run
from atpid_control.runs.signal import clock_of, interpolated
from atpid_control.runs.topics import DEFAULT, parse
from atpid_driver.clock import DeviceClock, time_base_ns
from atpid_sim.system import Array


@dataclass(frozen=True)
class Device:
    """One device: its topic, its channels with units and skews [s], the rate it states [Hz], drift [-], delay [s]."""

    topic: str
    channels: tuple[tuple[str, str, float], ...]
    rate: float
    slow: float
    delay: float
    start: float = 0.0  # of its stream, after the begin [s]


def recorded(
    folder: Path, scene: Path, seconds: float, devices: tuple[Device, ...], value: Callable[[str, Array], Array],
    seed: int = 0,
) -> Path:  # fmt: skip
    """Record what `devices` read of the channels' values at times (n,) [s] into `folder`, in blocks of 50 ms."""
    random = np.random.default_rng(seed)
    topics = [type(topic)(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, False)]
    session = RecordingSession(folder, new_run(scene), topics, lockstep=False, offered=lambda _topic: (Qos(),))
    blocks = []
    for device in devices:
        clock, scans = DeviceClock(), round(0.05 * device.rate)
        for number in range(int((seconds - device.start) / 0.05)):
            index = number * scans + np.arange(scans)
            true = device.start + index / device.rate * (1.0 + device.slow)
            end = (index[-1] + 1) / device.rate
            arrival = device.start + end * (1.0 + device.slow) + random.exponential(device.delay)
            clock.add(end, 5000.0 + arrival)
            data = np.column_stack([value(name, true + skew) for name, _, skew in device.channels])
            message = make(
                "SampleBlock", clock.stamp_ns(index[0] / device.rate), device.topic.rpartition("/")[2],
                first_index=int(index[0]), rate=device.rate, data=np.ravel(data),
                channels=[name for name, _, _ in device.channels], units=[unit for _, unit, _ in device.channels],
                skew=np.array([skew for _, _, skew in device.channels]),
            )  # fmt: skip
            blocks.append((arrival, device.topic, message))
    for arrival, topic, message in sorted(blocks, key=lambda one: one[0]):
        session.receive(topic, message, time_base_ns() + round((5000.0 + arrival) * 1e9))
    session.close()
    return folder


SCENE = Path(__file__).parents[1] / "scenes/standard.yaml"
TAU = 2.0 * math.pi
SUPPORT, BEAM, ACCELERATION = "support_displacement", "beam_displacement", "beam_acceleration"
LASER = Device("/sensors/laser", ((SUPPORT, "m", 0.0), (BEAM, "m", 15e-6)), 1000.0, 30e-6, 3e-4)
NI = Device("/sensors/accelerometer", ((ACCELERATION, "m/s^2", 0.0),), 1280.0, -20e-6, 5e-4, 0.3)
_LINES = np.random.default_rng(5).uniform(0.0, TAU, 391)


def value(name: str, time: Array) -> Array:
    """Return lines 1 Hz apart of equal size from 10 to 400 Hz, as a displacement or an acceleration."""
    omega = TAU * np.arange(10.0, 401.0)
    size = -(omega**2) if name == ACCELERATION else np.ones(len(omega))
    return np.asarray(1e-4 * np.sin(np.outer(time, omega) + _LINES) @ size)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("two") / "bag", SCENE, 60.0, (LASER, NI), value)


@pytest.fixture(scope="module")
def run(bag: Path) -> Run:
    return open_run(bag)


def test_each_stream_has_its_rate_by_the_hosts_clock(run: Run) -> None:
    for name, device in ((SUPPORT, LASER), (ACCELERATION, NI)):
        signal = run.signal(name)
        assert signal.rate == pytest.approx(device.rate / (1.0 + device.slow), rel=1e-6)
        assert signal.clock.drift == pytest.approx(device.slow, abs=1e-6)
        assert 1e-8 < signal.clock.error < 2e-5
    assert run.signal(ACCELERATION).time0 - run.signal(SUPPORT).time0 == pytest.approx(0.3, abs=3e-5)


def test_a_response_across_two_devices_has_its_phase(run: Run) -> None:
    """Acceleration over displacement is -omega^2 at every line: within the phase's stated error, and 0.3 degrees."""
    signals, _ = signals_of(run, SUPPORT, ACCELERATION)
    assert signals.rate == run.signal(SUPPORT).rate
    found = frequency_response(signals, 0.25)
    lines = found.excited & (np.abs(found.frequency - np.rint(found.frequency)) < 0.1) & (found.frequency > 15.0)
    lines &= found.frequency < 0.4 * signals.rate
    off = found.h1[lines] / -((TAU * found.frequency[lines]) ** 2)
    assert np.abs(np.abs(off) - 1.0).max() < 2e-3
    degrees = np.degrees(np.angle(off))
    assert abs(np.interp(100.0, found.frequency[lines], degrees)) < 0.3
    assert np.all(np.abs(np.angle(off)) < 4.0 * TAU * found.frequency[lines] * signals.clock_error + 2e-3)
    assert any("devices" in line for line in found.doubts)


def test_the_skew_of_a_channel_is_taken_off(run: Run) -> None:
    signals, _ = signals_of(run, SUPPORT, BEAM)
    assert (signals.delay, signals.clock_error) == (15e-6, 0.0)
    found = frequency_response(signals, 1.0)
    inside = (found.frequency > 20.0) & (found.frequency < 390.0)
    assert np.abs(np.angle(found.h1[inside])).max() < TAU * 400.0 * 1e-6
    assert orders(signals.between(0.0, 5.0), 1).phase[0] == pytest.approx(0.0, abs=1e-2)


def test_exports_have_times_on_one_base(bag: Path, tmp_path: Path) -> None:
    assert main(["bag", "export", str(bag), "--format", "csv", "--out", str(tmp_path / "run.csv")]) == 0
    for path, device in ((tmp_path / "run.csv", LASER), (tmp_path / "run.sensors_accelerometer.csv", NI)):
        table = pd.read_csv(path, comment="#")
        time, index = table["time [s]"].to_numpy(), table["index"].to_numpy()
        true = device.start - LASER.start + index / device.rate * (1.0 + device.slow)
        assert np.ptp((time - true)[index > 20 * device.rate]) < 1e-4


def test_stamps_that_no_crystal_explains_are_left_out_of_account() -> None:
    index = np.arange(0, 60_000, 50)
    exact = clock_of(index, 10**18 + index * 1_000_000, 1000.0)
    assert (exact.rate, exact.error, exact.course) == (1000.0, 0.0, None)
    wrong = clock_of(index, 10**18 + index * 1_000_000 + (index > 30_000) * 10**10, 1000.0)
    assert wrong.rate == 1000.0
    assert math.isnan(wrong.error)


@pytest.mark.parametrize("ratio", [1.0, 1.28, 12.8])
def test_interpolation_is_band_limited_and_keeps_gaps(ratio: float) -> None:
    rate, random = 1000.0 * ratio, np.random.default_rng(3)
    time = np.arange(round(20.0 * rate)) / rate
    places = np.sort(random.uniform(100.0 * ratio, len(time) - 100.0 * ratio, 4000))
    for frequency, kept in ((3.0, 1.0), (100.0, 1.0), (400.0, 1.0), *(((600.0, 0.0),) if ratio > 1.3 else ())):
        wave = 2.0 + np.sin(TAU * frequency * time)
        found = interpolated(wave, places, ratio)
        np.testing.assert_allclose(found, 2.0 + kept * np.sin(TAU * frequency * places / rate), atol=1e-4)
    wave[5000:5003] = np.nan
    found = interpolated(wave, places, ratio)
    missing = np.isnan(found)
    assert missing[(places > 5000) & (places < 5002)].all()
    assert not missing[np.abs(places - 5001) > 40.0 * ratio].any()
