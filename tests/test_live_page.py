# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page beside a bench in real time, what its buttons do, what its end leaves; and what is drawn of a view."""

import asyncio
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingState, Event, Excitation, SampleBlock, SupervisorState
from graph_runs import scene_file, wait_until, without_domain
from page_visit import live
from std_msgs.msg import Header
from test_emulated_stand import Running
from tornado.websocket import WebSocketClientConnection, websocket_connect

from atpid_common.nodes.messages import doubles, time_of
from atpid_control.runs.decode import stamp_of
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.stand.domain import own_domain
from atpid_control.stand.summary import lost_scans, unanswered_blocks
from atpid_control.views.live.address import Address
from atpid_control.views.live.server import LiveServer
from atpid_control.views.live.view import LiveView
from atpid_control.views.report.latency import laser_blocks
from atpid_sim.modal import bare_amplitude
from atpid_sim.scene import Scene, load_scene

NOTE = "set screw tightened"
SCENE = {
    "excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015], [300.0, 0.015]], "frequency": "resonance"},
    "duration": 300.0,
    "steady_window": [290.0, 300.0],
}


class Bench(NamedTuple):
    command: Running
    port: int
    out: Path


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


def browse(port: int, work: Callable[[Page], Coroutine[Any, Any, None]]) -> None:
    async def visit() -> None:
        stream = await websocket_connect(f"ws://127.0.0.1:{port}/stream")
        try:
            await work(Page(stream))
        finally:
            stream.close()
            while await stream.read_message() is not None:
                pass

    asyncio.run(asyncio.wait_for(visit(), 120.0))


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


def seen_of(view: LiveView) -> Any:
    server = LiveServer(view, lambda _request, _answer: None, Address(port=0), ("lookup",))
    try:
        return live("still", server.address.url)
    finally:
        server.close()


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
        assert page.events  # published before the page was opened
        times = [row[0] for row in page.rows["motion"]]
        assert times == sorted(times)

    browse(bench.port, look)


def test_the_operator_marks_holds_chooses_stops_and_arms(bench: Bench) -> None:
    async def operate(page: Page) -> None:
        await page.until(lambda: page.rows.get("efficiency"))
        assert (await page.ask(do="note", text=NOTE)).endswith(NOTE)
        await page.until(lambda: NOTE in page.events)
        await page.ask(do="hold", on=True)
        await page.until(lambda: page.state["command"]["reason"] == "held by the operator")
        assert page.state["command"]["height"] is None
        await page.ask(do="hold", on=False)
        await page.until(lambda: page.state["command"]["height"] is not None)
        await page.ask(do="method", name="pca")
        await page.until(lambda: page.state["command"]["method"] == "pca" and page.state["command"]["height"])
        await page.ask(do="stop")
        await page.until(lambda: page.state["motor"]["mode"] == "disarmed" and page.state["supervisor"]["number"] == 4)
        await page.arm()
        await page.ask(do="disarm")
        await page.until(lambda: page.state["motor"]["mode"] == "disarmed")
        await page.arm()

    browse(bench.port, operate)


def test_a_browser_draws_it_without_an_accessibility_finding(bench: Bench) -> None:
    seen = live("operate", f"http://127.0.0.1:{bench.port}/")
    assert seen["errors"] == []
    assert seen["findings"] == []
    assert seen["note"].startswith("noted: ")
    assert float(seen["texts"]["excitation"].split()[0]) == pytest.approx(15.0, abs=0.1)
    running, stopped = seen["running"], seen["stopped"]
    assert (running["link"], running["class"]) == ("Connected", "good")
    assert stopped["link"].endswith(": disarmed")
    assert stopped["class"] != "good"
    arms = [button for button in stopped["buttons"] if button.startswith("Arm")]
    assert [button for button in arms if button in stopped["answer"]]  # which is to be pressed next
    assert not stopped["over"]
    # pressed without a connection, and done once there was one again
    assert "emergency" in seen["unsent"]


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
    assert any("live_node" in event.text for event in events)
    notes = [event.text for event in events if event.kind == Event.NOTE]
    if notes:  # by the tests above, where they have been run
        assert NOTE in notes
        assert any(event.kind == Event.STOPPED for event in events)
        assert any(message.mode == CeilingState.DISARMED for _, message in bag.messages("/ceiling/state"))


@pytest.mark.parametrize("motor", ["there", "gone"])
def test_after_a_run_the_values_are_grey_and_only_a_motor_that_is_there_can_be_stopped(motor: str) -> None:
    view = LiveView(None)
    begun = time.monotonic()
    state = CeilingState(mode=CeilingState.HOLDING, homed=True)
    # one that is there is heard of until after the visit
    view.on_state("ceiling/state", state, begun + (1e6 if motor == "there" else -10.0))
    view.on_event(Event(kind=Event.FINISHED, severity=Event.INFO, text="20 s simulated"), begun)
    seen = seen_of(view)
    assert seen["over"]
    assert seen["link"].startswith("Connected; ")
    assert seen["class"] != "good"
    assert seen["texts"]["h-now"].startswith("Last ")
    assert len(seen["buttons"]) == (1 if motor == "there" else 0)


