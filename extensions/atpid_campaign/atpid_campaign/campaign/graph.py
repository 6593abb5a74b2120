# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulated and the real stand of a campaign: one graph that runs throughout, and a recorder for each point."""

import math
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from atpid_campaign.campaign.plan import Campaign, Point
from atpid_campaign.campaign.result import Judge
from atpid_campaign.campaign.stands import Feed, Stand
from atpid_common.files import Document
from atpid_common.middleware import named_domain
from atpid_common.vocabulary import ExciterMode, Mode
from atpid_common.waiting import to_stderr
from atpid_control.selection.map_cache import map_for
from atpid_control.stand import parts
from atpid_control.stand.domain import own_domain
from atpid_control.stand.emulated import commands_emulated, parameters_emulated
from atpid_control.stand.parameters import BenchError, Parameters, combined, write_parameters
from atpid_control.stand.processes import NodeProcess, Processes
from atpid_control.stand.running import PLAIN, Commands, command_of, commands_of
from atpid_driver.emulator import missing_tools
from atpid_sim.scene import Scene

_RECORDER = "recorder_node"
#: How long the graph may take to its first estimate, a recorder to its bag, and data to stay away [s].
_START, _RECORD, _SILENCE = 240.0, 30.0, 10.0
#: So far a recorder on a busy machine may be behind [s].
_BEHIND = 1.5
#: Between two looks at what has come [s].
_LOOK = 0.02
#: Between two tries to arm an emulated stand [s].
_ARM_AGAIN = 2.0
#: Until the excitation has ramped down at the end [s].
_RAMP_DOWN = 10.0
#: What is off, and stays so until a person arms it.
_OFF: dict[str, dict[int, str]] = {
    "motor": {Mode.FAULT: "in fault", Mode.DISARMED: "disarmed", Mode.UNCONFIGURED: "not connected"},
    "exciter": {ExciterMode.FAULT: "in fault", ExciterMode.UNCONFIGURED: "not connected"},
}
#: Length of a commanded run [s]: the campaign ends it.
_FOREVER = 1e6
#: Of an exciter with an output.
_DRIVEN = (ExciterMode.RAMPING, ExciterMode.RUNNING, ExciterMode.STOPPING)


