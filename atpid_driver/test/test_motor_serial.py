# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serial backend with real pyserial and the real firmware: what it does when link, board or host fail."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from motor_rigs import arm, board, settings, wait_for

from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.emulator import Emulator
from atpid_driver.motor import session as session_module
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.errors import IdentityError, LimitsError, LinkError, StopNotConfirmedError
from atpid_driver.motor.faults import MotorFault
from atpid_driver.motor.serial_actuator import SerialActuator

pytestmark = pytest.mark.slow


class Rig:
    """The actuator and what really happens at the stand."""

    def __init__(self, folder: Path, emulator: Emulator) -> None:
        self.actuator = SerialActuator(settings(folder))
        self.emulator = emulator
        self.reports: list[str] = []

    def read(self) -> Reading:
        self.reports += self.actuator.reports()
        return self.actuator.read(time.monotonic_ns())

    def move(self, height: float) -> None:
        self.actuator.move(height, 1, time.monotonic_ns())

    def wait(self, *modes: Mode) -> None:
        wait_for(lambda: self.read().mode in modes, " or ".join(mode.name for mode in modes), state=self.describe)

    def describe(self) -> str:
        """What the actuator has reported, for a message."""
        return f"{self.read()}; {self.reports}; {self.emulator.state()}"

    def make_ready(self) -> None:
        self.actuator.connect(time.monotonic_ns())
        arm(self.actuator)

    def start_down(self) -> None:
        self.move(0.1)
        self.wait(Mode.MOVING)

    def stays_off(self, *faults: MotorFault) -> None:
        """Command fresh heights for a second, as the selector does: `faults` stay named and nothing moves."""
        wait_for(lambda: all(fault in self.read().faults for fault in faults), f"{faults} named")
        before = self.emulator.state()
        while self.emulator.state().ms < before.ms + 1000.0:
            with pytest.raises(NotReadyError, match="remove the cause, then call ~/rearm"):
                self.move(0.95)
            assert self.read().mode is Mode.FAULT
            assert all(fault in self.read().faults for fault in faults)
            time.sleep(0.05)
        after = self.emulator.state()
        assert (after.motor, after.switched, after.travel_um) == (0, before.switched, before.travel_um)

    def rearm(self) -> None:
        """Do what a person does by ~/rearm; then a height is taken up again."""
        arm(self.actuator)
        self.move(0.95)
        wait_for(lambda: self.read().target == 0.95, "a height taken up", state=self.describe)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        made = Rig(tmp_path, emulator)
        yield made
        made.actuator.close()


def stands_still(emulator: Emulator) -> bool:
    """Watch the stand for half a second of its own time."""
    before = emulator.state()
    wait_for(lambda: emulator.state().ms > before.ms + 500.0, "half a second at the stand")
    after = emulator.state()
    return after.motor == 0 and after.travel_um == before.travel_um


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


def test_a_missing_port(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="is not there: board unplugged, or wrong name"):
        SerialActuator(settings(tmp_path)).connect(0)


def test_a_port_that_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "board").write_text("not a tty")
    with pytest.raises(LinkError, match="cannot be opened"):
        SerialActuator(settings(tmp_path)).connect(0)


def test_a_port_taken_by_another_program(rig: Rig, tmp_path: Path) -> None:
    rig.make_ready()
    with pytest.raises(LinkError, match="is taken by another program: close it first"):
        SerialActuator(settings(tmp_path)).connect(0)
    assert rig.read().ready, "the first one does not notice"


def test_a_board_that_does_not_answer(tmp_path: Path) -> None:
    with board(tmp_path), pytest.raises(LinkError, match=r"nothing answers as ATPID-MOTOR within 0\.3 s"):
        SerialActuator(settings(tmp_path, identify_timeout=0.3)).connect(0)


def test_the_wrong_firmware_version(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "VERSION", "2.")
    with pytest.raises(IdentityError, match=r"firmware 1\.1\.1 with protocol 1: this driver needs 2\.x"):
        rig.actuator.connect(0)
    assert rig.read().mode is Mode.UNCONFIGURED


