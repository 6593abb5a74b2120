# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole emulated stand at a terminal of its own, with its board, its line and its operator beside it.

The nodes are those of `bench --emulated-stand --live`, run by the same function in a process at a pty. The firmware's
board and its serial line are this process's: they are hardware, which no other program delays, and can be asked.
"""

import asyncio
import itertools
import json
import os
import pty
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from atpid_interfaces.msg import CeilingState, Event, ExcitationCommand, ExcitationState, SampleBlock, SupervisorState
from lifecycle_msgs.srv import ChangeState
from numpy.typing import NDArray
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from tornado.websocket import websocket_connect

from atpid_common.cli import Parser, run_parsed
from atpid_common.errors import DONE
from atpid_common.nodes.messages import BLOCKS, EVENTS_KEPT, STATES, STATUS, doubles
from atpid_common.nodes.node_main import command_node
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.emulated import commands_emulated, emulator_command, parameters_emulated
from atpid_control.stand.errors import BenchError
from atpid_control.stand.nodes.composition import QUIET
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import LIVE
from atpid_control.stand.processes import stoppable
from atpid_control.stand.running import commands_of, run_realtime
from atpid_driver.emulator.emulator import StandState
from atpid_sim.scene import load_scene
from studies.emulated_board import EmulatedBoard

#: The excitation changes between two amplitudes [m] that often [s]; the best heights are 0.7 m apart.
AMPLITUDES, EVERY, CHANGE = (0.006, 0.045), 4.0, 0.2
DURATION = 900.0
SCENE: dict[str, Any] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "ceiling": {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"},
    "gravity": 9.81,
    "duration": DURATION,
    "tolerance": 1e-6,
    "sensors": {"laser": {"rate": 1000.0, "noise": 20e-6}},
    "seed": 1,
}
#: What an exciter's device puts out, for the plant.
_DEVICE = "emulated/excitation/state"
#: Between two commands of an excitation [s].
_COMMANDS = 0.2
#: Of a temperature, which no device here measures: its abort level can be passed at any time [degC].
COLD, HOT, ABORT = 20.0, 90.0, 60.0
#: A stop comes after so much of a travel [m], with at least so much of it left: none ends by itself meanwhile.
MADE, LEFT = 0.05, 0.2
#: How long a stand may take until its ceiling moves, and what a killed one leaves to end [s].
_START, _END = 240.0, 20.0
#: In these the motor is off; a stand that starts arms it by itself, later a person does, after [s].
_OFF, _PATIENCE = (CeilingState.UNCONFIGURED, CeilingState.DISARMED), 1.0
#: Services by which the ceiling is stopped, and what the study needs beside them.
SERVICES = {
    "motor_node/stop": Trigger,
    "motor_node/change_state": ChangeState,
    "supervisor_node/stop": Trigger,
    "supervisor_node/rearm": Trigger,
    "labjack_node/change_state": ChangeState,
}
#: What an operator is told: success or not, and in which words.
Answer = tuple[bool, str]


class Terminal:
    """A command at a terminal of its own: what is typed reaches it, what it prints is kept."""

    def __init__(self, *words: object) -> None:
        """Start a program with its arguments."""
        self.pid, self._file = pty.fork()
        if self.pid == 0:
            os.execvp(str(words[0]), list(map(str, words)))  # noqa: S606  # the child of the fork above
        self.printed = ""
        self.status: int | None = None
        self._reader = threading.Thread(target=self._read, name="reader")
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._file, 4096)
            except OSError:  # the command has ended
                return
            self.printed += data.decode(errors="replace")

    def type(self, text: str) -> None:
        """Type a text."""
        os.write(self._file, text.encode())

    def poll(self) -> int | None:
        """Return the exit status; None while it runs."""
        if self.status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._ended(status)
        return self.status

    def end(self) -> int:
        """Wait for its end; return the exit status."""
        if self.status is None:
            self._ended(os.waitpid(self.pid, 0)[1])
        assert self.status is not None
        return self.status

    def _ended(self, status: int) -> None:
        self.status = os.waitstatus_to_exitcode(status)
        self._reader.join()
        os.close(self._file)


class Page:
    """A browser's connection to the live page."""

    def __init__(self, port: int) -> None:
        """Open the page."""
        self._answers: dict[int, Answer] = {}
        self._number = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="page", daemon=True)
        self._thread.start()
        self._stream = self._do(lambda: websocket_connect(f"ws://127.0.0.1:{port}/stream"))
        self._reading = asyncio.run_coroutine_threadsafe(self._read(), self._loop)

    def ask(self, **request: Any) -> Callable[[], Answer | None]:
        """Ask; return a function that returns the answer once it is there."""
        self._number += 1
        number = self._number
        self._do(lambda: self._stream.write_message(json.dumps({"number": number, **request})))
        return lambda: self._answers.get(number)

    def close(self) -> None:
        """Leave the page."""
        self._reading.cancel()
        self._loop.call_soon_threadsafe(self._stream.close)
        self._do(lambda: asyncio.sleep(0.05))  # in which what reads it ends
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _do(self, work: Callable[[], Any]) -> Any:
        async def done() -> Any:
            return await work()

        return asyncio.run_coroutine_threadsafe(done(), self._loop).result(10.0)

    async def _read(self) -> None:
        while (text := await self._stream.read_message()) is not None:
            message = json.loads(text)
            if message["type"] == "answer":
                self._answers[message["number"]] = message["success"], message["text"]


