# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The events that have to stop the exciter, each in its ways, for `python -m studies exciter-stops`."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from atpid_interfaces.msg import CeilingState, ExcitationCommand
from std_srvs.srv import Trigger

from atpid_common.errors import InputError
from atpid_driver.standins.control import Control
from studies.stop_chain import AFTER_SILENCE, AT_ONCE, WAYS, Act, service
from studies.watched_stand import AMPLITUDES, Answer, WatchedStand

BACKENDS = ("simulated", "labjack_dac", "labjack_stream", "nidaqmx")
#: What the operator commands [m], [Hz]; a smaller one moves the ceiling. An eccentric drive has its disc's alone.
LARGE, SMALL, DISC, FREQUENCY = AMPLITUDES[1] / 2.0, AMPLITUDES[0], AMPLITUDES[1], 5.4
#: Silence of commands after which the output ramps down, a hold without estimates, and the T7's watchdog: parameters
#: of the node. The firmware's own time until it sees a fault, at most [s].
STALE, BLIND, WATCHDOG, DETECTED = 1.2, 2.0, 3.0, 0.3
#: Of the identification: two periods, which an estimate has of before [s].
WINDOW = 0.4
#: Reading of a laser that is frozen, and one below and above its range [V].
FROZEN, BELOW, ABOVE = 2.0, -10.5, 10.5
#: Of the device that is away for a moment [s], and of a recorded signal that fills the connection [samples].
_AWAY, _SAMPLES = 0.05, 100_000
#: A stand may take so long until it does what an event needs [s].
_START = 240.0
NODES = ("supervisor", "motor", "excitation", "labjack", "identifier", "selector", "recorder")
_OUTPUT, _DEVICES = "excitation_node's output process", BACKENDS[1:]


def _nothing(_stand: WatchedStand) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Case:
    """One way in which an event happens."""

    name: str
    act: Act
    allowed: float = AT_ONCE  # until the output is off [s]
    undo: Callable[[WatchedStand], object] = _nothing  # takes the cause away
    before: Callable[[WatchedStand], object] = _nothing  # while the output runs
    ends: bool = False  # the run ends with it
    hold: bool = False  # the command is held on what is measured
    backends: Sequence[str] = BACKENDS


@dataclass(frozen=True)
class Occurrence:
    """An event in each of its ways."""

    name: str
    cases: Sequence[Case]


def _output_process(stand: WatchedStand) -> int:
    node = stand.node("excitation_node")
    for task in Path(f"/proc/{node}/task").iterdir():
        for child in (task / "children").read_text().split():
            if b"outlet_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    raise InputError("the output has no process")


def _sent(number: signal.Signals, *names: str) -> Act:
    """Send a signal to nodes, the whole stand, or the output's process, all at once."""

    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        for process in [_output_process(stand) if name == _OUTPUT else stand.node(name) for name in names]:
            os.kill(process, number)
        return lambda: None

    return act


def _goes_on(name: str) -> Callable[[WatchedStand], object]:
    def undo(stand: WatchedStand) -> None:
        with suppress(InputError, ProcessLookupError):  # a process of the output was killed where it hung
            os.kill(_output_process(stand) if name == _OUTPUT else stand.node(name), signal.SIGCONT)

    return undo


def _do(work: Callable[[WatchedStand], object]) -> Act:
    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        work(stand)
        return lambda: None

    return act


def _set(*values: str) -> Callable[[WatchedStand], object]:
    """Break the emulated stand, or mend it."""
    return lambda stand: [stand.board.do(value if " " not in value else f"set {value}") for value in values]


def _laser(volts: float) -> Act:
    return _do(lambda stand: Control(stand.place / "device").hold(0, volts))


def _sees_again(stand: WatchedStand) -> None:
    Control(stand.place / "device").release(0)


def _unplugged(stand: WatchedStand) -> None:
    Control(stand.place / "exciter").unplug()


def _plugged(stand: WatchedStand) -> None:
    Control(stand.place / "exciter").replug()


def _away(stand: WatchedStand) -> None:
    """Let what is written fail for a moment."""
    _unplugged(stand)
    time.sleep(_AWAY)
    _plugged(stand)


def _moving(stand: WatchedStand) -> None:
    """Command another amplitude, and wait until the ceiling travels."""
    command(stand, SMALL)
    stand.until(
        lambda: stand.watch.ceiling.mode == CeilingState.MOVING and stand.left(stand.board.state()) > 0.1,
        _START, "the ceiling moves",
    )  # fmt: skip


def _at_rest(stand: WatchedStand) -> None:
    """Wait until the ceiling has been at rest for longer than it may coast."""
    moved = time.monotonic()

    def rests() -> bool:
        nonlocal moved
        if stand.watch.ceiling.mode != CeilingState.HOLDING:
            moved = time.monotonic()
        return time.monotonic() - moved > 2.0 * DETECTED

    stand.until(rests, _START, "the ceiling rests")


def _sent_to(stand: WatchedStand) -> None:
    """Let the output's process hang, and command what does not fit into the connection to it."""
    os.kill(_output_process(stand), signal.SIGSTOP)
    samples = np.sin(2.0 * np.pi * FREQUENCY / 2000.0 * np.arange(_SAMPLES))
    stand.watch.publish_signal("large", samples, 2000.0)
    command(stand, LARGE, kind=ExcitationCommand.RECORDED, file="large")


def _silent(stand: WatchedStand) -> None:
    stand.watch.command = None


