# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node: commands in, the exciter's output out; a lifecycle node around one `ExcitationDrive`.

configure opens the device (output off), activate arms it, deactivate switches it off: so does every stop, and only
arming and a command that is newer bring the output back. In lockstep each estimate is answered by one state at its
stamp; in real time states go out on the node's own period, and an output that gets no more commands ramps down. Where
it is supervised there is output only while the supervisor permits motion.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from math import inf, nan

import numpy as np
from atpid_interfaces.msg import Event, Excitation, ExcitationCommand, ExcitationState, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Header

from atpid_common.errors import InputError
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.messages import STATES, STATUS, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.parameters import rows_of
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import ExciterKind, ExciterMode, Frame, Quality
from atpid_driver import DriverError
from atpid_driver.calibration.model import shipped_calibrations
from atpid_driver.nodes.authority import DISCOVERY_TIME
from atpid_driver.nodes.supervised_node import SupervisedNode
from atpid_exciter.excitation import ExcitationSettings, drive_of
from atpid_exciter.excitation.drive import Output, OutputLostError
from atpid_exciter.excitation.hold import Hold
from atpid_exciter.excitation.settings import OFF, Command, CommandRefusedError

#: The node's parameters, as `ExcitationSettings` declares them.
TABLE = rows_of(ExcitationSettings)
#: From the last sample to the output that follows from it, beside the window of the estimate [s].
_LOOP_DELAY = 0.2
#: An estimate that is older shows nothing about now [s]; a hold waits for one for so many periods at least.
FRESH, PERIODS = 0.5, 5.0
ON = (ExciterMode.RAMPING, ExciterMode.RUNNING)
#: What of a command makes one decision differ from another: all but its stamp.
DECIDED = ("sequence", "kind", "hold", "amplitude", "frequency", "end_frequency", "duration", "seed", "file")


def command_of(message: ExcitationCommand) -> Command:
    """Return the command of a message. Raises CommandRefusedError for a kind that there is not."""
    try:
        kind = ExciterKind(message.kind)
    except ValueError:
        raise CommandRefusedError(f"kind: given {message.kind}; allowed: 0 to 4, see ExcitationCommand.msg") from None
    if kind is ExciterKind.OFF:
        return OFF
    same = "amplitude", "frequency", "end_frequency", "duration", "seed", "file", "sequence"
    return Command(kind, hold=bool(message.hold), **{name: getattr(message, name) for name in same})


