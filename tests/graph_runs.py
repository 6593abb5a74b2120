# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the whole-graph tests share: short scenes, runs of the graph without a report, and waiting for events."""

import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.testing import wait_for
from atpid_control.runs.read import Bag, open_bag
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import run_lockstep
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import parameters_for, parts_of
from atpid_control.stand.running import commands_of, run_realtime
from atpid_sim.scene import Scene, load_scene


def scene_file(source: Path, folder: Path, **changes: Any) -> Path:
    """Write the scene `source` with some keys changed; return the new file."""
    path = folder / "scene.yaml"
    path.write_text(load_scene(source).with_(**changes).to_yaml())
    return path


def parameters(path: Path, out: Path, *, lockstep: bool) -> tuple[Scene, dict[str, dict[str, Any]]]:
    """Return the scene and what its nodes start with."""
    scene = load_scene(path)
    out.mkdir(exist_ok=True)
    return scene, parameters_for(scene, path.resolve(), map_for(scene), out / "bag", lockstep=lockstep)


def in_lockstep(path: Path, out: Path, progress: Callable[[float], None] = lambda _: None) -> Bag:
    """Run the graph in this process; return its bag."""
    _, started = parameters(path, out, lockstep=True)
    with own_domain():
        run_lockstep(started, progress)
    return open_bag(out / "bag")


def in_real_time(path: Path, out: Path, progress: Callable[[float], None] = lambda _: None) -> Bag:
    """Run the graph as processes; return its bag."""
    scene, started = parameters(path, out, lockstep=False)
    write_parameters(started, out / "parameters.yaml")
    with own_domain():
        commands = commands_of(out / "parameters.yaml", parts_of(scene, lockstep=False))
        run_realtime(commands, out, progress, faults=scene.injected)
    return open_bag(out / "bag")


def decoded(bag: Bag, topic: str) -> list[Any]:
    """Return the messages of one topic as nested plain values, NaN as text so that they compare."""
    return [_plain(message) for _, message in bag.messages(topic)]


def _plain(value: Any) -> Any:
    if hasattr(value, "__dataclass_fields__"):
        return {name: _plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return repr(value) if isinstance(value, float) else value


def started(*arguments: str) -> subprocess.Popen[str]:
    """Start `atpid` with these arguments."""
    piped: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": without_domain()}
    return subprocess.Popen(["atpid", *arguments], text=True, **piped)


def without_domain() -> dict[str, str]:
    """Return the environment without this session's ROS domain, which it keeps: a bench then chooses a free one."""
    return {key: value for key, value in os.environ.items() if key != "ROS_DOMAIN_ID"}


def wait_until(happened: Callable[[], bool], process: subprocess.Popen[Any] | None = None) -> None:
    """Wait for an event; fail when it does not come, or when `process` ends without it."""

    def turn() -> None:
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.02)

    wait_for(happened, turn=turn)
