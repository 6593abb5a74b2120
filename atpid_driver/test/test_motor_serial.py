# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serial backend with real pyserial and the real firmware: what it does, and when link, board or host fail."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from motor_rigs import arm, board, running_board, settings, words

from atpid_common.testing import repeated_after_a_halt, wait_for
from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.emulator import Emulator
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.faults import WORDS, LimitsError, LinkError, MotorFault, StopNotConfirmedError
from atpid_driver.motor.serial_actuator import SerialActuator

pytestmark = repeated_after_a_halt

RESOLUTION = 1.6e-3


class Rig:
    """The actuator on the steady clock, as the motor node has it, and what really happens at the stand."""

    def __init__(self, folder: Path, emulator: Emulator) -> None:
        self.actuator, self.emulator = SerialActuator(settings(folder)), emulator
        self.reports: list[str] = []

    def read(self) -> Reading:
        self.reports += self.actuator.reports()
        return self.actuator.read(time.monotonic_ns())

    def move(self, height: float, sequence: int = 1) -> None:
        self.actuator.move(height, sequence, time.monotonic_ns())

    def until(self, condition: Callable[[Reading], object], what: str) -> Reading:
        wait_for(lambda: condition(self.read()), what, state=lambda: f"{self.read()}; {self.reports}")
        return self.read()

    def wait(self, mode: Mode) -> Reading:
        return self.until(lambda reading: reading.mode is mode, mode.name)

    def make_ready(self) -> None:
        self.actuator.connect(time.monotonic_ns())
        arm(self.actuator)

    def start_down(self) -> None:
        self.make_ready()
        self.move(0.1)
        self.wait(Mode.MOVING)

    def until_off(self) -> float:
        """Wait until the motor is off, without a heartbeat; return the time since the board's last byte [ms]."""
        wait_for(lambda: self.emulator.state().motor == 0, "motor off")
        truth = self.emulator.state()
        return truth.motor_off_ms - truth.last_byte_ms

    def pause(self, milliseconds: float) -> None:
        """Let time pass at the stand, by its own clock."""
        end = self.emulator.state().ms + milliseconds
        wait_for(lambda: self.emulator.state().ms > end, "time at the stand")

    def stays_off(self, named: MotorFault) -> None:
        """Command fresh heights for a while, as the selector does: the faults stay named and nothing moves."""
        self.until(lambda reading: named in reading.faults, f"{named} named")
        before = self.emulator.state()
        for _ in range(10):
            with pytest.raises(NotReadyError, match=r"0\.95 m.*~/rearm") as refused:
                self.move(0.95)
            assert all(WORDS[fault] in str(refused.value) for fault in MotorFault if fault in named)
            reading = self.read()
            assert reading.mode is Mode.FAULT
            assert named in reading.faults
            self.pause(50.0)
        after = self.emulator.state()
        assert (after.motor, after.switched, after.travel_um) == (0, before.switched, before.travel_um)

    def rearm(self) -> None:
        """Do what a person does by ~/rearm; then a height is taken up again."""
        arm(self.actuator)
        self.move(0.95)
        self.until(lambda reading: reading.target == 0.95, "a height taken up")


@contextmanager
def rigged(folder: Path, **options: Any) -> Iterator[Rig]:
    """Run a board, and an actuator that is not connected."""
    with running_board(folder, **options) as emulator:
        rig = Rig(folder, emulator)
        with closing(rig.actuator):
            yield rig


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with rigged(tmp_path) as made:
        yield made


@pytest.fixture
def ready(rig: Rig) -> Rig:
    rig.make_ready()
    return rig


def test_a_new_height_on_the_way_turns_it_round(ready: Rig) -> None:
    start = ready.read()
    assert (start.mode, start.homed, start.faults, start.speed) == (Mode.HOLDING, True, 0, 0.3)
    assert 0.98 < start.height <= 1.0 + RESOLUTION
    ready.move(0.1, 5)
    ready.until(lambda reading: reading.height < 0.65, "under way")
    ready.move(0.68, 6)
    there = ready.until(lambda reading: reading.mode is Mode.HOLDING and reading.sequence == 6, "arrived")
    assert there.height == pytest.approx(0.68, abs=RESOLUTION)
    assert ready.reports == []


