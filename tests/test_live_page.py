# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page beside a bench in real time: what it shows, what its buttons do, and that its end ends nothing."""

import asyncio
import importlib.util
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pytest
from atpid_interfaces.msg import CeilingState, Event
from graph_runs import scene_file, wait_until, without_domain
from test_without_ros2 import Running
from tornado.websocket import WebSocketClientConnection, websocket_connect

from atpid_control.cli import main
from atpid_control.runs.losses import stamp_of
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.stand.domain import own_domain
from atpid_control.stand.summary import lost_scans, unanswered_blocks
from atpid_control.views.live.address import Address, listening
from atpid_control.views.live.server import LiveServer
from atpid_control.views.live.view import LiveView
from atpid_control.views.report.latency import laser_blocks

pytestmark = pytest.mark.slow
T = TypeVar("T")
CHROMIUM = shutil.which("chromium") or ""
SCENE = {
    "excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015], [300.0, 0.015]], "frequency": "resonance"},
    "duration": 300.0,
    "steady_window": [290.0, 300.0],
}


class Bench(NamedTuple):
    """A bench in real time with its page."""

    command: Running
    port: int
    out: Path

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.port}/"


class Page:
    """What one browser is sent and asks for."""

    def __init__(self, stream: WebSocketClientConnection) -> None:
        self._stream = stream
        self.rows: dict[str, list[Any]] = {}
        self.events: list[str] = []
        self.state: dict[str, Any] = {}
        self.spectrum: Any = None
        self.answers: list[dict[str, Any]] = []

    async def until(self, happened: Callable[[], object]) -> None:
        """Take messages until it has happened."""
        while not happened():
            text = await self._stream.read_message()
            assert text is not None, "closed"
            self._take(json.loads(text))

    def _take(self, message: dict[str, Any]) -> None:
        if message["type"] == "answer":
            self.answers.append(message)
        elif message["type"] != "hello":
            for name, rows in message["rows"].items():
                self.rows.setdefault(name, []).extend(rows)
            self.events += [event["text"] for event in message["events"]]
            self.state, self.spectrum = message["state"], message["spectrum"] or self.spectrum

    async def ask(self, **request: Any) -> str:
        """Ask; return the answer, which has to be a success."""
        count = len(self.answers)
        await self._stream.write_message(json.dumps({"number": count, **request}))
        await self.until(lambda: len(self.answers) > count)
        answer = self.answers[-1]
        assert answer["success"], answer
        return str(answer["text"])

    async def arm(self) -> None:
        """Arm until it is armed: a busy machine withdraws the permission, or misses a beat."""
        for number in range(100):
            await self._stream.write_message(json.dumps({"number": 1000 + number, "do": "arm"}))
            tried = len(self.rows.get("motion", []))
            await self.until(lambda tried=tried: len(self.rows.get("motion", [])) > tried + 200)  # type: ignore[misc]
            if self.state["motor"]["mode"] in ("holding", "moving"):
                return


