# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every exciter's output promises, and what the real ones do when a process ends: by the stand-in's voltage."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from excitation_rigs import calibrate, calibrate_shaker, output_process, stand_in

from atpid_common.testing import repeated_after_a_halt, wait_for
from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import NotReadyError
from atpid_driver.acquisition.labjack import load_ljm
from atpid_driver.acquisition.protocol import StreamLostError, WrongDeviceError
from atpid_driver.standins import Control, build
from atpid_driver.standins.device import OUTPUT_HEADER, Outputs
from atpid_exciter.excitation import ExcitationSettings, drive_of, guarded
from atpid_exciter.excitation.drive import Output, OutputLostError
from atpid_exciter.excitation.outlet_process import PERIOD
from atpid_exciter.excitation.outlets import OUTLETS, T7Stream, calibration_of
from atpid_exciter.excitation.settings import OFF, Command, CommandRefusedError
from atpid_exciter.excitation.signals import Generator

pytestmark = repeated_after_a_halt

T7 = ("labjack_dac", "labjack_stream")
REAL = (*T7, "nidaqmx")
SINE = Command(ExciterKind.SINE, 0.01, 5.4, sequence=7)
#: What a busy machine may add [s], less than the watchdog's time; how long it may halt a process [s].
BUSY, PATIENT = 1.5, 2.0


class Rig:
    """One backend, and the voltage of its device."""

    def __init__(self, backend: str, folder: Path) -> None:
        self.folder, self.backend, self.level = folder, backend, backend == "labjack_dac"
        if self.level:
            calibrate(folder, "drive_frequency", "Hz", [0.0, 2.0])
        else:
            calibrate_shaker(folder)
        self.rest = 0.0 if self.level else 2.5
        self.settings = ExcitationSettings(
            backend=backend, highest_amplitude=0.01, lowest_frequency=1.0, highest_frequency=9.0, rise_time=0.3,
            frequency_rate=10.0, calibration="output.yaml", watchdog=3,
            library=str(build() / ("libnidaqmx.so" if backend == "nidaqmx" else "libLabJackM.so")),
            terminal="cDAQ1Mod1/ao0" if backend == "nidaqmx" else "DAC0",
        )  # fmt: skip
        self.drive = drive_of(self.settings, lambda: folder)
        self.outputs = Outputs(folder / "output")

    @property
    def away(self) -> float:
        """How far the voltage is from rest [V]: of a T7's stream-out that between its outputs, as a shaker has it."""
        streams = self.backend == "labjack_stream"
        return abs(self.outputs.between() if streams else self.outputs.volts(0) - self.rest)

    @property
    def at_rest(self) -> bool:
        """Whether every output of the backend has its voltage of rest, and not only what moves the exciter."""
        used = 2 if self.backend == "labjack_stream" else 1
        return all(self.outputs.volts(number) == self.rest for number in range(used))

    @property
    def header(self) -> Any:
        """What the device has in its registers; `flash`: how often something was written that outlives a reset."""
        return np.memmap(self.folder / "output", OUTPUT_HEADER, "r", shape=(1,))[0]

    def looks(self, count: int) -> float:
        """Return the largest of `count` voltages, one a millisecond [V from rest]."""
        found = 0.0
        for _ in range(count):
            found = max(found, self.away)
            time.sleep(1e-3)
        return found

    @property
    def steady(self) -> bool:
        """Whether the voltage is at rest, and not passing through."""
        return self.looks(20) < 1e-3

    def turn(self) -> Output:
        return self.drive.turn(time.monotonic_ns())

    def turn_until(self, condition: Callable[[Output], object]) -> float:
        """Take turns as the node does until something is true; return how long that took [s]."""
        return until(lambda: condition(self.turn()), 0.02)

    def comes_to(self, peak: float, command: Command = SINE) -> None:
        """Wait until the voltage has its peak, which it does not pass in some more periods."""
        largest, more = 0.0, 40
        while more:
            if self.turn().ended:  # this machine halted the test
                self.shake(command)
            largest = max(largest, self.looks(10))
            more -= largest > peak * (1.0 - 2e-3)
        assert largest == pytest.approx(peak, rel=2e-3)

    def run(self, command: Command = SINE) -> None:
        """Connect, and let it shake."""
        self.drive.connect()
        self.shake(command)

    def shake(self, command: Command = SINE) -> None:
        """Arm it as a person does, and let it shake."""
        self.arm()
        self.comes(command)

    def comes(self, command: Command = SINE) -> None:
        """Follow a command; armed again where this machine halted the test, which ends the output."""
        self.drive.follow(command)

        def runs(output: Output) -> bool:
            if output.ended:
                self.arm()
                self.drive.follow(command)
            return output.mode is ExciterMode.RUNNING and output.sequence == command.sequence

        self.turn_until(runs)

    def corrected(self, amplitude: float, frequency: float) -> Iterator[Output]:
        """Yield the outputs under a correction; made again where this machine halted the test."""
        self.drive.correct(amplitude, frequency, waits=False)
        while True:
            output = self.turn()
            if output.ended:
                self.shake()
                self.drive.correct(amplitude, frequency, waits=False)
            else:
                yield output
            time.sleep(2e-3)

    def arm(self) -> None:
        """Switch it off and let commands switch it on again."""
        self.drive.off()
        self.drive.enable()