class Watch(Node):
    """Follows the ceiling, the supervisor and the events, and calls services."""

    def __init__(self) -> None:
        """Subscribe."""
        super().__init__("study_watch")
        self.ceiling, self.supervisor, self.exciter = CeilingState(), SupervisorState(), ExcitationState()
        self.events: list[Event] = []
        self.create_subscription(CeilingState, "ceiling/state", self._on_ceiling, STATES)
        self.create_subscription(SupervisorState, "supervisor/state", self._on_supervisor, STATES)
        self.create_subscription(Event, "events", self.events.append, EVENTS_KEPT)
        self.create_subscription(ExcitationState, "excitation/state", self._on_exciter, STATES)
        self._commands = self.create_publisher(ExcitationCommand, "excitation/command", 10)
        self._signals = self.create_publisher(SampleBlock, "excitation/signal", STATUS)
        self.command: ExcitationCommand | None = None  # that is repeated
        self._decisions = itertools.count(1)
        self.create_timer(_COMMANDS, self._excite)
        self._blocks = self.create_publisher(SampleBlock, "sensors/accelerometer", BLOCKS)
        self._asked: dict[str, Client] = {}

    def _on_ceiling(self, state: CeilingState) -> None:
        self.ceiling = state

    def _on_exciter(self, state: ExcitationState) -> None:
        self.exciter = state

    def decide(self, **values: Any) -> None:
        """Command the exciter something new, and repeat it."""
        self.command = ExcitationCommand(sequence=next(self._decisions), **values)
        self._excite()

    def publish_signal(self, name: str, samples: NDArray[np.float64], rate: float) -> None:
        """Publish a signal (n,) for `RECORDED` commands."""
        block = SampleBlock(device=name, rate=rate, channels=["signal"], units=["m"], skew=[0.0])
        block.data = doubles(samples)
        self._signals.publish(block)

    def _excite(self) -> None:
        if self.command is not None:
            self.command.header.stamp = self.get_clock().now().to_msg()
            self._commands.publish(self.command)

    def _on_supervisor(self, state: SupervisorState) -> None:
        self.supervisor = state

    def client(self, kind: Any, name: str) -> Client:
        """Return the client of a service."""
        if name not in self._asked:
            self._asked[name] = self.create_client(kind, name)
        return self._asked[name]

    def measure_temperature(self, celsius: float) -> None:
        """Publish a block of a temperature [degC], as an acquisition node does."""
        block = SampleBlock(rate=100.0, channels=["temperature"], units=["degC"], skew=[0.0])
        block.header.stamp, block.data = self.get_clock().now().to_msg(), doubles([celsius] * 5)  # type: ignore[arg-type]
        self._blocks.publish(block)