def _way(name: str, allowed: float = AT_ONCE) -> Case:
    """Return one that stops the ceiling, too."""
    way = next(way for way in WAYS if way.name == name)
    return Case(name, way.act, allowed, way.undo, ends=way.ends)


def _motor(
    fault: str, *values: str, detected: float = DETECTED, mend: Sequence[str] = (), moving: bool = False
) -> Occurrence:
    # an eccentric drive has one amplitude, at which the ceiling stays
    backends = tuple(one for one in BACKENDS if not moving or one != "labjack_dac")
    case = Case(fault, _do(_set(*values)), AT_ONCE + detected, _set(*mend), _moving if moving else _at_rest,
                backends=backends)  # fmt: skip
    return Occurrence(f"motor fault {fault}", [case])


def _signal(number: signal.Signals, *, hangs: bool) -> list[Case]:
    # the last state of a simulated exciter may be lost with it: its plant waits for 0.2 s
    quick = {"stand"} if number == signal.SIGTERM else set()
    return [
        Case(name, _sent(number, name if name == "stand" else f"{name}_node"),
             AT_ONCE if name in quick else AFTER_SILENCE,
             _goes_on(f"{name}_node") if hangs else _nothing, ends=not hangs)
        for name in (NODES if hangs else (*NODES[:5], "stand"))  # those after the identifier end as that does
    ]  # fmt: skip


_TRIGGER = Trigger.Request()
#: Those after which the run goes on share a stand.
EVENTS = (
    Occurrence("emergency stop pressed", [Case("pressed", _do(_set("stop open")), undo=_set("stop ok"))]),
    _motor("STALL", "jam 1", mend=["jam 0"], moving=True),
    _motor("WRONG_WAY", "swapped 1", mend=["swapped 0"], moving=True),
    _motor("UNCOMMANDED", "runaway 1", mend=["runaway 0"]),
    _motor("SENSOR_LOW", "sensor open", detected=0.0, mend=["sensor ok"]),
    _motor("SENSOR_HIGH", "sensor high", detected=0.0, mend=["sensor ok"]),
    _motor("SENSOR_JUMP", "slip 50000", detected=0.0, mend=["slip 0"]),
    _motor("BOTH_LIMITS", "lower open", "upper open", detected=0.0, mend=["lower ok", "upper ok"]),
    _motor("WATCHDOG: the board hangs", "hang"),
    _motor("link lost: the board's cable is pulled", "unplug", mend=["plug"]),
    Occurrence("motor disarmed (`motor_node/stop`)", [Case("service", service(Trigger, "motor_node/stop", _TRIGGER))]),
    Occurrence("supervisor's stop (service, live page, Enter, abort level)",
        [_way(name) for name in ("service `supervisor_node/stop`", "live page: Stop", "Enter at the terminal",
                                 "abort level passed, from the first sample on")]),
    Occurrence("exciter's stop (`excitation_node/stop`)",
        [Case("service", service(Trigger, "excitation_node/stop", _TRIGGER))]),
    Occurrence("commands end", [Case("silence", _do(_silent), STALE + AFTER_SILENCE)]),
    Occurrence("SIGSTOP of a node", _signal(signal.SIGSTOP, hangs=True)),
    *(Occurrence(f"laser of the support {what}, with `hold`",
          [Case(what, _laser(volts), BLIND + WINDOW + AFTER_SILENCE, _sees_again, hold=True)])
      for what, volts in (("frozen", FROZEN), ("dead", BELOW), ("saturated", ABOVE))),
    Occurrence("device unplugged",
        [Case("unplugged", _do(_unplugged), WATCHDOG + AFTER_SILENCE, _plugged, backends=_DEVICES)]),
    Occurrence("a write fails (device away for 50 ms)",
        [Case("away", _do(_away), AFTER_SILENCE, backends=_DEVICES)]),
    Occurrence("output process hangs, alone",
        [Case("alone", _sent(signal.SIGSTOP, _OUTPUT), AFTER_SILENCE, _goes_on(_OUTPUT), backends=_DEVICES)]),
    Occurrence("output process hangs while it is sent to",
        [Case("sent to", _do(_sent_to), AFTER_SILENCE, _goes_on(_OUTPUT), backends=_DEVICES)]),
    Occurrence("output process killed",
        [Case("killed", _sent(signal.SIGKILL, _OUTPUT), AFTER_SILENCE, backends=_DEVICES)]),
    Occurrence("Ctrl-C at the terminal", [_way("Ctrl-C at the terminal")]),
    Occurrence("SIGTERM of a node, or of the stand", _signal(signal.SIGTERM, hangs=False)),
    Occurrence("SIGKILL of a node, or of the stand", _signal(signal.SIGKILL, hangs=False)),
    Occurrence("SIGKILL of excitation_node and its output process at once",
        [Case("both", _sent(signal.SIGKILL, "excitation_node", _OUTPUT), WATCHDOG + AFTER_SILENCE, ends=True,
              backends=_DEVICES)]),
)  # fmt: skip


def command(stand: WatchedStand, amplitude: float = LARGE, **values: Any) -> None:
    """Command something new, which is repeated from now on."""
    only = stand.exciter == "labjack_dac"
    values = {"kind": ExcitationCommand.SINE} | values | ({"kind": ExcitationCommand.SINE} if only else {})
    stand.watch.decide(amplitude=DISC if only else amplitude, frequency=FREQUENCY, **values)
