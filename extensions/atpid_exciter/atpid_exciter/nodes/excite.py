# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid excite SCENE`: command the exciter of nodes that run already, until Ctrl-C."""

import argparse
import hashlib
import math
import time

from atpid_interfaces.msg import ExcitationCommand, ExcitationState, SampleBlock
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.duration import Duration
from rclpy.node import Node

from atpid_common.arguments import file_path, graph_name, positive
from atpid_common.errors import DONE, InputError
from atpid_common.interrupt import Interrupt
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.handshake import Question
from atpid_common.nodes.messages import STATES, STATUS, doubles
from atpid_common.nodes.node_main import TURN, command_node
from atpid_common.vocabulary import ExciterMode, Frame
from atpid_exciter.excitation.signals import read_recorded
from atpid_sim.scene import Scene, load_scene

#: Between two commands; how long the excitation node may take to be found [s].
_EVERY, FOUND = 0.25, 10.0
#: How long the last command may take to be received [s].
_DELIVERY = 1.0
EXAMPLE = "scenes/stand_realtime.yaml --amplitude 0.01 --frequency 5.4 --hold"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, metavar="SCENE.yaml", help="scene file, for what is not given")
    add("--amplitude", type=positive("m"), metavar="A", help="of the support [m] or a force [N]; default: the scene's")
    add("--frequency", type=positive("Hz"), metavar="HZ", help="default: the scene's")
    add("--sweep", type=positive("Hz"), metavar="HZ", help="go to this frequency within --duration, and stay there")
    add("--duration", type=positive("s"), default=120.0, metavar="S", help="of a sweep; default: %(default)g s")
    add("--recorded", type=file_path, metavar="FILE", help="two columns, time [s] and value; peak --amplitude")
    add("--hold", action="store_true", help="hold amplitude and frequency on the identified excitation")
    add("--namespace", type=graph_name, metavar="NAME", help="of the nodes; default: none")


class Exciter(Node):
    """Publishes the command again and again, and prints what becomes of it."""

    def __init__(self, command: ExcitationCommand, signal: SampleBlock | None, namespace: str) -> None:
        """Begin; signal: of a recorded command."""
        super().__init__("excite", namespace=namespace)
        self._command, self._shown = command, (-1, "")
        self._commands = self.create_publisher(ExcitationCommand, "excitation/command", 10)
        subscribe(self, ExcitationState, "excitation/state", self._on_state, STATES)
        self._signals = self.create_publisher(SampleBlock, "excitation/signal", STATUS)
        if signal is not None:
            signal.header.stamp = self.get_clock().now().to_msg()
            self._signals.publish(signal)
        self._lifecycle = Question(self.create_client(GetState, "excitation_node/get_state"), self._on_lifecycle)
        self.create_timer(_EVERY, self.send)
        self.found = self.armed = False

    def send(self) -> None:
        """Publish the command now, once the exciter is armed: an older one would be void."""
        if not self.armed:
            self._lifecycle.ask(GetState.Request(), time.monotonic())
            return
        header = self._command.header
        header.stamp, header.frame_id = self.get_clock().now().to_msg(), Frame.SUPPORT
        self._commands.publish(self._command)

    def _on_lifecycle(self, answer: GetState.Response) -> None:
        self.armed = answer.current_state.id == State.PRIMARY_STATE_ACTIVE

    def end(self) -> None:
        """Command no output, and wait until it has been received."""
        self._command = ExcitationCommand(sequence=self._command.sequence + 1)
        self.send()
        self._commands.wait_for_all_acked(Duration(seconds=_DELIVERY))

    def _on_state(self, state: ExcitationState) -> None:
        self.found = True
        if (state.mode, state.fault) != self._shown:
            self._shown = state.mode, state.fault
            text = f"{ExciterMode(state.mode).name.lower()}: {state.amplitude:.4g} at {state.frequency:.4f} Hz"
            print(f"{text}{f'; {state.fault}' if state.fault else ''}", flush=True)


def command_of(args: argparse.Namespace, scene: Scene) -> ExcitationCommand:
    """Return the command of the arguments. Raises InputError where the scene has no amplitude to use."""
    amplitude = args.amplitude or scene.excitation.largest_amplitude
    if not 0.0 < amplitude < math.inf:
        raise InputError("--amplitude: given none, and the scene has none; give one")
    tone = ExcitationCommand.SWEEP if args.sweep else ExcitationCommand.SINE
    command = ExcitationCommand(sequence=int(time.time()) % 2**31, amplitude=amplitude, hold=args.hold)
    command.kind = ExcitationCommand.RECORDED if args.recorded else tone
    command.frequency, command.end_frequency = args.frequency or scene.frequency_hz, args.sweep or math.nan
    command.duration = args.duration if args.sweep else math.nan
    return command


def run(args: argparse.Namespace) -> int:
    """Command until Ctrl-C; return 0. Raises FileError, InputError: no excitation node is found, or none is armed."""
    scene, namespace = load_scene(args.scene), args.namespace or ""
    command, begin = command_of(args, scene), time.monotonic()
    signal: SampleBlock | None = None
    if args.recorded:
        (rate, values), drive = read_recorded(args.recorded), scene.driven_by
        command.file = f"{args.recorded.name} sha256:{hashlib.sha256(values.tobytes()).hexdigest()[:16]}"
        signal = SampleBlock(device=command.file, rate=rate, channels=[drive.channel], units=[drive.unit], skew=[0.0])
        signal.data = doubles(values)
    with Interrupt() as interrupt, command_node(lambda: Exciter(command, signal, namespace)) as (node, executor):
        interrupt.defer()
        while not interrupt.received and (node.armed or time.monotonic() - begin < FOUND):
            executor.spin_once(timeout_sec=TURN)
        if node.armed:
            node.end()
        if node.armed or interrupt.received:
            return DONE
    if node.found:
        raise InputError("excitation_node is not armed; call excitation_node/rearm, then give this command again")
    raise InputError(f"no excitation_node within {FOUND:g} s; is it running, in this ROS_DOMAIN_ID?")