class WatchedStand:
    """The stand, its board, its line and its operator."""

    def __init__(self, folder: Path, place: Path, board: EmulatedBoard, exciter: str = "") -> None:
        """Use `watched_stand`."""
        self.board, self.exciter = board, exciter
        self.place, self.port = place, _free_port()
        self.terminal = Terminal(sys.executable, "-m", "studies.watched_stand", folder, place, self.port,
                                 *([exciter] if exciter else []))  # fmt: skip
        self._page: Page | None = None
        self._begun = self._met = False
        self._processes: set[int] = set()
        self.watch: Watch
        self.executor: SingleThreadedExecutor

    @property
    def page(self) -> Page:
        """The live page."""
        assert self._page is not None, "opened once the ceiling moves"
        return self._page

    def spin(self) -> None:
        """Take what has come; wait for 5 ms at most."""
        self.executor.spin_once(timeout_sec=0.005)

    def until(self, happened: Callable[[], object], timeout: float, what: str) -> None:
        """Wait for an event of a stand that runs; raise BenchError where it does not come."""
        deadline = time.monotonic() + timeout
        while not happened():
            if self.terminal.poll() is not None or time.monotonic() > deadline:
                printed = " / ".join(self.terminal.printed.splitlines()[-6:])
                raise BenchError(f"the emulated stand: {what}: not within {timeout:g} s; {self._seen()}; {printed}")
            self.spin()

    def _seen(self) -> str:
        texts = [event.text for event in self.watch.events[-3:]]
        return f"mode {self.watch.ceiling.mode}, {self.watch.supervisor.reason!r}, {texts}"

    def node(self, name: str) -> int:
        """Return the process of a node, or of the whole `stand`."""
        if name == "stand":
            return self.terminal.pid
        for child in self._children():
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            if any(word.endswith(f"/{name}".encode()) for word in words):
                return child
        raise BenchError(f"the emulated stand: {name} does not run")

    def _children(self) -> set[int]:
        tasks = Path(f"/proc/{self.terminal.pid}/task").iterdir()
        return {int(child) for task in tasks for child in (task / "children").read_text().split()}

    def call(self, kind: Any, name: str, request: Any) -> Callable[[], Answer | None]:
        """Call a service; return a function that returns the answer once it is there."""
        client = self.watch.client(kind, name)
        self.until(client.service_is_ready, _START, f"service {name}")  # discovery is no part of a stop
        future = client.call_async(request)

        def answered() -> Answer | None:
            if not future.done():
                return None
            result = future.result()
            return bool(result.success), str(getattr(result, "message", ""))

        return answered

    def move(self) -> StandState:
        """Arm where that is needed, and wait until the ceiling is in the middle of a travel; return the board then."""
        begin: tuple[int, float] | None = None  # of a travel: switchings and height [um]
        armed, travels = time.monotonic(), False

        def in_the_middle() -> bool:
            nonlocal armed, begin, travels
            mode, now = self.watch.ceiling.mode, self.board.state()
            off = mode == CeilingState.FAULT or (self._begun and mode in _OFF)
            if off and time.monotonic() - armed > _PATIENCE:
                self.arm()
                armed = time.monotonic()
            if not now.motor or mode != CeilingState.MOVING or not self.ready:
                begin = None
            elif begin is None or begin[0] != now.switched:
                begin = now.switched, now.height_um
            elif abs(now.height_um - begin[1]) >= MADE * 1e6:
                travels = self.left(now) >= LEFT
            return travels

        self.until(in_the_middle, _START, "the ceiling moves")
        if not self._met:
            self.meet()
            return self.move()
        self.remember()
        return self.board.state()

    def remember(self) -> None:
        """Remember the processes that there are, whose end is waited for."""
        self._processes |= self._children()

    def meet(self) -> None:
        """Open the page and find the services: neither is a part of a stop."""
        self._met = True
        self._page = Page(self.port)
        for name, kind in SERVICES.items():
            self.until(self.watch.client(kind, name).service_is_ready, _START, f"service {name}")

    @property
    def ready(self) -> bool:
        """Whether the loop has begun, and all nodes answer."""
        self._begun = self._begun or any(event.text == "loop check passed" for event in self.watch.events)
        return self._begun and self.watch.supervisor.state in (SupervisorState.READY, SupervisorState.SAFE)

    def left(self, now: StandState) -> float:
        """Return how far the ceiling is from where it is to go [m]."""
        return abs(now.height_um * 1e-6 - float(self.watch.ceiling.target))

    def arm(self) -> None:
        """Arm as a person does; a busy machine may refuse, or withdraw it."""
        drives = ["supervisor_node"] + (["excitation_node"] if self.exciter else [])
        for drive in drives:
            answer = self.call(Trigger, f"{drive}/rearm", Trigger.Request())
            self.until(lambda answer=answer: answer() is not None, 10.0, f"an answer to {drive}/rearm")  # type: ignore[misc]

    def close(self) -> None:
        """End it."""
        if self._page is not None:
            with suppress(Exception):  # the node that served it may have been killed
                self._page.close()
        if self.terminal.poll() is None:
            os.kill(self.terminal.pid, signal.SIGTERM)
            self.terminal.end()
        deadline = time.monotonic() + _END  # those of a stand that was killed end by themselves
        while any(Path(f"/proc/{process}").exists() for process in self._processes) and time.monotonic() < deadline:
            time.sleep(0.05)


