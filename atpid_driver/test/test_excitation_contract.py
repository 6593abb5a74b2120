# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every exciter's output promises, and what the real ones do when a process ends: by the stand-in's voltage."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import NotReadyError
from atpid_driver.acquisition.errors import StreamLostError, WrongDeviceError
from atpid_driver.acquisition.labjack import load_ljm
from atpid_driver.excitation import ExcitationDrive, ExcitationSettings, drive_of, guarded
from atpid_driver.excitation.drive import Output, OutputLostError
from atpid_driver.excitation.guarded import GuardedDrive
from atpid_driver.excitation.limits import OFF, Command, CommandRefusedError
from atpid_driver.excitation.outlet_process import PERIOD
from atpid_driver.excitation.outlets import OUTLETS, Outlet, T7Stream, calibration_of
from atpid_driver.excitation.signals import Generator
from atpid_driver.standins import Control, build
from atpid_driver.standins.build import environment
from atpid_driver.standins.outputs import HEADER, RESTART, Outputs

T7 = ("labjack_dac", "labjack_stream")
REAL = (*T7, "nidaqmx")
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
#: What a busy machine may add [s], and how long it may halt a process: the node's patience with it is a study's matter.
BUSY, PATIENT = 0.3, 2.0


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
            frequency_rate=10.0, calibration="output.yaml", watchdog=3,
            library=str(build() / ("libnidaqmx.so" if backend == "nidaqmx" else "libLabJackM.so")),
            terminal="cDAQ1Mod1/ao0" if backend == "nidaqmx" else "DAC0",
        )  # fmt: skip
        self.drive: ExcitationDrive = drive_of(self.settings, lambda: folder)
        self.outputs = Outputs(folder / "output")

    @property
    def away(self) -> float:
        """How far the voltage is from rest [V]: of a T7's stream-out that between its outputs, as a shaker has it."""
        streams = self.settings.backend == "labjack_stream"
        return abs(self.outputs.between() if streams else self.outputs.volts(0) - self.rest)

    @property
    def at_rest(self) -> bool:
        """Whether every output of the backend has its voltage of rest, and not only what moves the exciter."""
        used = 2 if self.settings.backend == "labjack_stream" else 1
        return all(self.outputs.volts(number) == self.rest for number in range(used))

    @property
    def flash_writes(self) -> int:
        """How often something was written that outlives a reset of the device."""
        return int(np.memmap(self.folder / "output", HEADER, "r", shape=(1,))["flash"][0])

    def turn_until(self, condition: Callable[[Output], object], limit: float = 20.0) -> float:
        """Take turns as the node does until something is true; return how long that took [s]."""
        begin = time.monotonic()
        while not condition(self.drive.turn(time.monotonic_ns())):
            assert time.monotonic() - begin < limit, "what was waited for did not come"
            time.sleep(0.02)
        return time.monotonic() - begin

    def run(self, command: Command = SINE) -> None:
        """Connect, and let it shake."""
        self.drive.connect()
        self.shake(command)

    def shake(self, command: Command = SINE) -> None:
        """Arm it as a person does, and let it shake; again where this machine halted the test, which ends it."""
        self.arm()
        self.drive.follow(command)

        def runs(output: Output) -> bool:
            if output.ended:
                self.arm()
                self.drive.follow(command)
            return output.mode is ExciterMode.RUNNING and output.sequence == command.sequence

        self.turn_until(runs)

    def arm(self) -> None:
        """Switch it off and let commands switch it on again."""
        self.drive.off()
        self.drive.enable()


@pytest.fixture
def libraries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(guarded, "_ANSWER", PATIENT)
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
    # the node hangs, as it did while this looked: it ramps down, and no command brings it back until it is armed
    for again in (SINE, Command(ExciterKind.SINE, 0.01, 6.0, sequence=8)):
        real.drive.follow(again)
        real.turn_until(lambda output: "no sign of the node" in output.ended)
        assert steady(real)
    real.run()
    assert until(lambda: real.away < 1e-3 and steady(real)) < 0.5 + BUSY
    noise_is_put_out_and_comes_back_by_a_command_after_silence(real)
    real.shake()
    real.turn_until(lambda _output: real.away > 0.1)
    # signals of a terminal do not end the output before its node
    assert isinstance(real.drive, GuardedDrive)
    process = real.drive._process
    assert process is not None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(process.pid, number)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    real.drive.off()
    assert real.at_rest
    real.drive.close()
    assert real.at_rest


