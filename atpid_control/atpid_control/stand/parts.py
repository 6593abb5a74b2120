# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which nodes a run consists of, and the parameters each starts with.

A package of its own may bring a node by an entry point of the group `atpid.nodes`, of the node's name: the core has
such a node's topics, supervises it and says when it is part of a run; its package has the executable, the parameter
file, and what a run sets in it. Entry points are read only where a run has such a node: that takes 0.1 s.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory

from atpid_common.cli import load
from atpid_common.entry_points import installed, loaded
from atpid_common.errors import not_installed
from atpid_common.files import Document
from atpid_common.injected_faults import CEILING, LINK, RECORDER
from atpid_common.parameters import Entry
from atpid_control.stand.parameters import BenchError, Parameters, combined, read_parameters
from atpid_sim.scene import Scene


@dataclass(frozen=True)
class Part:
    """One node of the graph: an executable of a package, and its parameter file.

    That is one of the package, or a user's, by its absolute path; "": it has none.
    """

    package: str
    name: str
    config: str

    @property
    def executable(self) -> Path:
        """What `ros2 run` starts; raises BenchError where the workspace is not built."""
        return _built(Path(_found(get_package_prefix, self.package)) / "lib" / self.package / self.name)

    @property
    def config_file(self) -> Path:
        """Its parameter file; raises BenchError where the workspace is not built."""
        return Path(_found(get_package_share_directory, self.package)) / "config" / self.config

    def configured(self) -> Document:
        """Return the parameters of its file. Raises BenchError or FileError where there is none for it."""
        return read_parameters(self.config_file, [self.name])[self.name] if self.config else {}


def _built(path: Path) -> Path:
    """Return a path of the workspace; raise BenchError where it is not built."""
    if not path.exists():
        raise BenchError(f"{path} is missing: build the workspace with `make setup`")
    return path


def _found(where: Callable[[str], object], package: str) -> str:
    """Return what the function `where` finds of a package; raise BenchError where the package is not on the path."""
    try:
        return str(where(package))
    except (PackageNotFoundError, OSError):
        raise BenchError(f"package {package} is not on the path: `make setup`, then `. ros2_ws/activate`") from None


#: Group of the entry points; the name of one is the name of its node, its value an `AddedPart`.
GROUP = "atpid.nodes"
#: The node that puts out an excitation that is commanded: from `excitation/command` to `excitation/state`.
EXCITER = "excitation_node"
#: The package that brings a node, by the node's name: of extensions of this project, installed or not.
_BROUGHT_BY = Path(__file__).parents[1] / "data" / "nodes.json"


@dataclass(frozen=True)
class AddedPart:
    """A node that a package adds to bench and stand, and what a run sets in it.

    table: the node's parameters, rows of `atpid_common.parameters`, as "module:name".
    simulated: returns what the simulated bench sets in it for a scene.
    emulated: returns what the emulated stand sets in it, and in feed_node, which passes its output on to the plant:
    for the scene, a folder for files, and what is set already, by `simulated` and by the user.
    """

    part: Part
    table: str
    simulated: Callable[[Scene], Document]
    emulated: Callable[[Scene, Path, Document], tuple[Document, Document]]


@cache
def added_part(name: str) -> AddedPart:
    """Return the node of this name. Raises BenchError: no installed package has it, several do, or it does not load."""
    points = installed(GROUP, error=BenchError)
    if name not in points:
        raise BenchError(_missing(name))
    part = loaded(points[name], error=BenchError)
    if not isinstance(part, AddedPart):
        raise BenchError(f"{name} of {points[name].value} is a {type(part).__name__}: it must be an AddedPart")
    return part


def is_installed(name: str) -> bool:
    """Return whether a package has the node of this name; nothing is imported."""
    return name in installed(GROUP, error=BenchError)


def _missing(name: str) -> str:
    """Return the line on a node that no installed package has: which package brings it."""
    brought: dict[str, str] = json.loads(_BROUGHT_BY.read_text(encoding="utf-8"))
    if name not in brought:
        return f"no installed package has {name}"
    return f"{name} comes with {not_installed(brought[name])}"


def table_of(name: str) -> tuple[Entry, ...]:
    """Return the parameters of a node that a package adds. Raises BenchError as `added_part` does."""
    table: tuple[Entry, ...] = load(added_part(name).table)
    return table


