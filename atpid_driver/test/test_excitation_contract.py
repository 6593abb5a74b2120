# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every exciter's output promises, and what the real ones do when a process ends: by the stand-in's voltage."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import pytest

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import NotReadyError
from atpid_driver.excitation import ExcitationDrive, ExcitationSettings, drive_of
from atpid_driver.excitation.drive import Output, OutputLostError
from atpid_driver.excitation.guarded import GuardedDrive
from atpid_driver.excitation.signals import OFF, Command, CommandRefusedError
from atpid_driver.standins import Control, build
from atpid_driver.standins.build import environment
from atpid_driver.standins.outputs import Outputs

REAL = ("labjack_dac", "labjack_stream", "nidaqmx")
SINE = Command(ExciterKind.SINE, 0.01, 5.4, sequence=7)
CALIBRATION = """channel: {channel}
sensor: emulated
serial: none
date: 2026-11-24
source: definition
unit: {unit}
coefficients: {coefficients}
limits_volts: [0.0, 5.0]
"""
#: What a busy machine may add [s].
BUSY = 0.3


class Rig:
    """One backend, and the voltage of its device."""

    def __init__(self, backend: str, folder: Path) -> None:
        level = backend == "labjack_dac"
        (folder / "output.yaml").write_text(
            CALIBRATION.format(channel="drive_frequency", unit="Hz", coefficients="[0.0, 2.0]") if level else
            CALIBRATION.format(channel="drive_amplitude", unit="m", coefficients="[-0.05, 0.02]")
        )  # fmt: skip
        self.folder, self.rest = folder, 0.0 if level else 2.5
        self.settings = ExcitationSettings(
            backend=backend, highest_amplitude=0.01, lowest_frequency=1.0, highest_frequency=9.0, rise_time=0.3,
            frequency_rate=10.0, calibration="output.yaml", watchdog=1,
            library=str(build() / ("libnidaqmx.so" if backend == "nidaqmx" else "libLabJackM.so")),
            terminal="cDAQ1Mod1/ao0" if backend == "nidaqmx" else "DAC0",
        )  # fmt: skip
        self.drive: ExcitationDrive = drive_of(self.settings, lambda: folder)
        self.outputs = Outputs(folder / "output")

    @property
    def away(self) -> float:
        """How far the voltage is from rest [V]."""
        return abs(self.outputs.volts(0) - self.rest)

    def turn_until(self, condition: Callable[[Output], object], limit: float = 20.0) -> float:
        """Take turns as the node does until something is true; return how long that took [s]."""
        begin = time.monotonic()
        while not condition(self.drive.turn(time.monotonic_ns())):
            assert time.monotonic() - begin < limit, "what was waited for did not come"
            time.sleep(0.02)
        return time.monotonic() - begin

    def run(self) -> None:
        self.drive.connect()
        self.drive.enable()
        self.drive.follow(SINE)
        self.turn_until(lambda output: output.mode is ExciterMode.RUNNING)


@pytest.fixture
def libraries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    Control(tmp_path / "control").close()
    folder = build()
    files = {f"{name}_{what}": tmp_path / what for name in ("ljm", "daqmx") for what in ("control", "output")}
    for name, value in environment(folder, **files).items():  # type: ignore[arg-type]
        monkeypatch.setenv(name, value)
    return folder


@pytest.fixture(params=["simulated", *REAL])
def rig(request: pytest.FixtureRequest, tmp_path: Path, libraries: Path) -> Iterator[Rig]:
    made = Rig(request.param, tmp_path)
    yield made
    made.drive.close()


@pytest.fixture(params=REAL)
def real(request: pytest.FixtureRequest, tmp_path: Path, libraries: Path) -> Iterator[Rig]:
    made = Rig(request.param, tmp_path)
    yield made
    made.drive.close()