def test_where_its_process_is_killed_or_hangs_the_node_switches_off(real: Rig) -> None:
    for how, reason in ((signal.SIGKILL, "its process has ended"), (signal.SIGSTOP, "it does not answer")):
        real.run()
        assert isinstance(real.drive, GuardedDrive)
        assert real.drive._process is not None
        os.kill(real.drive._process.pid, how)
        with pytest.raises(OutputLostError, match=f"{reason}; switched off"):
            real.turn_until(lambda _output: False)
        assert real.at_rest
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
        real.shake(noise)
        assert max(looks(real, 150)) > 0.05  # 0.1 V root mean square
        until(lambda: steady(real))
        real.turn_until(lambda output: output.mode is ExciterMode.OFF and output.ended)


def test_a_correction_beyond_the_limits_is_not_put_out(rig: Rig) -> None:
    """Whatever the factors are: the voltage, and the output that is stated."""
    rig.run()
    rig.drive.correct(3.0, 0.3 if rig.settings.backend == "labjack_dac" else 1.0, waits=False)
    rig.turn_until(lambda output: output.limited)
    slow = rig.settings.backend == "labjack_dac"
    rig.turn_until(lambda output: not slow or output.frequency == pytest.approx(1.62))
    for factor in (3.0, 30.0):
        rig.drive.correct(factor, factor, waits=False)
        output, begin = rig.drive.turn(time.monotonic_ns()), time.monotonic()
        while time.monotonic() - begin < 0.5 or output.frequency < 9.0 * (1.0 - 1e-9):
            output = rig.drive.turn(time.monotonic_ns())
            assert output.amplitude <= 0.01 * (1.0 + 1e-9)
            assert output.frequency <= 9.0 * (1.0 + 1e-9)
            if rig.settings.backend != "simulated":
                # 9 Hz at 2 Hz/V; 0.01 m at 0.02 m/V
                assert rig.away <= (4.5 if slow else 0.5) + 1e-6
            time.sleep(2e-3)
        assert output.limited


def test_a_disc_has_one_amplitude_which_nothing_corrects(tmp_path: Path, libraries: Path) -> None:
    rig = Rig("labjack_dac", tmp_path)
    rig.run()
    with pytest.raises(CommandRefusedError, match="that of the disc"):
        rig.drive.follow(Command(ExciterKind.SINE, 0.009, 5.4))
    rig.drive.correct(0.5, 1.0, waits=False)
    begin = time.monotonic()
    while time.monotonic() - begin < 0.5:
        assert rig.drive.turn(time.monotonic_ns()).amplitude == 0.01
        time.sleep(0.02)
    rig.drive.close()


def test_a_device_that_is_away_for_a_moment_is_switched_off_once_it_is_back(
    real: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guarded, "_RESCUE", 20.0)  # this machine may have other work
    real.run()
    control = Control(real.folder / "control")
    control.unplug()
    back = threading.Timer(0.3, control.replug)
    back.start()
    with pytest.raises(OutputLostError, match="switched off"):
        real.turn_until(lambda _output: False)
    back.join()
    assert real.at_rest
    control.close()