@contextmanager
def watched_stand(late: float = 0.0, *, exciter: str = "") -> Iterator[WatchedStand]:
    """Start a stand in a domain of its own, whose board's answers are `late` [s]; it ends with the context.

    exciter: backend of what shakes it, commanded by `Watch.decide`; empty: the scene's excitation does.
    """
    with ExitStack() as stack:
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="atpid-study-", ignore_cleanup_errors=True))
        )
        place = folder / "place"
        place.mkdir()
        (folder / "scene.yaml").write_text(
            yaml.safe_dump(SCENE | {"excitation": excitation(commanded=bool(exciter))}), encoding="utf-8"
        )
        faults = ("--fault", f"serial_link delayed 0 {DURATION:g} {late:g}") if late else ()
        command = emulator_command(load_scene(folder / "scene.yaml"), place, "--height", "0.3", *faults)
        stack.enter_context(own_domain())
        board = EmulatedBoard(command, folder / "emulator.log")
        stack.callback(board.close)
        stand = WatchedStand(folder, place, board, exciter)
        stack.callback(stand.close)
        stand.watch, stand.executor = stack.enter_context(command_node(Watch, *QUIET))
        yield stand


def excitation(*, commanded: bool = False) -> dict[str, Any]:
    """Return an excitation at resonance whose amplitude changes again and again, or one that is commanded."""
    if commanded:
        return {"commanded": True, "amplitude": AMPLITUDES[1], "frequency": "resonance"}
    amplitude = [[0.0, AMPLITUDES[0]]]
    for turn in range(1, int(DURATION / EVERY)):
        before, after = AMPLITUDES[(turn - 1) % 2], AMPLITUDES[turn % 2]
        amplitude += [[turn * EVERY, before], [turn * EVERY + CHANGE, after]]
    return {"amplitude": amplitude, "frequency": "resonance"}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _run(folder: Path, place: Path, port: int, exciter: str) -> int:
    """Run the nodes until Ctrl-C, as `bench --emulated-stand --live` does, but for the board."""
    file = folder / "scene.yaml"
    scene = load_scene(file)
    given = {"excitation_node": {"backend": exciter}} if exciter in ("labjack_dac", "nidaqmx") else {}
    parameters = parameters_emulated(scene, file, map_for(scene), folder / "bag", place, board=True, given=given)
    parameters["supervisor_node"] |= {"temperature_abort": ABORT}
    parameters["live_node"] = LIVE.configured() | {"host": "127.0.0.1", "port": port, "scene": str(file)}
    if exciter == "simulated":
        parameters["excitation_node"] |= {"backend": exciter, "calibration": ""}
        parameters["feed_node"]["output"] = ""
    parameter_file, logs = folder / "parameters.yaml", folder / "log"
    write_parameters(parameters, parameter_file)
    logs.mkdir()
    os.environ["ROS_LOG_DIR"] = str(logs)
    emulated = commands_emulated(scene, parameter_file, place, board=False)
    if exciter == "simulated":  # the plant follows the node itself, not a device's voltage
        emulated = [(name, [word.replace(_DEVICE, "excitation/state") for word in words]) for name, words in emulated]
    with stoppable():
        run_realtime([*emulated, *commands_of(parameter_file, [LIVE])], logs, lambda _: None)
    return DONE


def main() -> int:
    """Run as the process at the terminal."""
    parser = Parser(prog="python -m studies.watched_stand", description="used by `python -m studies stop-chain`")
    parser.add_argument("folder", type=Path)
    parser.add_argument("place", type=Path)
    parser.add_argument("port", type=int)
    parser.add_argument("exciter", nargs="?", default="")
    parser.set_defaults(run=lambda given: _run(given.folder, given.place, given.port, given.exciter))
    return run_parsed(lambda: parser)


if __name__ == "__main__":
    sys.exit(main())