#: Speed of a ceiling for which no speed is given: the standard bench's [m/s].
_USUAL_SPEED = 0.3


PARTS = (
    Part("atpid_sim", "plant_node", "plant.yaml"),
    Part("atpid_control", "identifier_node", "identifier.yaml"),
    Part("atpid_control", "selector_node", "selector.yaml"),
    Part("atpid_driver", "motor_node", "motor.yaml"),
    Part("atpid_control", "recorder_node", "recorder.yaml"),
)
NODES = {part.name: part for part in PARTS}
#: What hardware and simulation have in common, the recorder last.
LOOP = tuple(NODES[name] for name in ("identifier_node", "selector_node", "recorder_node"))
#: What supervises them in real time; in lockstep nothing depends on a clock, and nothing is supervised.
SUPERVISOR = Part("atpid_control", "supervisor_node", "supervisor.yaml")
#: Of the bench in real time, in the order of stopping: the motor first.
REAL_TIME_PARTS = (NODES["motor_node"], SUPERVISOR, *(part for part in PARTS if part.name != "motor_node"))
#: What shows them to the operator: no other node needs it, and the run goes on without it.
LIVE = Part("atpid_control", "live_node", "live.yaml")
#: Those of the stand.
LABJACK = Part("atpid_driver", "labjack_node", "labjack.yaml")
NI = Part("atpid_driver", "ni_node", "ni.yaml")
SERIAL_MOTOR = Part("atpid_driver", "motor_node", "motor_serial.yaml")
#: Of the emulated stand: what passes the plant's signals on to the device.
FEED = Part("atpid_driver", "feed_node", "")
#: Silence of a node that stops an exciter [s].
_EXCITED = 0.3
#: Names for which a parameter file may have values, whichever of them a run has.
NAMES = (*(part.name for part in (*REAL_TIME_PARTS, LIVE, LABJACK, NI, FEED)), EXCITER)


def parts_of(scene: Scene, *, lockstep: bool) -> tuple[Part, ...]:
    """Return the nodes of the simulated bench for a scene, in real time in the order of stopping.

    Raises BenchError where the scene's excitation is commanded and no installed package has the node for it.
    """
    parts = PARTS if lockstep else REAL_TIME_PARTS
    # what moves comes first, and what records comes last
    return (parts[0], *exciter_of(scene), *parts[1:])


def exciter_of(scene: Scene) -> tuple[Part, ...]:
    """Return what excites the structure, where the scene has it commanded. Raises BenchError: no package has it."""
    return (added_part(EXCITER).part,) if scene.excitation.is_commanded else ()


def devices_of(args: argparse.Namespace) -> list[Part]:
    """Return the stand's devices, those that move first, each with the user's parameter file where one is given.

    Raises BenchError where an exciter is to be driven and no installed package has its node.
    """
    exciter = [(added_part(EXCITER).part, args.excitation_config)] if args.excitation_config else []
    read = [(LABJACK, args.labjack_config), *([(NI, args.ni_config)] * args.ni)]
    given = [(SERIAL_MOTOR, args.motor_config), *exciter, *read]
    return [replace(part, config=str(file.absolute())) if file else part for part, file in given]


def parameters_for(
    scene: Scene,
    scene_file: Path,
    height_map: Path | None,
    bag: Path,
    *,
    lockstep: bool,
    given: Parameters | None = None,
) -> Parameters:
    """Return what each node of the simulated bench starts with; `given`: values of the user's parameter file.

    Raises SceneError for faults that cannot be injected there.
    """
    own = own_parameters(scene, scene_file, height_map, bag, lockstep=lockstep)
    return combined(usual_parameters(parts_of(scene, lockstep=lockstep), scene), own, given or {})


def usual_parameters(parts: Iterable[Part], scene: Scene) -> Parameters:
    """Return the parameters of the parts' files; where a force drives the scene the identifier reads its load cell."""
    usual = {part.name: part.configured() for part in parts}
    if scene.drive == "force":
        identifier = usual["identifier_node"]
        identifier["support_channel"] = scene.driven_by.channel
        identifier["least_amplitude"] *= scene.beam.stiffness  # the force that moves the structure by as much
    return usual


def given_parameters(args: argparse.Namespace) -> Parameters:
    """Return the values of the user's parameter file, none without one. Raises FileError, SceneError or BenchError."""
    return read_parameters(args.params_file, NAMES, args.namespace or "") if args.params_file else {}