@pytest.mark.timeout(120)  # one that is not noticed is waited for without end
def test_a_process_that_hangs_while_it_is_sent_to_is_noticed(real: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    if real.settings.backend == "labjack_dac":
        return  # it takes no samples
    real.run()
    monkeypatch.setattr(guarded, "_ANSWER", 0.25)
    assert isinstance(real.drive, GuardedDrive)
    assert real.drive._process is not None
    os.kill(real.drive._process.pid, signal.SIGSTOP)
    begin = time.monotonic()

    def send() -> None:
        for number in range(1000):  # a megabyte each
            real.drive.follow(Command(ExciterKind.RANDOM, 0.001, 2.0, 8.0, seed=number))

    with pytest.raises(OutputLostError, match="switched off"):
        send()
    assert time.monotonic() - begin < 0.5 + 10 * BUSY  # the signals take their time
    assert real.at_rest


def test_a_recorded_signal_is_put_out_as_it_was_received_and_no_file_is_opened(real: Rig) -> None:
    if real.settings.backend == "labjack_dac":
        return  # it takes no samples
    real.drive.connect()
    real.drive.enable()
    with pytest.raises(CommandRefusedError, match="excitation/signal"):
        real.drive.follow(Command(ExciterKind.RECORDED, 0.01, file="/dev/zero"))
    times = np.arange(0.0, 2.0, 0.01)
    real.drive.take("walk", 5.0 + 3.0 * np.sin(2.0 * np.pi * 2.5 * times), 100.0)
    real.shake(Command(ExciterKind.RECORDED, 0.01, file="walk", sequence=4))
    begin, largest = time.monotonic(), 0.0
    while time.monotonic() - begin < 0.6:
        real.drive.turn(time.monotonic_ns())
        largest = max(largest, *looks(real, 10))
    assert largest == pytest.approx(0.5, rel=0.01)
    with pytest.raises(CommandRefusedError, match="excitation/signal"):
        real.drive.follow(Command(ExciterKind.RECORDED, 0.01, file="another"))


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
        assert "no watchdog" in real.drive.connect()
        return
    process, child = started(real)
    until(lambda: real.away > 0.1)
    for pid in (child, process.pid):
        os.kill(pid, signal.SIGSTOP)
    for pid in (child, process.pid):
        os.kill(pid, signal.SIGKILL)
    process.communicate()
    assert until(lambda: real.away == 0.0) < real.settings.watchdog + BUSY
    until(lambda: real.at_rest, RESTART + BUSY)
    assert max(looks(real, 500)) == 0.0
    assert real.at_rest


def turned(outlet: Outlet, generator: Generator, seconds: float) -> None:
    """Take turns as the process of the output does."""
    end = time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        outlet.put(generator, now)
        time.sleep(PERIOD)


def test_the_watchdog_is_fed_by_its_own_process_and_by_no_other_client(tmp_path: Path, libraries: Path) -> None:
    rig = Rig("labjack_stream", tmp_path)
    outlet = T7Stream(rig.settings, calibration_of(rig.settings, tmp_path))
    generator = Generator(rig.settings)
    outlet.open()
    generator.follow(SINE)
    turned(outlet, generator, rig.settings.watchdog + BUSY)
    until(lambda: rig.away > 0.1)
    other = load_ljm(rig.settings.library)
    handle, begin = other.openS("T7", "ANY", "ANY"), time.monotonic()
    while not rig.at_rest:
        assert time.monotonic() - begin < rig.settings.watchdog + BUSY
        for name in ("DAC0", "WATCHDOG_ENABLE_DEFAULT"):
            other.eReadName(handle, name)
        other.eWriteName(handle, "WATCHDOG_STRICT_CLEAR", 1.0)  # another key than ours
        time.sleep(PERIOD)
    assert time.monotonic() - begin > rig.settings.watchdog - BUSY
    with pytest.raises(StreamLostError, match="the T7's watchdog has acted"):  # it does not run on by itself
        outlet.put(generator, time.monotonic())
    assert rig.at_rest
    outlet.close()


@pytest.mark.parametrize("backend", T7)
def test_another_t7_than_the_one_asked_for_is_left_as_it_is(backend: str, tmp_path: Path, libraries: Path) -> None:
    rig = Rig(backend, tmp_path)
    other = load_ljm(rig.settings.library)
    handle = other.openS("T7", "ANY", "ANY")
    other.eWriteName(handle, "DAC0", 1.0)
    outlet = OUTLETS[backend](replace(rig.settings, serial=7), calibration_of(rig.settings, tmp_path))
    with pytest.raises(WrongDeviceError):
        outlet.open()
    outlet.close()
    assert (rig.outputs.volts(0), rig.flash_writes) == (1.0, 0)


@pytest.mark.parametrize("backend", T7)
def test_flash_is_written_only_where_it_differs_and_follows_the_rest(
    backend: str, tmp_path: Path, libraries: Path
) -> None:
    rig = Rig(backend, tmp_path)
    file = tmp_path / "output.yaml"
    for rest in (rig.rest, 0.0 if backend == "labjack_dac" else 2.437):
        file.write_text(file.read_text().replace("[-0.05, 0.02]", f"[{-0.02 * rest}, 0.02]"))
        outlet = OUTLETS[backend](rig.settings, calibration_of(rig.settings, tmp_path))
        outlet.open()
        outlet.close()
        before = rig.flash_writes
        outlet.open()
        assert rig.flash_writes == before + 1, "the watchdog is armed, as it was"
        outlet.open()
        assert rig.flash_writes == before + 1, "another process takes over"
        outlet.close()
        assert rig.flash_writes == before + 2, "the watchdog is disarmed"
    power_up = np.memmap(rig.folder / "output", HEADER, "r", shape=(1,))["power_up"][0]
    assert power_up.tolist() == pytest.approx([0.0, 0.0] if backend == "labjack_dac" else [2.437, 2.437])