def until(condition: Callable[[], object], period: float = 1e-3) -> float:
    begin = time.monotonic()
    wait_for(condition, turn=lambda: time.sleep(period))
    return time.monotonic() - begin


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "_ANSWER", PATIENT)
    stand_in(tmp_path, monkeypatch)


@pytest.fixture(params=["simulated", *REAL])
def rig(request: pytest.FixtureRequest, tmp_path: Path, device: None) -> Iterator[Rig]:
    made = Rig(request.param, tmp_path)
    yield made
    made.drive.close()


@pytest.fixture(params=REAL)
def real(request: pytest.FixtureRequest, tmp_path: Path, device: None) -> Iterator[Rig]:
    made = Rig(request.param, tmp_path)
    yield made
    made.drive.close()


def test_it_follows_commands_within_its_limits_and_is_off_otherwise(rig: Rig) -> None:
    """One process of the output, whose start takes longest, from its connection to its end."""
    assert rig.turn().mode is ExciterMode.UNCONFIGURED
    identity = rig.drive.connect()
    assert identity
    assert rig.backend != "nidaqmx" or re.search("no.*watchdog", identity)
    assert rig.turn().mode is ExciterMode.OFF
    with pytest.raises(NotReadyError):
        rig.drive.follow(SINE)
    rig.drive.enable()
    comes_to_the_command_and_stops(rig)
    what_is_outside_the_limits_changes_nothing(rig)
    a_correction_beyond_the_limits_is_not_put_out(rig)
    if rig.level:
        a_disc_has_one_amplitude_which_nothing_corrects(rig)
    off_is_confirmed_and_lasts_until_it_is_enabled(rig)
    rig.drive.close()
    rig.drive.close()
    assert rig.turn().mode is ExciterMode.UNCONFIGURED


def comes_to_the_command_and_stops(rig: Rig) -> None:
    for end in (rig.drive.stop, lambda: rig.drive.follow(OFF)):
        rig.comes()  # a ramp down is no stop of the node's
        output = rig.turn()
        assert (output.sequence, output.kind) == (7, ExciterKind.SINE)
        assert (output.amplitude, output.frequency) == pytest.approx((0.01, 5.4))
        end()
        rig.turn_until(lambda output: output.mode is ExciterMode.OFF)
        assert rig.turn().amplitude == 0.0


def what_is_outside_the_limits_changes_nothing(rig: Rig) -> None:
    rig.shake()
    for wrong in (Command(ExciterKind.SINE, 0.02, 5.4), Command(ExciterKind.SINE, 0.01, 10.0)):
        with pytest.raises(CommandRefusedError):
            rig.drive.follow(wrong)
    rig.turn_until(lambda output: output.mode is ExciterMode.RUNNING and output.sequence == 7)