def test_it_follows_commands_within_its_limits_and_is_off_otherwise(rig: Rig) -> None:
    """One process of the output, whose start takes longest, from its connection to its end."""
    assert rig.drive.turn(time.monotonic_ns()).mode is ExciterMode.UNCONFIGURED
    assert rig.drive.connect()
    assert rig.drive.turn(time.monotonic_ns()).mode is ExciterMode.OFF
    with pytest.raises(NotReadyError):
        rig.drive.follow(SINE)
    rig.drive.enable()
    rig.turn_until(lambda output: output.mode is ExciterMode.OFF)
    comes_to_the_command_and_stops_within_its_time(rig)
    what_is_outside_the_limits_changes_nothing(rig)
    off_is_confirmed_and_lasts_until_it_is_enabled(rig)
    rig.drive.close()
    rig.drive.close()
    assert rig.drive.turn(time.monotonic_ns()).mode is ExciterMode.UNCONFIGURED


def comes_to_the_command_and_stops_within_its_time(rig: Rig) -> None:
    rig.drive.follow(SINE)
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING)
    output = rig.drive.turn(time.monotonic_ns())
    assert (output.sequence, output.kind) == (7, ExciterKind.SINE)
    assert output.amplitude == pytest.approx(0.01)
    assert output.frequency == pytest.approx(5.4)
    rig.drive.stop()
    assert rig.turn_until(lambda output: output.mode is ExciterMode.OFF) < rig.settings.stop_time + BUSY
    assert rig.drive.turn(time.monotonic_ns()).amplitude == 0.0
    rig.drive.follow(SINE)  # a ramp down is no stop of the node's
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING)
    rig.drive.follow(OFF)
    rig.turn_until(lambda output: output.mode is ExciterMode.OFF)


def what_is_outside_the_limits_changes_nothing(rig: Rig) -> None:
    rig.drive.follow(SINE)
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING)
    for wrong in (Command(ExciterKind.SINE, 0.02, 5.4), Command(ExciterKind.SINE, 0.01, 10.0)):
        with pytest.raises(CommandRefusedError):
            rig.drive.follow(wrong)
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING and output.sequence == 7)


def off_is_confirmed_and_lasts_until_it_is_enabled(rig: Rig) -> None:
    begin = time.monotonic()
    rig.drive.off()
    assert time.monotonic() - begin < 0.2 + BUSY
    assert rig.drive.turn(time.monotonic_ns()).mode is ExciterMode.OFF
    with pytest.raises(NotReadyError):
        rig.drive.follow(SINE)
    rig.drive.enable()
    rig.drive.follow(SINE)
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING)


def test_the_voltage_is_that_of_the_calibration_and_rests_after_silence_and_off(real: Rig) -> None:
    real.run()
    largest = max(looks(real, 400))
    # 5.4 Hz at 2 Hz/V; 0.01 m at 0.02 m/V
    assert largest == pytest.approx(2.7 if real.rest == 0.0 else 0.5, rel=2e-3)
    # the node hangs: it ramps down, and comes back by a command only
    real.drive.follow(SINE)  # it was silent for longer than it may
    real.turn_until(lambda output: output.mode is ExciterMode.RUNNING and real.away > 0.1)
    assert until(lambda: real.away < 1e-3 and steady(real)) < 0.5 + BUSY
    real.turn_until(lambda output: output.mode is ExciterMode.OFF)
    assert real.away < 1e-3
    noise_is_put_out_and_comes_back_by_a_command_after_silence(real)
    real.drive.follow(SINE)
    real.turn_until(lambda output: output.mode is ExciterMode.RUNNING and real.away > 0.1)
    # signals of a terminal do not end the output before its node
    assert isinstance(real.drive, GuardedDrive)
    process = real.drive._process
    assert process is not None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(process.pid, number)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    real.drive.off()
    assert real.away == 0.0
    real.drive.close()
    assert real.away == 0.0


def test_where_its_process_is_killed_or_hangs_the_node_switches_off(real: Rig) -> None:
    for how in (signal.SIGKILL, signal.SIGSTOP):
        real.run()
        assert isinstance(real.drive, GuardedDrive)
        assert real.drive._process is not None
        os.kill(real.drive._process.pid, how)
        with pytest.raises(OutputLostError, match="switched off"):
            real.turn_until(lambda _output: False)
        assert real.away == 0.0
    real.run()  # and may be connected again