def is_page(process: Path, out: Path) -> bool:
    try:
        words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return False
    return str(out / "parameters.yaml") in words and any(word.endswith("/live_node") for word in words[:3])


def test_without_the_library_the_run_goes_on_and_the_node_ends_with_a_line(scenes: Path, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['tornado'] = None\n")
    hiding = {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-m", "atpid_control.nodes.live_node"]
    node = subprocess.run(command, capture_output=True, text=True, check=False, env=without_domain() | hiding)
    assert (node.returncode, len(node.stderr.splitlines())) == (2, 1)
    assert "tornado" in node.stderr
    scene = scene_file(scenes / "thesis_4_3.yaml", tmp_path, duration=1.0, steady_window=[0.5, 1.0])
    run = subprocess.run(
        ["atpid", "bench", str(scene), "--out", str(tmp_path / "out"), "--live"],
        capture_output=True, text=True, check=False, env=without_domain() | hiding,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert re.search("^left .*tornado", run.stderr, re.MULTILINE)


def test_a_page_alone_shows_that_there_is_no_graph() -> None:
    async def look(page: Page) -> None:
        await page.until(lambda: page.state)
        assert not page.state["seen"]
        with pytest.raises(AssertionError, match="'success': False"):
            await page.ask(do="stop")

    with own_domain():
        alone = Running("atpid", "live", "--port", "0", "--namespace", "lab1")
        try:
            alone.wait_for("live page: http://127.0.0.1:")
            (line,) = (line for line in alone.lines if line.startswith("live page: "))
            browse(int(line.rsplit(":", 1)[1].strip("/")), look)
        finally:
            assert alone.end(signal.SIGINT) == 0


#: Of the support [m] and the excitation [Hz]; of the beam against the structure without the damper [-].
SUPPORT, FREQUENCY, MORE = 0.00150034, 94.0, 1.2
#: The page's states hold for longer than a visit [s].
LATER = 1e6


def stiff(scenes: Path) -> tuple[Scene, float]:
    """Return a beam of 100 Hz, 95 Hz with the damper closed, and its amplitude [m]."""
    beam = {"mass": 0.3258, "stiffness": 0.3258 * (200.0 * math.pi) ** 2, "damping": 4.0}
    scene = load_scene(scenes / "standard.yaml").with_(beam=beam)
    return scene, MORE * bare_amplitude(scene.beam.mass, scene.beam.stiffness, scene.beam.damping, SUPPORT, FREQUENCY)


def view_of(scene: Scene, amplitude: float, supervisor: int = SupervisorState.READY, **motor: Any) -> LiveView:
    """Return a view of one block, one estimate, and the state of the graph."""
    view, now = LiveView(scene), time.monotonic() + LATER
    block = SampleBlock(header=Header(stamp=time_of(100_000_000_000)), rate=1000.0, data=doubles(np.zeros((50, 2))))
    block.channels = ["support_displacement", "beam_displacement"]
    view.on_block(block, now)
    header = Header(stamp=time_of(105_000_000_000))
    estimate = Excitation(header=header, quality=Excitation.STEADY, amplitude=SUPPORT, amplitude_std=1.23e-6)
    estimate.frequency, estimate.frequency_std, estimate.beam_amplitude = FREQUENCY, 3.7e-3, amplitude
    view.on_excitation(estimate, now)
    motor = {"mode": CeilingState.HOLDING, "homed": True, "height": 0.024, "target": 0.024} | motor
    view.on_state("ceiling/state", CeilingState(header=header, **motor), now)
    view.on_state("supervisor/state", SupervisorState(header=header, state=supervisor), now)
    return view


@pytest.fixture(scope="module")
def seen(scenes: Path) -> Any:
    return seen_of(view_of(*stiff(scenes)))


def test_values_have_the_figures_of_their_deviation_and_a_damper_that_makes_it_worse_is_named(seen: Any) -> None:
    texts = seen["texts"]
    assert texts["excitation"].split(", ") == ["1.5003 ± 0.0012 mm", "steady"]
    assert texts["frequency"] == "94.000 ± 0.004 Hz"
    assert texts["power"].startswith("on, ")
    now, mean, *words = texts["reduction"].split("%")
    assert (now.strip(), mean.strip("; ")) == ("−20", "−20")
    assert "worse" in words[0]
    assert not texts["efficiency"].startswith("−")
    assert float(texts["beam"].split()[0]) == pytest.approx(MORE * float(texts["bare"].split()[0]), rel=0.01)
    assert float(texts["closed"].split()[0]) > float(texts["beam"].split()[0])


def test_connected_is_green_only_while_all_is_well(seen: Any, scenes: Path) -> None:
    stopped = seen_of(view_of(*stiff(scenes), mode=CeilingState.FAULT, fault="emergency stop"))
    degraded = seen_of(view_of(*stiff(scenes), SupervisorState.DEGRADED))
    for shown, parts, style in (
        (seen, {"Connected"}, "good"),
        (stopped, {"Connected", "motor off", "emergency stop"}, "bad"),
        (degraded, {"Connected", "supervisor", "degraded"}, ""),
    ):
        assert (set(re.split("; |: ", shown["link"])), shown["class"]) == (parts, style)
        assert any("motor" in button for button in shown["buttons"])