class ExcitationNode(SupervisedNode):
    """Puts out what `excitation/command` asks for: see the module's text."""

    DEVICE, COMMANDS, STATE = "excitation", "excitation/command", "excitation/state"
    SILENCE = "the excitation ramps down"
    settings: ExcitationSettings

    def __init__(self, **kwargs: object) -> None:
        """Declare parameters and topics; nothing is opened. Raises `InputError` for an invalid parameter."""
        super().__init__("excitation_node", **kwargs)
        try:
            self.settings = ExcitationSettings(**declare(self, TABLE))
            self._drive = drive_of(self.settings, shipped_calibrations)
        except InputError:
            self.leave_graph()
            raise
        tolerance, most = self.settings.hold_tolerance, self.settings.most_correction
        self._hold = Hold(tolerance, most, fixed_amplitude=self.settings.backend == "labjack_dac")
        self._command, self._fault, self._measured = OFF, "", (nan, nan)
        self._estimated = 0  # stamp of the last estimate acted on [ns]
        # when there was a usable estimate, when one was due, and when the output was within its limits [ns]
        self._measured_at = self._seen = self._within = 0
        self._output = Output(ExciterMode.UNCONFIGURED)
        self._open_topics(ExcitationCommand, ExcitationState, 1)
        self._permit.on_state = self._heed_permit
        subscribe(self, Excitation, "excitation", self._on_excitation, STATES)
        subscribe(self, SampleBlock, "excitation/signal", self._on_signal, STATUS)
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
        self._active, self._fault, self._stopped = True, "", ""

    def _rearm(self) -> str:
        return "armed already"

    @property
    def _may_start(self) -> bool:
        """One that starts is armed only after whoever commanded before has been heard: an old command is void."""
        heard = not self.settings.supervised or time.monotonic() - self._duplicates.started > DISCOVERY_TIME
        return heard and super()._may_start

    def _deactivate(self) -> None:
        """Switch the output off. One that does not confirm it is inactive all the same: nothing switches it on."""
        self._active, self._command = False, OFF
        self._stopped = self._stopped or f"deactivated; {self.get_name()}/rearm arms it again"
        self._hold.reset()
        self._supervision.stale.cancel()
        try:
            self._drive.off()
        except OutputLostError as error:
            self._lost(error)
        self._publish(self._turn())

    def _release(self) -> None:
        self._active = self._connected = False
        self._command = OFF
        self._drive.close()

    def _on_command(self, message: ExcitationCommand, info: dict[str, int]) -> None:
        decision = repr([getattr(message, name) for name in DECIDED])
        if self._is_foreign(message.amplitude, info, decision):
            return
        self._gate.receive(nanoseconds_of(message.header.stamp), info, decision)
        try:
            command = command_of(message)
            if command is not OFF:
                self._check_command(command.kind.name, info)
            if self._active:
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
        if repr(command) == repr(self._command):
            return
        self._drive.follow(command)
        if not self._holds:  # an estimate is due once the output has risen
            rise = self.settings.rise_time * command.amplitude / self.settings.highest_amplitude
            self._seen = self._now() + round(1e9 * rise)
        self._command = command
        self._hold.reset()
        kind = command.kind.name.lower()
        of = "" if command is OFF else f" of {command.amplitude:g} at {command.frequency:g} Hz"
        self._publish_event(Event.INFO, Event.MOVED, command.amplitude, f"excitation: {kind}{of}")

    def _on_signal(self, block: SampleBlock) -> None:
        """Keep a recorded signal, which a command names by its `device`."""
        try:
            self._drive.take(block.device, np.array(block.data), block.rate)
        except DriverError as error:
            self._publish_event(Event.WARNING, Event.REFUSED, nan, f"excitation/signal {block.device}: {error}")

    def _on_excitation(self, estimate: Excitation) -> None:
        """Take an estimate; in lockstep, answer it."""
        stamp = nanoseconds_of(estimate.header.stamp)
        if not estimate.handshake:
            self._take(estimate, stamp)
        if self.settings.lockstep:
            self._stamp = stamp
            self._publish(self._turn())

    def _take(self, estimate: Excitation, stamp: int) -> None:
        """Take what is measured; let the controller act on it where the output is at a command that is to be held."""
        elapsed, self._estimated = (stamp - self._estimated) * 1e-9, stamp
        age = 0.0 if self.settings.lockstep else (self.get_clock().now().nanoseconds - stamp) * 1e-9
        usable = estimate.quality in (Quality.STEADY, Quality.TRANSIENT) and age < FRESH and elapsed > 0.0
        self._measured = (estimate.amplitude, estimate.frequency) if usable else (nan, nan)
        if usable:
            self._measured_at, self._seen = self._now(), max(self._seen, self._now())
        if not self._command.hold or self._output.mode is not ExciterMode.RUNNING or not elapsed < 1.0:
            return
        act = partial(self._hold.turn, steady=estimate.quality == Quality.STEADY, limited=self._output.limited)
        act(self._output.commanded, self._measured, elapsed, estimate.window + _LOOP_DELAY)
        amplitude, frequency = self._hold.factors
        try:
            self._drive.correct(amplitude, frequency, waits=self._hold.waits)
        except OutputLostError as error:
            self._lost(error)

    @property
    def _holds(self) -> bool:
        return self._command.hold and self._output.mode in ON

    @property
    def _fresh(self) -> bool:
        """Whether the last usable estimate is of now."""
        return self.settings.lockstep or (self._now() - self._measured_at) * 1e-9 < FRESH

    def _heed_permit(self) -> None:
        if self._active and not self._permit.granted and self._command is not OFF:
            self._stop(self._permit.reason)

    def _heed_output(self) -> None:
        """Stop an output that has ended by itself, that nothing measures any more, or that is at its limits."""
        output, now, settings = self._output, self._now(), self.settings
        blind = max(settings.hold_timeout, PERIODS / output.commanded.frequency if output.commanded.frequency else inf)
        saturated = output.mode in ON and (output.limited or self._hold.at_limit) and self._hold.misses
        self._within = self._within if saturated else now
        if not self._active:
            return
        if output.ended:
            self._stop(output.ended)
        elif self._holds and (now - self._seen) * 1e-9 > blind:
            self._stop(f"hold: no usable estimate of the excitation for {blind:.3g} s")
        elif (now - self._within) * 1e-9 > settings.saturation_time:
            self._stop(f"hold: the output is at its limits for {settings.saturation_time:g} s and misses the command")

    def _each_period(self) -> None:
        self._heed_permit()
        self._publish(self._turn())

    def _turn(self) -> Output:
        """Return what is put out; this keeps it alive. A device that is lost is reported, and the node inactive."""
        try:
            self._output = self._drive.turn(self._now())
        except OutputLostError as error:
            self._lost(error)
        else:
            self._heed_output()
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
        amplitude, frequency = self._measured if self._fresh else (nan, nan)
        mode = ExciterMode.FAULT if self._fault else output.mode
        stamp = time_of(self._stamp) if self.settings.lockstep else self.get_clock().now().to_msg()
        self._states.publish(ExcitationState(
            header=Header(stamp=stamp, frame_id=Frame.SUPPORT), mode=int(mode), fault=self._fault or self._stopped,
            kind=int(output.kind), sequence=output.sequence,
            held=mode is ExciterMode.RUNNING and self._command.hold and self._fresh and self._hold.held,
            amplitude=output.amplitude, frequency=output.frequency, measured_amplitude=amplitude,
            measured_frequency=frequency, output=output.volts,
        ))  # fmt: skip

    def _halt(self) -> None:
        self._gate.void()
        if self._active and self._command is not OFF:
            self._command = OFF
            try:
                self._drive.stop()
            except OutputLostError as error:
                self._lost(error)

    def _off(self) -> None:
        try:
            self._drive.off()
        except OutputLostError as error:
            self._lost(error)
            raise

    def _statuses(self) -> list[DiagnosticStatus]:
        output = self._output
        values = {"mode": output.mode.name.lower(), "amplitude": f"{output.amplitude:.4g}"}
        values |= {"frequency [Hz]": f"{output.frequency:.4f}", "output [V]": f"{output.volts:.3f}"}
        values["error, with hold"] = f"{self._hold.error:.4f}"
        wrong = self._fault or output.mode in (ExciterMode.FAULT, ExciterMode.UNCONFIGURED)
        level = DiagnosticStatus.ERROR if wrong else DiagnosticStatus.OK
        message = self._fault or output.mode.name.lower()
        return [status(self, "excitation", level, message, values), self._gate.commander.status()]


main: Callable[[], int] = partial(run_node, ExcitationNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