@pytest.mark.parametrize("backend", REAL)
def test_no_voltage_leaves_the_range_of_the_calibration(backend: str, tmp_path: Path, libraries: Path) -> None:
    made = Rig(backend, tmp_path)
    file, allowed = tmp_path / "output.yaml", [0.0, 2.6] if made.rest == 0.0 else [2.2, 2.8]
    file.write_text(file.read_text().replace("[0.0, 5.0]", str(allowed)))
    made.drive = drive_of(made.settings, lambda: tmp_path)
    made.run()
    largest = max(looks(made, 400))
    made.drive.close()
    assert largest == pytest.approx(max(abs(value - made.rest) for value in allowed), rel=2e-3)


def noise_is_put_out_and_comes_back_by_a_command_after_silence(real: Rig) -> None:
    noise = Command(ExciterKind.RANDOM, 0.002, 2.0, 8.0, seed=1, sequence=3)
    if real.settings.backend == "labjack_dac":
        with pytest.raises(CommandRefusedError, match="given RANDOM; backend labjack_dac"):
            real.drive.follow(noise)
        return
    for _ in range(2):
        real.drive.follow(noise)
        real.turn_until(lambda output: output.mode is ExciterMode.RUNNING and output.sequence == 3)
        assert max(looks(real, 150)) > 0.05  # 0.1 V root mean square
        until(lambda: steady(real))
        real.turn_until(lambda output: output.mode is ExciterMode.OFF)


NODE = """
import json, sys, time
from pathlib import Path
from atpid_driver.excitation import ExcitationSettings, drive_of
from atpid_common.vocabulary import ExciterKind
from atpid_driver.excitation.signals import Command
drive = drive_of(ExcitationSettings(**json.loads(sys.argv[1])), lambda: Path(sys.argv[2]))
drive.connect(); drive.enable(); drive.follow(Command(ExciterKind.SINE, 0.01, 5.4))
while True:
    print(int(drive.turn(time.monotonic_ns()).mode), drive._process.pid, flush=True); time.sleep(0.02)
"""


def started(rig: Rig) -> tuple[subprocess.Popen[str], int]:
    """Start a process that drives the output; return it once the output runs, with the process of the output."""
    command = [sys.executable, "-c", NODE, json.dumps(asdict(rig.settings)), str(rig.folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        mode, child = map(int, line.split())
        if mode == ExciterMode.RUNNING:
            return process, child
    raise AssertionError("the output did not run")


def looks(rig: Rig, count: int) -> list[float]:
    """Return how far the voltage is from rest [V], `count` times, one a millisecond."""
    found = []
    for _ in range(count):
        found.append(rig.away)
        time.sleep(1e-3)
    return found


def until(condition: Callable[[], object], limit: float = 20.0) -> float:
    begin = time.monotonic()
    while not condition():
        assert time.monotonic() - begin < limit, "what was waited for did not come"
        time.sleep(1e-3)
    return time.monotonic() - begin


def steady(rig: Rig) -> bool:
    """Whether the voltage is at rest, and not passing through."""
    return max(looks(rig, 20)) < 1e-3


def test_it_is_off_within_half_a_second_of_a_kill(real: Rig) -> None:
    process, _ = started(real)
    until(lambda: real.away > 0.1)
    process.kill()
    assert until(lambda: steady(real)) < 0.5 + BUSY
    process.communicate()


def test_where_all_processes_are_killed_the_devices_watchdog_acts(real: Rig) -> None:
    if real.settings.backend == "nidaqmx":
        return  # it has none, which the page says
    process, child = started(real)
    until(lambda: real.away > 0.1)
    for pid in (child, process.pid):
        os.kill(pid, signal.SIGSTOP)
    for pid in (child, process.pid):
        os.kill(pid, signal.SIGKILL)
    process.communicate()
    stuck = real.outputs.volts(0)
    took = until(lambda: real.outputs.volts(0) in (0.0, real.rest) and real.outputs.volts(0) != stuck)
    assert took < 1.0 + BUSY