def a_correction_beyond_the_limits_is_not_put_out(rig: Rig) -> None:
    """Whatever the factors are: the voltage, and the output that is stated."""
    low = 0.3 if rig.level else 1.0
    outputs = islice(rig.corrected(3.0, low), 10_000)
    assert any(output.limited and output.frequency == pytest.approx(low * 5.4) for output in outputs)
    for factor in (3.0, 30.0):
        for turns, output in enumerate(rig.corrected(factor, factor)):
            assert output.amplitude <= 0.01 * (1.0 + 1e-9)
            assert output.frequency <= 9.0 * (1.0 + 1e-9)
            # 9 Hz at 2 Hz/V; 0.01 m at 0.02 m/V
            assert rig.backend == "simulated" or rig.away <= (4.5 if rig.level else 0.5) + 1e-6
            assert turns < 10_000
            if turns > 100 and output.frequency > 9.0 * (1.0 - 1e-9):
                assert output.limited
                break


def a_disc_has_one_amplitude_which_nothing_corrects(rig: Rig) -> None:
    with pytest.raises(CommandRefusedError, match=r"amplitude.*0\.009.*0\.01.*disc"):
        rig.drive.follow(Command(ExciterKind.SINE, 0.009, 5.4))
    for output in islice(rig.corrected(0.5, 1.0), 100):
        assert output.amplitude == 0.01


def off_is_confirmed_and_lasts_until_it_is_enabled(rig: Rig) -> None:
    rig.drive.off()
    assert rig.turn().mode is ExciterMode.OFF
    with pytest.raises(NotReadyError):
        rig.drive.follow(SINE)
    rig.drive.enable()
    rig.comes()


def test_the_voltage_is_that_of_the_calibration_and_rests_after_silence_and_off(real: Rig) -> None:
    real.run()
    real.comes_to(2.7 if real.level else 0.5)  # 5.4 Hz at 2 Hz/V; 0.01 m at 0.02 m/V
    until(lambda: real.steady)
    # the node hung: it has ramped down, and no command brings it back until it is armed
    for again in (SINE, Command(ExciterKind.SINE, 0.01, 6.0, sequence=8)):
        real.drive.follow(again)
        real.turn_until(lambda output: "node" in output.ended)
        assert real.steady
    noise = Command(ExciterKind.RANDOM, 0.002, 2.0, 8.0, seed=1, sequence=3)
    if real.level:
        with pytest.raises(CommandRefusedError, match=r"RANDOM.*labjack_dac"):
            real.drive.follow(noise)
    else:
        noise_is_put_out_and_comes_back_by_a_command_after_silence(real, noise)
        a_recorded_signal_is_put_out_as_it_was_received_and_no_file_is_opened(real)
    real.shake()
    real.turn_until(lambda _output: real.away > 0.1)
    # signals of a terminal do not end the output before its node
    process = output_process(real.folder)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(process, number)
    for _ in range(20):
        output = real.turn()
        assert output.mode is ExciterMode.RUNNING or "node" in output.ended
        time.sleep(0.02)
    assert output_process(real.folder) == process
    real.drive.off()
    assert real.at_rest
    real.drive.close()
    assert real.at_rest


def noise_is_put_out_and_comes_back_by_a_command_after_silence(real: Rig, noise: Command) -> None:
    for _ in range(2):
        real.shake(noise)
        assert real.looks(150) > 0.05  # 0.1 V root mean square
        until(lambda: real.steady)
        real.turn_until(lambda output: output.mode is ExciterMode.OFF and output.ended)


def a_recorded_signal_is_put_out_as_it_was_received_and_no_file_is_opened(real: Rig) -> None:
    real.arm()
    with pytest.raises(CommandRefusedError, match="excitation/signal"):
        real.drive.follow(Command(ExciterKind.RECORDED, 0.01, file="/dev/zero"))
    times = np.arange(0.0, 2.0, 0.01)
    real.drive.take("walk", 5.0 + 3.0 * np.sin(2.0 * np.pi * 2.5 * times), 100.0)
    walk = Command(ExciterKind.RECORDED, 0.01, file="walk", sequence=4)
    real.shake(walk)
    real.comes_to(0.5, walk)
    with pytest.raises(CommandRefusedError, match="excitation/signal"):
        real.drive.follow(Command(ExciterKind.RECORDED, 0.01, file="another"))