def test_the_thread_that_writes_a_stop_has_the_priority_of_its_process(rig: Rig) -> None:
    """What a process starts later does not inherit its priority, and other programs would delay a stop."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    except PermissionError:
        pytest.skip("this user may have no real-time priority")
    try:
        rig.actuator.connect(time.monotonic_ns())
        (link,) = (thread for thread in threading.enumerate() if thread.name == "ceiling motor link")
        assert link.native_id is not None
        assert os.sched_getscheduler(link.native_id) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def test_a_port_that_is_none(tmp_path: Path) -> None:
    actuator = SerialActuator(settings(tmp_path))
    with pytest.raises(LinkError, match=f"{tmp_path}/board.* there"):
        actuator.connect(0)
    (tmp_path / "board").write_text("not a tty")
    with pytest.raises(LinkError, match=f"{tmp_path}/board.* opened"):
        actuator.connect(0)


def test_a_port_taken_by_another_program_or_limits_wider_than_the_firmwares(rig: Rig, tmp_path: Path) -> None:
    wider = SerialActuator(settings(tmp_path, highest=1.2))
    with pytest.raises(LimitsError, match=r"0\.017 to 1\.2 m.* 0\.017 to 1 m"):
        wider.connect(0)
    assert wider.read(0).mode is Mode.UNCONFIGURED
    rig.make_ready()
    with pytest.raises(LinkError, match=f"{tmp_path}/board.* taken"):
        SerialActuator(settings(tmp_path)).connect(0)
    assert rig.read().ready, "the first one does not notice"


def test_a_board_that_does_not_answer(tmp_path: Path) -> None:
    with board(tmp_path), pytest.raises(LinkError, match=r"ATPID-MOTOR.* 0\.3 s"):
        SerialActuator(settings(tmp_path, identify_timeout=0.3)).connect(0)


#: What is done to the board, what that shows, how it ends, and the faults that are named until a person arms it.
INTERRUPTIONS: dict[str, tuple[str, Mode, str, MotorFault]] = {
    "cable": ("unplug", Mode.UNCONFIGURED, "plug", MotorFault.LINK_LOST | MotorFault.RESTARTED),
    "cable, no restart": ("unplug", Mode.UNCONFIGURED, "plug", MotorFault.LINK_LOST | MotorFault.HEARTBEAT),
    "power": ("power 0", Mode.UNCONFIGURED, "power 1", MotorFault.LINK_LOST | MotorFault.RESTARTED),
    "halt": ("pace 0", Mode.UNCONFIGURED, "pace 1", MotorFault.LINK_LOST),
    "reset": ("reset", Mode.FAULT, "", MotorFault.RESTARTED),
    "jam": ("set jam 1", Mode.FAULT, "set jam 0", MotorFault.STALL),
    "caller": ("", Mode.FAULT, "", MotorFault.HEARTBEAT),
}


@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_interrupted_in_motion_it_stays_off_until_a_person_arms_it(tmp_path: Path, name: str) -> None:
    """`caller`: the thread that keeps up the link lives, but nobody reads what it has read."""
    act, seen, undo, named = INTERRUPTIONS[name]
    with rigged(tmp_path, reset_on_open=name != "cable, no restart") as rig:
        rig.start_down()
        if act:
            rig.emulator.do(act)
        else:
            rig.until_off()
        reading = rig.wait(seen)
        if seen is Mode.UNCONFIGURED:
            assert reading.faults == MotorFault.LINK_LOST
            with pytest.raises(NotReadyError, match=r"0\.5 m.* connection"):
                rig.move(0.5)
        if act == "unplug":
            assert rig.until_off() <= 500.0, "by the firmware's own heartbeat"
        if undo:
            rig.emulator.do(undo)
        rig.wait(Mode.FAULT)
        rig.stays_off(named)
        if name != "halt":  # the port is opened again, which may have restarted the board
            restarted = MotorFault.RESTARTED in named
            assert (MotorFault.RESTARTED in rig.read().faults, rig.read().homed) == (restarted, not restarted)
            assert any("restarted" in words(text) for text in rig.reports) is restarted
        if seen is Mode.UNCONFIGURED:
            # on a busy machine a heartbeat is missed before the port is read
            assert any(words(text) & {"gone", "answer"} for text in rig.reports)
            assert any(
                "found" in words(text) and WORDS[MotorFault.LINK_LOST] in text and "~/rearm" in text
                for text in rig.reports
            )
        rig.rearm()
        there = rig.wait(Mode.HOLDING)
        assert there.height == pytest.approx(0.95, abs=2e-3)


@pytest.mark.parametrize("bootloader", [0.3, 1.6])
def test_a_hung_firmware_stays_off_until_a_person_arms_it(tmp_path: Path, bootloader: float) -> None:
    """Where the restart takes longer than a lost link is noticed, the port is opened again, which resets the board.

    That is so with the slow bootloader, and with the fast one where this machine is busy: the watchdog may then come
    too late to be named, and the restart is.
    """
    with rigged(tmp_path, bootloader=bootloader) as rig:
        rig.start_down()
        rig.emulator.do("hang")
        rig.wait(Mode.FAULT)
        rig.until(lambda reading: reading.faults & (MotorFault.WATCHDOG | MotorFault.RESTARTED), "the restart named")
        rig.stays_off(MotorFault(0))
        assert rig.read().faults & (MotorFault.RESTARTED | MotorFault.LINK_LOST)
        rig.rearm()


def test_a_board_lost_while_disarmed_comes_back_disarmed(rig: Rig) -> None:
    rig.make_ready()
    rig.actuator.deactivate(time.monotonic_ns())
    rig.emulator.do("unplug")
    rig.wait(Mode.UNCONFIGURED)
    rig.emulator.do("plug")
    rig.wait(Mode.DISARMED)
    assert rig.read().faults == MotorFault(0)
    with pytest.raises(NotReadyError, match=r"0\.95 m.* off"):
        rig.move(0.95)


def test_arming_against_an_open_sensor_is_refused(rig: Rig) -> None:
    rig.emulator.set("sensor", "open")
    rig.actuator.connect(time.monotonic_ns())
    with pytest.raises(NotReadyError, match=f"ARM.*{WORDS[MotorFault.SENSOR_LOW]}"):
        rig.actuator.activate(time.monotonic_ns())
    before = rig.emulator.state()
    rig.pause(500.0)
    after = rig.emulator.state()
    assert (after.motor, after.travel_um) == (0, before.travel_um)


def test_closing_disarms(rig: Rig) -> None:
    rig.start_down()
    rig.actuator.close()
    assert rig.until_off() < 50.0, "by its word, not by the heartbeat"


def test_a_stop_without_a_line_is_not_answered_as_done(rig: Rig) -> None:
    rig.start_down()
    rig.emulator.do("unplug")
    with pytest.raises(StopNotConfirmedError, match=r"0\.5 s.* emergency"):
        rig.actuator.deactivate(time.monotonic_ns())