def own_parameters(
    scene: Scene, scene_file: Path, height_map: Path | None, bag: Path, *, lockstep: bool, link: bool = False
) -> Parameters:
    """Return what the scene and the run set in each node of the bench.

    link: whether there is a serial link, into which faults can be injected. Raises SceneError for others.
    """
    scene.require_faults_fit()
    if not link:
        scene.refuse_faults("the simulated bench, which has no serial link,", LINK)
    if lockstep:
        scene.refuse_faults("the bench in lockstep, whose recorder is no process,", RECORDER)
    parameters: Parameters = {"identifier_node": {"lockstep": lockstep}}
    parameters["plant_node"] = {"scene": str(scene_file), "lockstep": lockstep, "expect_recorder": True}
    parameters["selector_node"] = {"scene": str(scene_file), "map": str(height_map or ""), "lockstep": lockstep}
    motor = {"backend": "simulated", "lockstep": lockstep}
    # the ceiling stands where the plant's does, also for a motor node that is started again in mid-run
    parameters["motor_node"] = motor | ceiling_parameters(scene) | {"initial_height": math.nan}
    if injected := [str(fault) for fault in scene.injected if fault.part in CEILING]:
        parameters["motor_node"] |= {"faults": injected}
    parameters["recorder_node"] = {"bag": str(bag), "scene": str(scene_file), "lockstep": lockstep}
    if scene.excitation.is_commanded:
        own = added_part(EXCITER).simulated(scene)
        parameters[EXCITER] = own | {"lockstep": lockstep, "supervised": not lockstep}
    if not lockstep:
        parameters["motor_node"]["supervised"] = True
        parameters[SUPERVISOR.name] = supervised(parts_of(scene, lockstep=True), scene, scene_file)
    return parameters


def stand_parameters(parts: Iterable[Part], scene_file: Path, height_map: Path | None) -> Parameters:
    """Return what a run sets in the nodes of a stand, `parts`."""
    named = {"scene": str(scene_file.absolute())}
    others = [part.name for part in parts if part.name not in (SUPERVISOR.name, LIVE.name)]
    moving: Parameters = {name: {"supervised": True} for name in (SERIAL_MOTOR.name, EXCITER)}
    own = {SUPERVISOR.name: named | answering(others), "selector_node": named | {"map": str(height_map or "")}}
    return moving | own


def supervised(parts: Iterable[Part], scene: Scene, scene_file: Path) -> Document:
    """Return what a run sets in the supervisor: all of its nodes have to answer.

    A scene with faults is run with them: its loop is not checked.
    """
    own: Document = answering(part.name for part in parts) | {"scene": str(scene_file)}
    return own | ({"check_time": 0.0} if scene.injected else {})


def answering(nodes: Iterable[str]) -> Document:
    """Return which nodes have to answer. With an exciter all of a stand are needed, and it is off in half a second.

    What simulates or emulates it ends before the others.
    """
    names = list(nodes)
    if EXCITER not in names:
        return {"nodes": names}
    needed = [name for name in names if name not in ("plant_node", FEED.name)]
    return {"nodes": names, "needed": needed, "answer_time": _EXCITED}


def ceiling_parameters(scene: Scene) -> dict[str, float]:
    """Return limits, speed and initial height of the simulated ceiling [m, m/s]."""
    heights = scene.ceiling.heights
    if scene.ceiling.controlled:
        low, high = scene.ceiling.range
        speed = scene.ceiling.speed
    else:
        low, high = 2.0 * scene.grain.radius, max(height for _, height in heights)
        steps = pairwise(heights)
        speed = max((abs(h1 - h0) / (t1 - t0) for (t0, h0), (t1, h1) in steps), default=0.0) or _USUAL_SPEED
    # a range of no width would exclude its own end
    high = math.nextafter(high, math.inf) if high <= low else high
    return {"lowest": low, "highest": high, "speed": speed, "initial_height": heights[0][1]}


def program() -> Path:
    """Return the program `atpid` of this workspace; raise BenchError where it is not built."""
    return _built(Path(_found(get_package_prefix, "atpid_control")) / "bin" / "atpid")


def enclave_of(node: str) -> str:
    """Return the enclave, by whose key and certificate a node is known, of a node of this name."""
    return f"/atpid/{node}"