@pytest.mark.timeout(120)  # one that is not noticed is waited for without end
def test_where_its_process_is_killed_or_hangs_the_node_switches_off(real: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    for how, reason in ((signal.SIGKILL, "process.*ended"), (signal.SIGSTOP, "not answer")):
        real.run()
        os.kill(output_process(real.folder), how)
        with pytest.raises(OutputLostError, match=f"{reason}.* off"):
            real.turn_until(lambda _output: False)
        assert real.at_rest
    real.run()  # and may be connected again
    if not real.level:  # which takes no samples
        a_process_that_hangs_while_it_is_sent_to_is_noticed(real, monkeypatch)
        real.run()
    a_device_that_is_away_is_switched_off_once_it_is_back(real, monkeypatch)


def a_process_that_hangs_while_it_is_sent_to_is_noticed(real: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "_ANSWER", 0.25)
    os.kill(output_process(real.folder), signal.SIGSTOP)

    def send() -> None:
        for number in range(100):  # a megabyte each
            real.drive.follow(Command(ExciterKind.RANDOM, 0.001, 2.0, 8.0, seed=number))

    with pytest.raises(OutputLostError, match=r" off$"):
        send()
    assert real.at_rest
    monkeypatch.setattr(guarded, "_ANSWER", PATIENT)


def a_device_that_is_away_is_switched_off_once_it_is_back(real: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "_RESCUE", 20.0)  # this machine may have other work
    control = Control(real.folder / "control")
    control.unplug()
    back = threading.Timer(0.3, control.replug)
    back.start()
    with pytest.raises(OutputLostError, match=r" off$"):
        real.turn_until(lambda _output: False)
    back.join()
    assert real.at_rest
    control.close()


@pytest.mark.parametrize("backend", REAL)
def test_no_voltage_leaves_the_range_of_the_calibration(backend: str, tmp_path: Path, device: None) -> None:
    made = Rig(backend, tmp_path)
    file, allowed = tmp_path / "output.yaml", [0.0, 2.6] if made.level else [2.2, 2.8]
    file.write_text(file.read_text().replace("[0.0, 5.0]", str(allowed)))
    made.drive = drive_of(made.settings, lambda: tmp_path)
    made.run()
    made.comes_to(max(abs(value - made.rest) for value in allowed))
    made.drive.close()


NODE = """
import json, sys, time
from pathlib import Path
from atpid_exciter.excitation import ExcitationSettings, drive_of
from atpid_common.vocabulary import ExciterKind
from atpid_exciter.excitation.signals import Command
drive = drive_of(ExcitationSettings(**json.loads(sys.argv[1])), lambda: Path(sys.argv[2]))
drive.connect(); drive.enable(); drive.follow(Command(ExciterKind.SINE, 0.01, 5.4))
while True:
    print(int(drive.turn(time.monotonic_ns()).mode), flush=True); time.sleep(0.02)
"""


def started(rig: Rig) -> subprocess.Popen[str]:
    """Start a process that drives the output; return it once the output runs."""
    command = [sys.executable, "-c", NODE, json.dumps(asdict(rig.settings)), str(rig.folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert any(int(line) == ExciterMode.RUNNING for line in process.stdout), "the output did not run"
    until(lambda: rig.away > 0.1)
    return process


@pytest.mark.always("the exciter's stop, by the device's voltage")
@pytest.mark.wall_time
def test_it_is_off_within_half_a_second_of_a_kill(tmp_path: Path, device: None) -> None:
    """Of a stop, of the node's silence, of a request that is confirmed, too."""
    rig = Rig("labjack_stream", tmp_path)
    rig.run()
    rig.drive.stop()
    assert rig.turn_until(lambda output: output.mode is ExciterMode.OFF) < rig.settings.stop_time + BUSY
    rig.shake()
    assert until(lambda: rig.steady) < 0.5 + BUSY  # nobody takes turns
    rig.shake()
    begin = time.monotonic()
    rig.drive.off()
    assert time.monotonic() - begin < rig.settings.stop_time + BUSY
    rig.drive.close()
    process = started(rig)
    process.kill()
    assert until(lambda: rig.steady) < 0.5 + BUSY
    process.communicate()


@pytest.mark.parametrize("backend", ["labjack_dac", "nidaqmx"])
def test_a_kill_of_the_node_ends_with_the_output_off(backend: str, tmp_path: Path, device: None) -> None:
    rig = Rig(backend, tmp_path)
    process = started(rig)
    process.kill()
    until(lambda: rig.steady and not output_process(tmp_path))
    assert not rig.header["watchdog"]  # it was no watchdog that acted: the process has disarmed it
    process.communicate()


@pytest.mark.parametrize("backend", T7)
def test_where_all_processes_are_killed_the_devices_watchdog_acts(backend: str, tmp_path: Path, device: None) -> None:
    rig = Rig(backend, tmp_path)
    process = started(rig)
    child = output_process(tmp_path)
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in (child, process.pid):
            os.kill(pid, number)
    process.communicate()
    until(lambda: rig.away == 0.0)
    until(lambda: rig.at_rest)
    assert rig.looks(500) == 0.0
    assert rig.at_rest


def test_the_watchdog_is_fed_by_its_own_process_and_by_no_other_client(tmp_path: Path, device: None) -> None:
    rig = Rig("labjack_stream", tmp_path)
    outlet = T7Stream(rig.settings, calibration_of(rig.settings, tmp_path))
    generator = Generator(rig.settings)
    outlet.open()
    generator.follow(SINE)
    end = time.monotonic() + rig.settings.watchdog + 0.3
    while (now := time.monotonic()) < end:  # take turns as the process of the output does
        outlet.put(generator, now)
        time.sleep(PERIOD)
    until(lambda: rig.away > 0.1)
    other = load_ljm(rig.settings.library)
    handle = other.openS("T7", "ANY", "ANY")

    def acted() -> bool:
        for name in ("DAC0", "WATCHDOG_ENABLE_DEFAULT"):
            other.eReadName(handle, name)
        other.eWriteName(handle, "WATCHDOG_STRICT_CLEAR", 1.0)  # another key than ours
        return rig.at_rest

    until(acted, PERIOD)
    with pytest.raises(StreamLostError, match=r"T7.*watchdog"):  # it does not run on by itself
        outlet.put(generator, time.monotonic())
    assert rig.at_rest
    outlet.close()


@pytest.mark.parametrize("backend", T7)
def test_another_t7_than_the_one_asked_for_is_left_as_it_is(backend: str, tmp_path: Path, device: None) -> None:
    rig = Rig(backend, tmp_path)
    other = load_ljm(rig.settings.library)
    handle = other.openS("T7", "ANY", "ANY")
    other.eWriteName(handle, "DAC0", 1.0)
    outlet = OUTLETS[backend](replace(rig.settings, serial=7), calibration_of(rig.settings, tmp_path))
    with pytest.raises(WrongDeviceError):
        outlet.open()
    outlet.close()
    assert (rig.outputs.volts(0), rig.header["flash"]) == (1.0, 0)


@pytest.mark.parametrize("backend", T7)
def test_flash_is_written_where_it_differs_and_follows_the_rest(backend: str, tmp_path: Path, device: None) -> None:
    rig = Rig(backend, tmp_path)
    file = tmp_path / "output.yaml"
    for rest in (rig.rest, 0.0 if rig.level else 2.437):
        file.write_text(file.read_text().replace("[-0.05, 0.02]", f"[{-0.02 * rest}, 0.02]"))
        outlet = OUTLETS[backend](rig.settings, calibration_of(rig.settings, tmp_path))
        outlet.open()
        outlet.close()
        before = rig.header["flash"]
        outlet.open()
        assert rig.header["flash"] == before + 1, "the watchdog is armed, as it was"
        outlet.open()
        assert rig.header["flash"] == before + 1, "another process takes over"
        outlet.close()
        assert rig.header["flash"] == before + 2, "the watchdog is disarmed"
    assert rig.header["power_up"].tolist() == pytest.approx([0.0, 0.0] if rig.level else [2.437, 2.437])