class GraphStand(Stand):
    """Processes of a stand whose excitation is commanded; `log` has what they print."""

    def __init__(self, campaign: Campaign, scene: Scene, point: Point, folder: Path) -> None:
        """Start it with a point's grain and wait for the first estimate. Raises BenchError, NodeDiedError."""
        from atpid_campaign.nodes import taking_part

        self._campaign, self._scene = campaign, scene
        self._logs = folder / "log"
        self._logs.mkdir(exist_ok=True)
        os.environ["ROS_LOG_DIR"] = str(self._logs)
        with ExitStack() as stack:
            self._place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="atpid-campaign-")))
            domain = stack.enter_context(own_domain(named_domain()))
            to_stderr(f"ROS domain {domain}: listen with ROS_DOMAIN_ID={domain}")
            emulated = campaign.stand == "emulated"
            self._parameters, commands = (self._emulated if emulated else self._real)(point)
            self._nodes = stack.enter_context(Processes(commands, self._logs))
            self._watch = stack.enter_context(taking_part())
            stack.enter_context(self._nodes.motor_first())
            if emulated:  # the device begins once the plant behind it waits for it
                self._until(lambda: self._watch.plant and self._watch.exciter.header.stamp.sec, _START, "the plant")
                self._watch.start(parts.LABJACK.name)
            self._until(lambda: self._watch.elapsed, _START, "the first estimate")
            self._stack = stack.pop_all()

    def _emulated(self, point: Point) -> tuple[Parameters, Commands]:
        campaign, board = self._campaign, not missing_tools()
        if not board:
            to_stderr(f"left out: the firmware on its emulated board; it needs {' '.join(missing_tools())}")
        excitation = {"commanded": True, "amplitude": max(campaign.amplitudes), "frequency": point.frequency}
        scene, file = self._of_graph(point, {"excitation": excitation, "duration": _FOREVER})
        parameters = parameters_emulated(scene, file, map_for(scene), Path("none"), self._place, board=board, given={})
        parameters["plant_node"]["expect_recorder"] = False
        parameters[parts.LABJACK.name] |= {"expect_recorder": False, "autostart": False}
        written = self._written(parameters)
        commands = commands_emulated(scene, written, self._place, board=board)
        return parameters, [one for one in commands if one[0] != _RECORDER]

    def _real(self, point: Point) -> tuple[Parameters, Commands]:
        given = self._campaign.configurations
        files = {
            parts.SERIAL_MOTOR: given.motor,
            parts.added_part(parts.EXCITER).part: given.excitation,
            parts.SUPERVISOR: given.supervisor,
            parts.LABJACK: given.labjack,
        }
        chosen = [replace(part, config=str(file.absolute())) if file else part for part, file in files.items()]
        others = "identifier_node", "selector_node", _RECORDER
        chosen += [parts.NODES[name] for name in others]  # what moves comes first
        scene, file = self._of_graph(point, {})
        own = parts.stand_parameters(chosen, file, map_for(scene)) | {parts.LABJACK.name: {"expect_recorder": False}}
        parameters = combined(parts.usual_parameters(chosen, scene), own, {})
        return parameters, commands_of(self._written(parameters), chosen[:-1])

    def _of_graph(self, point: Point, changes: Document) -> tuple[Scene, Path]:
        """Return the scene of the graph with a point's grain, and its file."""
        method = point.ceiling if point.is_method else (self._campaign.methods or ("pca",))[0]
        ceiling = self._scene.to_mapping()["ceiling"] | {"controller": method}
        scene, file = point.scene(self._scene, ceiling=ceiling).with_(**changes), self._place / "scene.yaml"
        file.write_text(scene.to_yaml(), encoding="utf-8")
        return scene, file

    def _written(self, parameters: Parameters) -> Path:
        """Write the graph's parameters; each point has a recorder of its own, between whose bags nothing is wrong."""
        for names in ("nodes", "needed"):
            listed = parameters[parts.SUPERVISOR.name][names]
            parameters[parts.SUPERVISOR.name][names] = [name for name in listed if name != _RECORDER]
        written = self._place / "parameters.yaml"
        write_parameters(parameters, written)
        return written

    def measure(self, point: Point, folder: Path, judge: Judge) -> None:
        """See `Stand`."""
        recorder = self._recorder(point, folder)
        try:
            height = point.height(self._scene) or 0.0
            self._watch.select(str(point.ceiling) if point.is_method else "", height)
            self._watch.excite(point.amplitude, point.frequency)
            self._watch.received.clear()
            begun, feed = time.monotonic(), Feed(judge, recording=False)
            while not judge.over:
                time.sleep(_LOOK)
                while self._watch.received and not judge.over:
                    feed(self._watch.received.popleft())
                status = self._watch.recorder
                feed.recording = status.recording and status.bag == str(folder / "bag")
                if recorder.status is not None:
                    judge.bad = f"the recorder ended: {recorder.reason()}"
                elif not feed.recording and time.monotonic() - begun > _RECORD:
                    judge.bad = f"the recorder has not begun within {_RECORD:g} s: {recorder.reason()}"
                elif time.monotonic() - feed.last > _SILENCE:
                    judge.bad = f"no estimate for {_SILENCE:g} s"
                self._check()
            if not judge.bad:
                time.sleep(_BEHIND)  # what is still missing then makes the point bad
        finally:
            recorder.stop()

    def _recorder(self, point: Point, folder: Path) -> NodeProcess:
        """Start a recorder whose bag has the scene of this point."""
        file, scene = folder / "recorded.yaml", folder / "point.yaml"
        rules = self._campaign.rules
        duration = 2.0 * rules.settle_limit + rules.measure_periods / point.frequency
        scene.write_text(point.scene(self._scene, duration=duration, steady_window=[0.0, duration]).to_yaml(), "utf-8")
        own = {"bag": str(folder / "bag"), "scene": str(scene), "files": [str(file)]}
        write_parameters(self._parameters | {_RECORDER: self._parameters[_RECORDER] | own}, file)
        name, command = command_of(parts.NODES[_RECORDER], file, PLAIN)
        return NodeProcess(name, command, folder / "recorder.log")

    def rest(self, until: Callable[[], bool]) -> None:
        """See `Stand`. An emulated stand, beside which nobody stands, is armed again."""
        self._watch.excite(0.0, 0.0)
        while self._campaign.stand == "emulated" and (fault := self.fault()):
            to_stderr(f"{fault}; {self._watch.arm() or 'armed again'}")
            time.sleep(_ARM_AGAIN)
            self._check()
        self._until(until, math.inf, "the end of a rest")

    def fault(self) -> str:
        """See `Stand`."""
        watch = self._watch
        for name, state in (("motor", watch.ceiling), ("exciter", watch.exciter)):
            if state.mode in _OFF[name] or state.fault:
                mode = _OFF[name].get(state.mode, "off")
                return f"the {name} is {mode}: {state.fault or 'a person has to arm it'}"
        return ""

    def close(self) -> None:
        """Ramp the excitation down, then stop the motor first and all others."""
        with self._stack:
            self._watch.excite(0.0, 0.0)
            self._until(lambda: self._watch.exciter.mode not in _DRIVEN, _RAMP_DOWN, "the end of the excitation")

    def _until(self, happened: Callable[[], object], timeout: float, what: str) -> None:
        deadline = time.monotonic() + timeout
        while not happened():
            time.sleep(_LOOK)
            self._check()
            if time.monotonic() > deadline:
                raise BenchError(f"the stand: {what} has not come within {timeout:g} s: see {self._logs}")

    def _check(self) -> None:
        for text in self._nodes.check(except_for=""):
            to_stderr(text)