def browse(port: int, work: Callable[[Page], Coroutine[Any, Any, T]]) -> T:
    """Open the page, do `work` on it, and leave."""

    async def visit() -> T:
        stream = await websocket_connect(f"ws://127.0.0.1:{port}/stream")
        try:
            return await work(Page(stream))
        finally:
            stream.close()
            while await stream.read_message() is not None:
                pass

    return asyncio.run(asyncio.wait_for(visit(), 120.0))


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def bench(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("live")
    scene, port = scene_file(scenes / "thesis_4_3.yaml", folder, **SCENE), free_port()
    arguments = ("bench", scene, "--out", folder / "out", "--live", "--live-port", port)
    command = Running("atpid", *arguments, name="session-reader", environment=without_domain())
    try:
        command.wait_for("live page: ")
        wait_until(lambda: answers(port), command.process)
        yield Bench(command, port, folder / "out")
    finally:
        if command.process.poll() is None:
            command.end(signal.SIGINT)


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_the_page_shows_the_run(bench: Bench) -> None:
    async def look(page: Page) -> None:
        shown = {"motion", "truth", "excitation", "command", "ceiling", "efficiency"}
        await page.until(lambda: shown <= set(page.rows) and page.spectrum)
        await page.until(lambda: page.state["nodes"] and all(node["well"] for node in page.state["nodes"]))
        names = {node["name"] for node in page.state["nodes"]}
        assert {"plant_node", "identifier_node", "selector_node", "motor_node", "supervisor_node"} <= names
        await page.until(lambda: page.state["excitation"]["quality"] == "steady")
        assert page.state["excitation"]["amplitude"] == pytest.approx(0.015, rel=0.02)
        assert page.state["motor"]["power"].startswith("on")
        assert page.state["recorder"]["recording"]
        assert any("in real time" in text for text in page.events)  # published before the page was opened
        times = [row[0] for row in page.rows["motion"]]
        assert times == sorted(times)

    browse(bench.port, look)


def test_the_operator_marks_holds_chooses_stops_and_arms(bench: Bench) -> None:
    async def operate(page: Page) -> None:
        await page.until(lambda: page.rows.get("efficiency"))
        assert await page.ask(do="note", text="set screw tightened") == "noted: set screw tightened"
        await page.until(lambda: "set screw tightened" in page.events)
        await page.ask(do="hold", on=True)
        await page.until(lambda: page.state["command"]["reason"] == "held by the operator")
        assert page.state["command"]["height"] is None
        await page.ask(do="hold", on=False)
        await page.until(lambda: page.state["command"]["height"] is not None)
        await page.ask(do="method", name="pca")
        await page.until(lambda: page.state["command"]["method"] == "pca" and page.state["command"]["height"])
        assert "motor off" in await page.ask(do="stop")
        await page.until(lambda: page.state["motor"]["mode"] == "disarmed" and page.state["supervisor"]["number"] == 4)
        await page.arm()
        await page.ask(do="disarm")
        await page.until(lambda: page.state["motor"]["mode"] == "disarmed")
        await page.arm()

    browse(bench.port, operate)


def test_a_browser_draws_it_without_an_accessibility_finding(bench: Bench, tmp_path: Path) -> None:
    """Chromium draws; two at once, at the width of a desktop and of a phone, one of which comes late and leaves."""
    seen = visited(bench.url, tmp_path)
    assert seen["errors"] == []
    assert seen["findings"] == []  # at the width of a phone and of a desktop, light and dark
    assert seen["phone_width"] <= 390
    assert seen["first_focus"] == "stop"
    assert seen["stop_stays"] == [True, True]
    assert seen["note"] == "noted: seen in a browser"
    assert float(seen["texts"]["excitation"].split()[0]) == pytest.approx(15.0, abs=0.1)
    assert seen["texts"]["grain"] == "Grain and ceiling as simulated."
    assert min(seen["pictures"]) > 0
    print("pictures a second:", seen["pictures"])
    assert (seen["running"]["link"], seen["running"]["class"]) == ("Connected", "good")
    assert seen["stopped"]["link"] == "Connected; motor off: disarmed"
    assert seen["stopped"]["class"] != "good"
    assert "Arm again" in seen["stopped"]["answer"]
    assert "Arm again" in seen["stopped"]["buttons"]
    assert not seen["stopped"]["over"]
    # pressed without a connection, and done once there was one again
    assert seen["unsent"] == "there is no connection: nothing was done yet; use the emergency stop"


def test_a_page_that_is_killed_ends_nothing_and_ctrl_c_ends_everything(bench: Bench) -> None:
    """The last test of the run, which costs as long as it lasts: its page's end is an event, the bag is whole."""
    (live,) = (int(p.name) for p in Path("/proc").glob("[0-9]*") if is_page(p, bench.out))
    assert os.getpriority(os.PRIO_PROCESS, live) >= 10
    os.kill(live, signal.SIGKILL)
    bench.command.wait_for("live_node ended with status -9")
    size = sum(path.stat().st_size for path in (bench.out / "bag").iterdir())
    # five seconds of a run: it may have been the first test of it, before the loop began
    wait_until(lambda: sum(p.stat().st_size for p in (bench.out / "bag").iterdir()) > size + 300_000,
               bench.command.process)  # fmt: skip
    assert bench.command.end(signal.SIGINT) == 130
    assert not answers(bench.port)
    bag = open_bag(bench.out / "bag")
    run = open_run(bag.path)
    assert lost_scans(run) == 0
    # Ctrl-C ends the nodes one by one: blocks on their way have no answer; none before them lacks one
    last = max(stamp_of(command) for _, command in bag.of_kind("CeilingCommand"))
    assert unanswered_blocks(run) <= sum(1 for stamp, _, _ in laser_blocks(run) if stamp > last)
    events = [event for _, event in bag.messages("/events")]
    assert any("live_node ended" in event.text for event in events)
    notes = [event.text for event in events if event.kind == Event.NOTE]
    if notes:  # by the tests above, where they have been run
        assert "set screw tightened" in notes
        assert any(event.kind == Event.STOPPED for event in events)
        assert any(message.mode == CeilingState.DISARMED for _, message in bag.messages("/ceiling/state"))


@pytest.mark.parametrize("motor", ["in the graph", "gone"])
def test_after_a_run_the_values_are_grey_and_only_a_motor_that_is_there_can_be_stopped(motor: str) -> None:
    view = LiveView(None)
    begun = time.monotonic()
    state = CeilingState(mode=CeilingState.HOLDING, homed=True)
    # one that is there is heard of until after the visit
    view.on_state("ceiling/state", state, begun + (1e6 if motor == "in the graph" else -10.0))
    view.on_event(Event(kind=Event.FINISHED, severity=Event.INFO, text="20 s simulated"), begun)
    server = LiveServer(view, lambda _request, _answer: None, Address(port=0), ("lookup",))
    try:
        seen = visited(server.address.url)
    finally:
        server.close()
    assert seen["over"]
    assert seen["link"].startswith("Connected; the run is over")
    assert seen["class"] != "good"
    assert seen["texts"]["h-now"] == "Last values"
    assert int(seen["weight"]) < 600
    assert seen["buttons"] == (["Stop the motor"] if motor == "in the graph" else [])


def visited(url: str, *further: object) -> Any:
    """Return what Chromium saw of a page: see browser_visit.py."""
    if not CHROMIUM or importlib.util.find_spec("playwright") is None:
        pytest.skip("left out: a browser draws the page; Chromium or playwright is missing: sudo make browser")
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("browser_visit.py"), url, CHROMIUM, *map(str, further)],
        capture_output=True, text=True, check=False, timeout=300.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def is_page(process: Path, out: Path) -> bool:
    try:
        words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return False
    return str(out / "parameters.yaml") in words and any(word.endswith("/live_node") for word in words[:3])


