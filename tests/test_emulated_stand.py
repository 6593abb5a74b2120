# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stand's own graph without hardware: vendor package, real firmware, simulated physics; and it damps."""

import json
import math
import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
import yaml
from graph_runs import scene_file, wait_until
from motor_rigs import words
from test_graph_force import CHANGES, FORCE
from test_graph_real_time import children

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.commands.stand import NO_LEVELS
from atpid_control.runs.parts import find_parts
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import NodeDiedError, write_parameters
from atpid_control.stand.parts import NODES
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of
from atpid_driver.emulator import Emulator, missing_tools
from atpid_sim.scene import load_scene

#: What changes in the thesis's scene, and the amplitude of what drives it: a support that a laser reads, or a force,
#: so that the device reads a load cell beside a laser.
SCENES: dict[str, tuple[dict[str, Any], float]] = {
    "support": ({"excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015]], "frequency": "resonance"}}, 0.015),
    "force": ({name: value for name, value in CHANGES.items() if name != "further_modes"}, FORCE),
}


def bench(scene: Path, out: Path, *more: str) -> dict[str, Any]:
    """Run the bench as a user would; return its summary."""
    assert main(["bench", str(scene), "--out", str(out), *more]) == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.wall_time
@pytest.mark.parametrize("drive", SCENES)
def test_the_emulated_stand_damps_as_the_simulated_bench_does(
    drive: str, scenes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID")  # the bench claims one of its own
    monkeypatch.setattr("atpid_control.views.report.page.write_report", lambda *_: "")  # no subject here, and dear
    changes, amplitude = SCENES[drive]
    changes = changes | {"duration": 6.0, "steady_window": [4.0, 6.0]}
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    simulated = bench(path, tmp_path / "simulated")
    emulated = bench(path, tmp_path / "emulated", "--emulated-stand")
    printed = capfd.readouterr().err
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
    assert ("left out" in printed) is bool(missing_tools())
    expected, seen = simulated["stages"][-1], emulated["stages"][-1]
    assert seen["height"] == pytest.approx(expected["height"], abs=0.01)
    assert seen["identified_amplitude"] == pytest.approx(amplitude, rel=2e-3 if drive == "force" else 0.01)
    assert emulated["drive"]["name"] == drive
    assert seen["efficiency"] == pytest.approx(expected["efficiency"], abs=0.03)
    assert emulated["lost_scans"] == 0
    first = signals_of(open_run(tmp_path / "emulated" / "bag"))[0].response[:100]
    # no step where the plant takes over from the feed
    assert np.abs(np.diff(first)).max() < 0.5 * load_scene(path).static_deflection


def test_a_motor_that_moves_at_another_speed_ends_its_process_with_one_line_and_status_2(tmp_path: Path) -> None:
    slow = {"check_move": 0.1, "initial_height": 0.017, "faults": ["motor slow 0 1000 0.5"]}
    write_parameters({"motor_node": NODES["motor_node"].configured() | slow}, tmp_path / "parameters.yaml")
    commands = [command for command in commands_of(tmp_path / "parameters.yaml") if command[0] == "motor_node"]
    with own_domain(), Processes(commands, tmp_path) as nodes:
        wait_until(lambda: nodes["motor_node"].status is not None)
        with pytest.raises(NodeDiedError, match=r"motor_node.* 2.* 0\.017 to 0\.117 m.* 0\.3 m/s .*25%.* 0\.1"):
            nodes.check("")


def test_in_lockstep_it_is_refused(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", str(scenes / "thesis_4_3.yaml"), "--out", str(tmp_path / "out"), "--move", "0.1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: --move: ")
    assert {"0.1", "emulated", "time"} <= words(line)


WIRING = {
    "backend": "simulated", "rate": 1000.0, "channels": ["support_displacement", "beam_displacement"],
    "terminals": ["a", "b"], "calibrations": ["laser_support.yaml", "laser_beam.yaml"], "frequency": 5.47,
    "amplitude": 0.2,  # 0.015 m at the support, for which the ceiling travels down for more than two seconds
}  # fmt: skip


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A ROS domain for the processes of these tests."""
    with own_domain() as number:
        yield number


class Running:
    """A command that runs; what it prints on standard output and error is collected."""

    def __init__(self, *words: object, name: str = "reader", environment: dict[str, str] | None = None) -> None:
        self.lines: list[str] = []
        self.errors: list[str] = []
        given = {**(environment or os.environ), "PYTHONUNBUFFERED": "1"}
        piped: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": given}
        self.process = subprocess.Popen([*map(str, words)], text=True, **piped)
        pipes = ((self.process.stdout, self.lines), (self.process.stderr, self.errors))
        self._readers = [threading.Thread(target=self._read, args=pipe, name=name) for pipe in pipes]
        for reader in self._readers:
            reader.start()

    def _read(self, pipe: IO[str], lines: list[str]) -> None:
        with pipe:
            for line in pipe:
                lines.append(line.rstrip("\n"))  # noqa: PERF401  # each is seen by another thread at once

    def printed(self, words: str) -> bool:
        return any(words in line for line in [*self.lines, *self.errors])

    def wait_for(self, words: str) -> None:
        wait_until(lambda: self.printed(words) or self.process.poll() is not None)
        assert self.printed(words), (self.lines, self.errors)

    def end(self, number: int | None = None) -> int:
        """Send a signal, or none; return the exit status."""
        if number is not None:
            self.process.send_signal(number)
        status = self.process.wait()
        for reader in self._readers:
            reader.join()
        return status


Start = Callable[..., Running]


@pytest.fixture
def start(domain: int) -> Iterator[Start]:
    """Start commands, and stop what is left of them."""
    with ExitStack() as stack:

        def begin(*words: object) -> Running:
            command = Running(*words)
            stack.callback(lambda: command.end(signal.SIGTERM if command.process.poll() is None else None))
            return command

        yield begin


def parameter_file(path: Path, node: str, **values: object) -> Path:
    path.write_text(yaml.safe_dump({f"/**/{node}": {"ros__parameters": values}}))
    return path


class Terminal:
    """A command at a terminal of its own: what is typed reaches it, what it prints is kept."""

    def __init__(self, *words: object) -> None:
        self.pid, self._file = pty.fork()
        if self.pid == 0:
            os.execvp(str(words[0]), list(map(str, words)))  # the child of the fork above
        self.printed = ""
        self.status: int | None = None
        self._reader = threading.Thread(target=self._read, name="reader")
        self._reader.start()

    def _read(self) -> None:
        with suppress(OSError):  # the command has ended
            while data := os.read(self._file, 4096):
                self.printed += data.decode(errors="replace")

    def type(self, text: str) -> None:
        os.write(self._file, text.encode())

    def end(self, options: int = 0) -> int | None:
        """Return the exit status, waited for but with WNOHANG; None: it runs."""
        if self.status is None:
            pid, status = os.waitpid(self.pid, options)
            if pid:
                self.status = os.waitstatus_to_exitcode(status)
                self._reader.join()
                os.close(self._file)
        return self.status


@contextmanager
def at_a_terminal(scenes: Path, folder: Path) -> Iterator[tuple[Terminal, Emulator | None]]:
    """Run a stand in a namespace, with the real firmware where it can be built."""
    limits = {"lowest": 0.017, "highest": 1.0, "speed": 0.3}
    with ExitStack() as stack:
        stack.enter_context(own_domain())
        board: Emulator | None = None
        backend: dict[str, object]
        if missing_tools() and not os.environ.get("CI"):
            backend = {"backend": "simulated", "initial_height": 0.017}
        else:
            kept: Any = {"eeprom": folder / "eeprom", "height": 0.99, "bootloader": 0.05, "reset_on_open": True}
            board = stack.enter_context(Emulator(folder / "board", **kept))  # the real firmware
            board.pace(1.0)
            backend = {"backend": "serial", "port": str(folder / "board")}
        files = {
            "labjack": parameter_file(folder / "labjack.yaml", "labjack_node", **WIRING, expect_recorder=True),
            "motor": parameter_file(folder / "motor.yaml", "motor_node", **limits, **backend),
        }
        levels = parameter_file(folder / "levels.yaml", "supervisor_node", beam_displacement_abort=0.5)
        terminal = Terminal(
            "atpid", "stand", scenes / "stand_realtime.yaml", "--bag", folder / "bag", "--params-file", levels,
            "--labjack-config", files["labjack"], "--motor-config", files["motor"], "--namespace", "lab1",
        )  # fmt: skip
        stack.callback(terminal.end)
        stack.callback(lambda: os.kill(terminal.pid, signal.SIGTERM) if terminal.end(os.WNOHANG) is None else None)
        for words in ("Enter stops the motor", "simulated:1 streams 2 channels at 1000 Hz", "supervisor_node]: ready"):
            wait_until(lambda words=words: words in terminal.printed or terminal.end(os.WNOHANG) is not None)  # type: ignore[misc]
            assert words in terminal.printed, terminal.printed
        yield terminal, board


def off_after(board: Emulator, act: Callable[[], object]) -> float:
    """Return how long after an act in the middle of a travel the motor was off, by the board's clock [s]."""
    wait_until(lambda: board.state().motor != 0)
    begun = board.state()
    act()
    wait_until(lambda: board.state().motor == 0)
    return (board.state().motor_off_ms - begun.ms) * 1e-3


@dataclass
class Stood:
    """What was seen of a stand in a namespace, at a terminal: Enter stopped its motor, Ctrl-C ended it."""

    status: int | None
    printed: str
    bag: Path
    off_after: float = math.nan  # from Enter until the motor itself was off [s]; NaN: no emulated board


@pytest.fixture(scope="module")
def stood(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Stood:
    folder = tmp_path_factory.mktemp("stand")
    with at_a_terminal(scenes, folder) as (terminal, board):
        made = Stood(0, "", folder / "bag")
        if board:
            made.off_after = off_after(board, lambda: terminal.type("\n"))
            wait_until(lambda: "motor off" in terminal.printed)
        wait_until(lambda: find_parts(folder / "bag")[0].stat().st_size > 150_000)  # more than it begins with
        terminal.type("\x03")
        made.status, made.printed = terminal.end(), terminal.printed
    return made


@pytest.mark.wall_time
@pytest.mark.parametrize("lost", ["cable", "selector_node"])
def test_where_a_part_is_lost_the_motor_goes_off(lost: str, scenes: Path, tmp_path: Path) -> None:
    with at_a_terminal(scenes, tmp_path) as (terminal, board):
        if board is None:
            pytest.skip("left out: the AVR tools are missing")

        def lose() -> None:
            if lost == "cable":
                board.do("unplug")
            else:
                os.kill(children(terminal.pid)[lost], signal.SIGKILL)

        after = off_after(board, lose)
        print(f"{lost} lost: motor off after {after * 1e3:.0f} ms")
        assert after <= 0.8  # by the firmware's heartbeat after 0.5 s, and what a busy machine adds


@pytest.mark.wall_time
def test_enter_switches_the_motor_off(stood: Stood) -> None:
    """The time is the board's own, but for that until the key is received."""
    if math.isnan(stood.off_after):
        pytest.skip("left out: the AVR tools are missing")
    print(f"Enter: motor off after {stood.off_after * 1e3:.0f} ms")
    assert stood.off_after <= 0.22


@pytest.mark.wall_time  # as the test above, with which it shares the stand
def test_the_stand_runs_until_ctrl_c_and_its_bag_keeps_all_parameters(stood: Stood, root: Path) -> None:
    assert stood.status == 0, stood.printed
    assert NO_LEVELS not in stood.printed
    assert "Traceback" not in stood.printed
    assert verify(stood.bag).by_topic["/lab1/sensors/laser"] > 0
    assert yaml.safe_load((stood.bag / "metadata.yaml").read_text())
    bag = open_bag(stood.bag)
    given = yaml.safe_load(bag.files["parameters.yaml"])["/**/supervisor_node"]["ros__parameters"]
    assert given["beam_displacement_abort"] == 0.5
    assert given["nodes"][:2] == ["motor_node", "labjack_node"]
    assert bag.files["standard.npz"] == (root / "atpid_control/config/maps/standard.npz").read_bytes()
    assert {f"{node}_node.yaml" for node in ("labjack", "motor", "identifier", "selector")} <= set(bag.files)
    document = yaml.safe_load(bag.files["labjack_node.yaml"])
    assert document["/**/labjack_node"]["ros__parameters"]["frequency"] == 5.47
    assert "started" in [event.kind for _, event in bag.messages("/lab1/events")]


def test_a_node_of_the_stand_that_ends_ends_the_stand(
    domain: int, scenes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    labjack = parameter_file(tmp_path / "labjack.yaml", "labjack_node", **(WIRING | {"calibrations": ["none.yaml"]}))
    words = ["stand", scenes / "stand_realtime.yaml", "--bag", tmp_path / "bag", "--labjack-config", labjack]
    assert main(list(map(str, words))) == 2
    errors = capfd.readouterr().err.splitlines()
    assert errors[-1].startswith("error: labjack_node ")
    assert errors[0] == NO_LEVELS


def test_an_existing_bag_is_refused_first(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stand", str(scenes / "stand_realtime.yaml"), "--bag", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert {f"{tmp_path}:", "exists"} <= set(line.split())


@dataclass
class Asked:
    """Lines that `atpid ros` has printed, and its status."""

    status: int
    lines: list[str]
    errors: list[str]

    def message(self) -> Any:
        """Return the message that was printed."""
        assert (self.status, self.lines[-1]) == (0, "---")
        return yaml.safe_load("\n".join(self.lines[:-1]))


Ask = Callable[..., Asked]


@pytest.fixture
def ros(domain: int, capfd: pytest.CaptureFixture[str]) -> Ask:
    """Run `atpid ros` in this process."""

    def ask(*words: str) -> Asked:
        capfd.readouterr()
        status = main(["ros", *words])
        printed = capfd.readouterr()
        return Asked(status, printed.out.splitlines(), printed.err.splitlines())

    return ask


def test_a_motor_is_configured_and_activated_by_hand(start: Start, ros: Ask, root: Path) -> None:
    file = root / "atpid_driver" / "config" / "motor.yaml"
    given = ["--ros-args", "--params-file", file, "-p", "autostart:=false", "-p", "initial_height:=0.05"]
    motor = start(sys.executable, "-m", "atpid_driver.nodes.motor_node", *given)
    configured = ros("lifecycle", "/motor_node", "configure")
    assert configured.status == 0
    assert configured.lines[-1].split() == ["/motor_node:", "inactive"]
    state = ros("echo", "/ceiling/state", "--once").message()
    assert (state["mode"], state["height"]) == (1, 0.05)
    again = ros("lifecycle", "/motor_node", "configure")
    assert again.status == 2
    assert {"error:", "/motor_node", "configure", "inactive;"} <= set(again.errors[-1].split())
    assert ros("lifecycle", "/motor_node", "activate").status == 0
    assert motor.end(signal.SIGINT) == 0


def test_the_messages_of_a_sensor_are_printed(start: Start, ros: Ask, root: Path) -> None:
    file = root / "atpid_driver" / "config" / "labjack.yaml"
    given = ["--ros-args", "--params-file", file, "-p", "handshake:=false", "-p", "backend:=simulated"]
    laser = start(sys.executable, "-m", "atpid_driver.nodes.labjack_node", *given)
    statuses = ros("echo", "/diagnostics", "--once").message()["status"]
    names = ["acquisition", "support_displacement", "beam_displacement"]
    assert [status["name"] for status in statuses] == [f"labjack_node: {name}" for name in names]
    data = start("atpid", "ros", "echo", "/sensors/laser", "--field", "data")
    data.wait_for("---")
    assert data.end(signal.SIGINT) == 0
    assert len(yaml.safe_load("\n".join(data.lines[: data.lines.index("---")]))) == 100
    wrong = ros("echo", "/sensors/laser", "--field", "volts")
    assert wrong.status == 2
    assert wrong.errors[-1].split()[:4] == ["error:", "--field:", "given", "volts;"]
    assert laser.end(signal.SIGINT) == 0


def test_a_replay_node_alone_logs_what_it_waits_for(start: Start, root: Path) -> None:
    """And `atpid ros echo`, of a topic without a publisher."""
    bag = root / "bags" / "thesis_4_3_short"
    given = ["--ros-args", "-p", f"bag:={bag}", "-p", "rate:=0.0"]
    replay = start(sys.executable, "-m", "atpid_control.nodes.replay_node", *given)
    echo = start("atpid", "ros", "echo", "/nothere")
    echo.wait_for("waiting for a publisher of /nothere")
    replay.wait_for("waiting for an answer on ceiling/command; not running: identifier_node, selector_node")
    for command in (echo, replay):
        assert command.end(signal.SIGINT) == 0
