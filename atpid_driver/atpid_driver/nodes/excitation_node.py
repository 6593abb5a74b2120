# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node: commands in, the exciter's output out; a lifecycle node around one `ExcitationDrive`.

configure opens the device (output off), activate lets commands switch it on, deactivate switches it off. In lockstep
each estimate is answered by one state at its stamp; in real time states go out on the node's own period, and an output
that gets no more commands ramps down. Where it is supervised there is output only while the supervisor permits motion.
"""

import sys
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from math import nan
from typing import Any

from atpid_interfaces.msg import Event, Excitation, ExcitationCommand, ExcitationState
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Header

from atpid_common.errors import InputError
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.messages import STATES, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import ExciterKind, ExciterMode, Frame, Quality
from atpid_driver import DriverError
from atpid_driver.calibration.convert import shipped_calibrations
from atpid_driver.excitation import ExcitationSettings, drive_of
from atpid_driver.excitation.drive import Output, OutputLostError
from atpid_driver.excitation.hold import Hold
from atpid_driver.excitation.signals import OFF, Command, CommandRefusedError
from atpid_driver.nodes.motor_interface import row_of
from atpid_driver.nodes.supervised_node import SupervisedNode

#: The node's parameters, as `ExcitationSettings` declares them.
TABLE = tuple(row_of(setting) for setting in fields(ExcitationSettings))
#: From the last sample to the output that follows from it, beside the window of the estimate [s].
LOOP_DELAY = 0.2


def command_of(message: ExcitationCommand) -> Command:
    """Return the command of a message. Raises CommandRefusedError for a kind that there is not."""
    try:
        kind = ExciterKind(message.kind)
    except ValueError:
        raise CommandRefusedError(f"kind: given {message.kind}; allowed: 0 to 4, see ExcitationCommand.msg") from None
    if kind is ExciterKind.OFF:
        return OFF
    return Command(kind, message.amplitude, message.frequency, message.end_frequency, message.duration,
                   message.seed, message.file, bool(message.hold), message.sequence)  # fmt: skip


class ExcitationNode(SupervisedNode):
    """Puts out what `excitation/command` asks for: see the module's text."""

    DEVICE, COMMANDS, STATE = "excitation", "excitation/command", "excitation/state"
    SILENCE = "the excitation ramps down"
    settings: ExcitationSettings

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and topics; nothing is opened. Raises `InputError` for an invalid parameter."""
        super().__init__("excitation_node", **kwargs)
        try:
            self.settings = ExcitationSettings(**declare(self, TABLE))
            self._drive = drive_of(self.settings, shipped_calibrations)
        except InputError:
            self.leave_graph()
            raise
        self._hold = Hold(self.settings.hold_tolerance, self.settings.most_correction)
        self._command, self._fault, self._measured = OFF, "", (nan, nan)
        self._estimated = 0  # stamp of the last estimate acted on [ns]
        self._output = Output(ExciterMode.UNCONFIGURED)
        self._open_topics(ExcitationCommand, ExcitationState, 1)
        subscribe(self, Excitation, "excitation", self._on_excitation, STATES)
        self._begin()

    def _configure(self) -> None:
        identity = self._drive.connect()
        self._connected, self._fault = True, ""
        self.get_logger().info(f"connected to {identity}; output off")

    def _activate(self) -> None:
        self._check_permitted()
        if self._fault:
            self._configure()  # the device was lost
        self._drive.enable()
        self._gate.armed(self._now())
        self._active, self._fault = True, ""

    def _deactivate(self) -> None:
        """Switch the output off. One that does not confirm it is inactive all the same: nothing switches it on."""
        self._active, self._command = False, OFF
        self._supervision.stale.cancel()
        try:
            self._drive.off()
        except OutputLostError as error:
            self._lost(error)
        self._publish(self._turn())

    def _release(self) -> None:
        self._active = self._connected = False
        self._drive.close()

    def _on_command(self, message: ExcitationCommand, info: dict[str, int]) -> None:
        if self._is_foreign(message.amplitude, info):
            return
        stamp = nanoseconds_of(message.header.stamp)
        self._gate.receive(stamp, info)
        try:
            command = command_of(message)
            if self._active or command is not OFF:
                self._check_command(command.kind.name, info)
                self._follow(command)
        except OutputLostError as error:
            self._lost(error)
        except DriverError as error:
            self._gate.refuse(message.sequence, message.amplitude, error)
        else:
            self._gate.accepted()
            if command is OFF:
                self._supervision.stale.cancel()  # nothing has to come any more
            else:
                self._supervision.stale.received(self.COMMANDS)

    def _follow(self, command: Command) -> None:
        self._drive.follow(command)
        if repr(command) != repr(self._command):
            self._command = command
            self._hold.reset()
            kind = command.kind.name.lower()
            of = "" if command is OFF else f" of {command.amplitude:g} at {command.frequency:g} Hz"
            self._publish_event(Event.INFO, Event.MOVED, command.amplitude, f"excitation: {kind}{of}")

    def _on_excitation(self, estimate: Excitation) -> None:
        """Take an estimate; in lockstep, answer it."""
        stamp = nanoseconds_of(estimate.header.stamp)
        if not estimate.handshake:
            usable = estimate.quality in (Quality.STEADY, Quality.TRANSIENT)
            self._measured = (estimate.amplitude, estimate.frequency) if usable else (nan, nan)
            self._correct(estimate, stamp)
        if self.settings.lockstep:
            self._stamp = stamp
            self._publish(self._turn())

    def _correct(self, estimate: Excitation, stamp: int) -> None:
        """Let the controller act on an estimate where the output is at a command that is to be held."""
        elapsed, self._estimated = (stamp - self._estimated) * 1e-9, stamp
        if not self._command.hold or self._output.mode is not ExciterMode.RUNNING or not 0.0 < elapsed < 1.0:
            return
        self._hold.turn(self._output.commanded, self._measured, elapsed, estimate.window + LOOP_DELAY)
        amplitude, frequency = self._hold.factors
        self._drive.correct(amplitude, frequency, waits=self._hold.waits)

    def _heed_permit(self) -> None:
        if self._active and not self._permit.granted and self._command is not OFF:
            severity = Event.INFO if self._permit.ending else Event.ALARM
            self._publish_event(severity, Event.SUPERVISION, nan, f"the excitation ramps down: {self._permit.reason}")
            self._halt()

    def _each_period(self) -> None:
        self._heed_permit()
        self._publish(self._turn())

    def _turn(self) -> Output:
        """Return what is put out; this keeps it alive. A device that is lost is reported, and the node inactive."""
        try:
            self._output = self._drive.turn(self._now())
        except OutputLostError as error:
            self._lost(error)
        return self._output

    def _lost(self, error: OutputLostError) -> None:
        """Latch a fault: a person has to activate the node anew."""
        self._output = Output(ExciterMode.FAULT)
        if not self._fault:
            self._fault = str(error)
            self._publish_event(Event.ALARM, Event.FAULT, nan, f"excitation: {error}")
        if self._active:
            self.trigger_deactivate()

    def _publish(self, output: Output) -> None:
        amplitude, frequency = self._measured
        mode = ExciterMode.FAULT if self._fault else output.mode
        stamp = time_of(self._stamp) if self.settings.lockstep else self.get_clock().now().to_msg()
        self._states.publish(ExcitationState(
            header=Header(stamp=stamp, frame_id=Frame.SUPPORT), mode=int(mode), fault=self._fault,
            kind=int(output.kind), sequence=output.sequence,
            held=bool(self._command.hold and mode is ExciterMode.RUNNING and self._hold.held),
            amplitude=output.amplitude, frequency=output.frequency, measured_amplitude=amplitude,
            measured_frequency=frequency, output=output.volts,
        ))  # fmt: skip

    def _halt(self) -> None:
        if self._active and self._command is not OFF:
            self._command = OFF
            self._drive.stop()

    def _off(self) -> None:
        self._drive.off()

    def _statuses(self) -> list[DiagnosticStatus]:
        output = self._output
        values = {"mode": output.mode.name.lower(), "amplitude": f"{output.amplitude:.4g}",
                  "frequency [Hz]": f"{output.frequency:.4f}", "output [V]": f"{output.volts:.3f}",
                  "error, with hold": f"{self._hold.error:.4f}"}  # fmt: skip
        wrong = self._fault or output.mode in (ExciterMode.FAULT, ExciterMode.UNCONFIGURED)
        level = DiagnosticStatus.ERROR if wrong else DiagnosticStatus.OK
        message = self._fault or output.mode.name.lower()
        return [status(self, "excitation", level, message, values), self._gate.status()]


main: Callable[[], int] = partial(run_node, ExcitationNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