def test_a_port_that_is_taken_is_one_line_before_anything_starts(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with listening(Address(port=free_port())) as taken:
        port = str(taken.getsockname()[1])
        command = ["bench", str(scenes / "thesis_4_3.yaml"), "--out", str(tmp_path / "out")]
        status = main([*command, "--live", "--live-port", port])
        node = subprocess.run(
            [sys.executable, "-m", "atpid_control.nodes.live_node", "--ros-args", "-p", f"port:={port}"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    for ended, said in ((status, capsys.readouterr().err), (node.returncode, node.stderr)):
        assert ended == 2
        assert said.startswith(f"error: live page: 127.0.0.1:{port} cannot be used")
        assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_without_the_library_the_run_goes_on_and_the_node_ends_with_a_line(scenes: Path, tmp_path: Path) -> None:
    hiding = tmp_path / "sitecustomize.py"
    hiding.write_text("import sys\nsys.modules['tornado'] = None\n")
    environment = without_domain() | {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    node = subprocess.run(
        [sys.executable, "-m", "atpid_control.nodes.live_node"], capture_output=True, text=True, check=False,
        env=environment,
    )  # fmt: skip
    assert node.returncode == 2
    assert node.stderr == "error: live page: it needs tornado: make setup, or sudo apt install python3-tornado\n"
    changes = {"duration": 1.0, "steady_window": [0.5, 1.0]}
    scene = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    run = subprocess.run(
        ["atpid", "bench", str(scene), "--out", str(tmp_path / "out"), "--live"],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "left out: live page: it needs tornado" in run.stderr


@pytest.mark.parametrize(
    "words",
    [
        (sys.executable, "-m", "atpid_control.nodes.live_node", "--ros-args", "-p", "port:=0"),
        ("atpid", "live", "--port", "0", "--namespace", "lab1"),
    ],
    ids=["the node", "the command"],
)
def test_a_page_alone_shows_that_there_is_no_graph(words: tuple[str, ...]) -> None:
    with own_domain():
        node = Running(*words)
        try:
            node.wait_for("live page: http://127.0.0.1:")
            (line,) = (line for line in node.lines if line.startswith("live page: "))

            async def look(page: Page) -> None:
                await page.until(lambda: page.state)
                assert not page.state["seen"]
                with pytest.raises(AssertionError, match="not in the graph; nothing was done"):
                    await page.ask(do="stop")

            browse(int(line.rsplit(":", 1)[1].strip("/")), look)
        finally:
            begun = time.monotonic()
            assert node.end(signal.SIGINT) == 0
            print(f"ended after {time.monotonic() - begun:.2f} s")
