# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exciter's stops over the whole emulated stand: what the stand-in T7 puts out while a command is repeated."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest
from atpid_interfaces.msg import ExcitationCommand, ExcitationState
from graph_runs import wait_until
from motor_rigs import need_emulator
from rclpy.client import Client
from rclpy.task import Future
from spun import Spun
from std_srvs.srv import Trigger
from test_emulated_stand import Terminal
from test_graph_excitation import F, commanded
from test_graph_real_time import children

from atpid_common.nodes.messages import STATES
from atpid_common.testing import repeated_after_a_halt, wait_for
from atpid_driver.standins.device import Outputs

pytestmark = repeated_after_a_halt

#: Off after a stop, and after the silence of a process, within [s] (docs/excitation_output.md); what a busy machine and
#: the time between two looks at the voltage add.
AT_ONCE, AFTER_SILENCE, BUSY = 0.2, 0.5, 0.45
#: A smaller voltage is none [V]; the output stays off for so long [s]; a person tries again after [s].
NOTHING, WATCHED, AGAIN = 5e-3, 1.0, 3.0
STOPS = ("supervisor_node/stop", "excitation_node/stop")
SHAKES = (ExcitationState.RAMPING, ExcitationState.RUNNING)


class Operator(Spun):
    """Repeats a command, stops and arms, and looks at the device's output in every turn."""

    def __init__(self, outputs: Outputs) -> None:
        super().__init__("operator")
        self.outputs, self.state = outputs, ExcitationState()
        self.on = 0.0  # when there was an output last, steady [s]
        self.command = ExcitationCommand(kind=ExcitationCommand.SINE, amplitude=0.02, frequency=F)
        self._commands = self.node.create_publisher(ExcitationCommand, "excitation/command", 10)
        self._asked: dict[str, Client] = {}
        self.node.create_subscription(ExcitationState, "excitation/state", self._on_state, STATES)
        self.node.create_timer(0.2, self.repeat)

    def _on_state(self, state: ExcitationState) -> None:
        self.state = state

    def repeat(self) -> None:
        self.command.header.stamp = self.node.get_clock().now().to_msg()
        self._commands.publish(self.command)

    def turn(self) -> None:
        self.executor.spin_once(timeout_sec=0.002)
        if abs(self.outputs.between()) > NOTHING:
            self.on = time.monotonic()

    def watch(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.turn()

    def found(self, name: str) -> bool:
        if name not in self._asked:
            self._asked[name] = self.node.create_client(Trigger, name)
        return bool(self._asked[name].service_is_ready())

    def ask(self, name: str) -> Future:
        self.until(lambda: self.found(name))
        return self._asked[name].call_async(Trigger.Request())

    def agreed(self, name: str) -> bool:
        answer = self.ask(name)
        self.until(answer.done)
        return bool(answer.result().success)

    def arm(self) -> None:
        """Arm motor and exciter, again where a busy machine refuses or withdraws it."""
        drives = ("supervisor_node", "excitation_node")
        wait_for(lambda: all(self.agreed(f"{drive}/rearm") for drive in drives), turn=lambda: self.watch(0.3))

    def shake(self) -> None:
        """Command anew until it is put out; arm where a busy machine has stopped it."""
        self.until(lambda: all(self.found(name) for name in STOPS))  # discovery is no part of a stop
        tried = 0.0

        def put_out() -> bool:
            nonlocal tried
            if self.state.mode not in SHAKES and time.monotonic() > tried + AGAIN:
                if tried:
                    self.arm()
                self.command.sequence += 1
                self.repeat()
                tried = time.monotonic()
            return self.state.mode == ExcitationState.RUNNING and abs(self.outputs.between()) > 0.1

        self.until(put_out)

    def off_after(self, act: Callable[[], object], allowed: float) -> None:
        """Let it shake, do something, and see the output go off in time, and stay off."""
        self.shake()
        begun = self.on = time.monotonic()
        act()
        self.watch(allowed + BUSY + WATCHED)
        after = self.on - begun
        print(f"off after {after * 1e3:.0f} ms")
        assert after <= allowed + BUSY


@contextmanager
def emulated_stand(folder: Path) -> Iterator[tuple[Terminal, Operator]]:
    """Run the bench's emulated stand at a terminal, an exciter and its operator with it."""
    need_emulator()
    scene = commanded(folder, duration=900.0, steady_window=[899.0, 900.0])  # it is ended before
    # the bench takes a domain of its own, and makes its device's files in a folder of this one
    given = ["env", "-u", "ROS_DOMAIN_ID", f"TMPDIR={folder}"]
    terminal = Terminal(*given, "atpid", "bench", scene, "--out", folder / "out", "--emulated-stand")

    def printed(words: str) -> "re.Match[str] | None":
        assert terminal.end(os.WNOHANG) is None, terminal.printed
        return re.search(words, terminal.printed)

    with ExitStack() as stack, pytest.MonkeyPatch.context() as change:
        stack.callback(terminal.end)
        stack.callback(lambda: os.kill(terminal.pid, signal.SIGTERM) if terminal.end(os.WNOHANG) is None else None)
        wait_until(lambda: bool(printed(r"ROS_DOMAIN_ID=\d+") and list(folder.glob("atpid-stand-*/output"))))
        domain = printed(r"ROS_DOMAIN_ID=(\d+)")
        assert domain
        change.setenv("ROS_DOMAIN_ID", domain[1])
        (output,) = folder.glob("atpid-stand-*/output")
        yield terminal, stack.enter_context(closing(Operator(Outputs(output))))


@pytest.mark.wall_time
def test_after_a_stop_a_new_command_alone_moves_it_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    with emulated_stand(tmp_path) as (terminal, operator):
        for name in STOPS:
            operator.off_after(lambda name=name: operator.ask(name), AT_ONCE)  # type: ignore[misc]
            stopped = operator.on
            operator.arm()
            operator.watch(WATCHED)
            assert operator.on == stopped, "the command of before moves it again"
        operator.off_after(lambda: terminal.type("\x03"), AT_ONCE)
        assert terminal.end() == 130, terminal.printed


@pytest.mark.wall_time
def test_a_kill_of_its_node_ends_with_the_output_off(tmp_path: Path) -> None:
    with emulated_stand(tmp_path) as (terminal, operator):
        operator.off_after(lambda: os.kill(children(terminal.pid)["excitation_node"], signal.SIGKILL), AFTER_SILENCE)
        assert terminal.end() not in (0, 130), terminal.printed