def test_limits_wider_than_the_firmwares(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(LimitsError, match=r"the firmware allows 0\.017 to 1 m"):
        SerialActuator(settings(tmp_path, highest=1.2)).connect(0)


def test_unplugged_in_motion_and_plugged_in_again(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.emulator.do("unplug")
    rig.wait(Mode.UNCONFIGURED)
    wait_for(lambda: rig.emulator.state().motor == 0, "the firmware's own heartbeat stop")
    truth = rig.emulator.state()
    assert truth.motor_off_ms - truth.last_byte_ms <= 500.0
    with pytest.raises(NotReadyError, match="no connection to the board"):
        rig.move(0.5)
    assert rig.read().faults == MotorFault.LINK_LOST
    rig.emulator.do("plug")
    rig.wait(Mode.FAULT)
    # on a busy machine a heartbeat is missed before the port is read
    assert any("is gone" in text or "no answer to" in text for text in rig.reports)
    assert any("found again" in text and "motor off until ~/rearm: the connection" in text for text in rig.reports)
    rig.stays_off(MotorFault.LINK_LOST, MotorFault.RESTARTED)
    rig.rearm()
    rig.wait(Mode.HOLDING)
    assert rig.read().height == pytest.approx(0.95, abs=2e-3)


def test_a_board_that_opening_does_not_restart_keeps_its_height_and_its_fault(tmp_path: Path) -> None:
    with board(tmp_path, height=0.99) as emulator:
        emulator.pace(1.0)
        rig = Rig(tmp_path, emulator)
        with closing(rig.actuator):
            rig.make_ready()
            rig.start_down()
            emulator.do("unplug")
            rig.wait(Mode.UNCONFIGURED)
            wait_for(lambda: emulator.state().motor == 0, "the firmware's own heartbeat stop")
            emulator.do("plug")
            rig.wait(Mode.FAULT)
            assert MotorFault.RESTARTED not in rig.read().faults
            rig.stays_off(MotorFault.LINK_LOST, MotorFault.HEARTBEAT)
            assert rig.read().homed
            rig.rearm()


def test_a_reset_in_motion_is_noticed_and_needs_a_person(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.emulator.do("reset")
    wait_for(lambda: rig.read().mode is Mode.FAULT and not rig.read().homed, "height lost", state=rig.describe)
    assert any("restarted" in text for text in rig.reports)
    rig.stays_off(MotorFault.RESTARTED)
    rig.rearm()


def test_a_power_cycle_in_motion(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.emulator.do("power 0")
    rig.wait(Mode.UNCONFIGURED)
    rig.emulator.do("power 1")
    rig.wait(Mode.FAULT)
    rig.stays_off(MotorFault.LINK_LOST, MotorFault.RESTARTED)


def test_a_board_lost_while_disarmed_comes_back_disarmed(rig: Rig) -> None:
    rig.make_ready()
    rig.actuator.deactivate(time.monotonic_ns())
    rig.emulator.do("unplug")
    rig.wait(Mode.UNCONFIGURED)
    rig.emulator.do("plug")
    rig.wait(Mode.DISARMED)
    assert rig.read().faults == MotorFault(0)
    with pytest.raises(NotReadyError, match="motor off; activate it"):
        rig.move(0.95)


@pytest.mark.parametrize("bootloader", [0.3, 1.6])
def test_a_hung_firmware_stays_off_until_a_person_arms_it(tmp_path: Path, bootloader: float) -> None:
    """Where the restart takes longer than a lost link is noticed, the port is opened again, which resets the board.

    That is so with the slow bootloader, and with the fast one where this machine is busy: the watchdog may then come
    too late to be named, and the restart is.
    """
    with board(tmp_path, height=0.99, bootloader=bootloader, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        rig = Rig(tmp_path, emulator)
        with closing(rig.actuator):
            rig.make_ready()
            rig.start_down()
            emulator.do("hang")
            rig.wait(Mode.FAULT)
            wait_for(lambda: rig.read().faults & (MotorFault.WATCHDOG | MotorFault.RESTARTED), "the restart named")
            rig.stays_off()
            assert rig.read().faults & (MotorFault.RESTARTED | MotorFault.LINK_LOST)
            rig.rearm()


def test_a_caller_that_hangs_lets_the_firmware_switch_off(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    wait_for(lambda: rig.emulator.state().motor == 0, "motor off although the I/O thread is alive")
    rig.read()
    wait_for(lambda: rig.read().mode is Mode.FAULT, "heartbeat fault")
    rig.stays_off(MotorFault.HEARTBEAT)
    rig.rearm()


def test_a_jam_is_not_armed_again_by_a_command(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.emulator.set("jam", 1)
    rig.wait(Mode.FAULT)
    rig.emulator.set("jam", 0)
    with pytest.raises(NotReadyError, match=r"jammed, or no motor power\); remove the cause, then call ~/rearm"):
        rig.move(0.5)
    assert stands_still(rig.emulator)
    rig.actuator.activate(time.monotonic_ns())
    rig.wait(Mode.HOLDING)
    assert rig.read().homed


def test_arming_against_an_open_sensor_is_refused(rig: Rig) -> None:
    rig.emulator.set("sensor", "open")
    rig.actuator.connect(time.monotonic_ns())
    with pytest.raises(NotReadyError, match=r"refused ARM: a fault is latched .*position sensor open"):
        rig.actuator.activate(time.monotonic_ns())
    assert stands_still(rig.emulator)


def test_a_board_that_stands_still_is_a_lost_link(rig: Rig) -> None:
    rig.make_ready()
    rig.emulator.pace(0)
    rig.wait(Mode.UNCONFIGURED)
    assert any("no answer to" in text for text in rig.reports)
    rig.emulator.pace(1.0)
    rig.wait(Mode.FAULT)
    rig.stays_off(MotorFault.LINK_LOST)
    rig.rearm()


def test_closing_disarms(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.actuator.close()
    wait_for(lambda: rig.emulator.state().motor == 0, "motor off")
    truth = rig.emulator.state()
    assert truth.motor_off_ms - truth.last_byte_ms < 50.0, "by its word, not by the heartbeat"


def test_looking_at_it_does_not_keep_it_on(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    wait_for(lambda: rig.actuator.observe(time.monotonic_ns()).mode is not Mode.MOVING, "the end of the motion")
    assert rig.actuator.observe(time.monotonic_ns()).faults == MotorFault.HEARTBEAT


def test_a_stop_without_a_line_is_not_answered_as_done(rig: Rig) -> None:
    rig.make_ready()
    rig.start_down()
    rig.emulator.do("unplug")
    with pytest.raises(StopNotConfirmedError, match="use the emergency stop"):
        rig.actuator.deactivate(time.monotonic_ns())
