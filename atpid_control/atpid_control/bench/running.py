# SPDX-License-Identifier: Apache-2.0
"""Runs the graph: in lockstep, all nodes in this process, or in real time, each node a process as on the stand.

Only nodes/ imports rclpy; it is imported when a run begins, so that this module is read and tested without it.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from atpid_common.waiting import to_stderr
from atpid_control.bench.stop_key import stop_key
from atpid_control.graph import BenchError, PlantFailedError
from atpid_control.graph.parts import PARTS, REAL_TIME_PARTS, Parameters
from atpid_control.graph.processes import Processes
from atpid_control.security import enclave_arguments


@contextmanager
def shown(duration: float, label: str) -> Iterator[Callable[[float], None]]:
    """Yield a function that shows the time reached [s] of `duration` [s]; the bar goes to standard error."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:5.1f} of {task.total:g} s"),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=duration, speed="")
        begun: float | None = None

        def update(reached: float) -> None:
            nonlocal begun
            now = time.monotonic()
            begun = now if begun is None else begun
            speed = f"{reached / (now - begun):.1f} x real time" if now > begun else ""
            bar.update(task, completed=min(reached, duration), speed=speed)

        yield update


#: Five interpreters load their libraries, and after an update compile their kernels, before the first handshake [s].
_START_TIMEOUT = 180.0
#: Data may stop for so long before the run is ended [s].
_LOOP_TIMEOUT = 20.0
_FAILED = 3


def run_lockstep(
    parameters: Parameters, progress: Callable[[float], None], follow: Callable[[float, Any], None] | None = None,
    calls: Sequence[tuple[float, str]] = (),
) -> None:  # fmt: skip
    """Run the graph until the plant has finished; `progress` is called with the simulated time [s].

    The next block follows as soon as the loop has answered the last. `follow` and `calls`: see
    `atpid_control.nodes.composition.run_lockstep`. Raises PlantFailedError where the plant fails,
    BenchError where the loop stops.
    """
    from atpid_control.nodes import composition

    composition.run_lockstep([(part.package, part.name) for part in PARTS], parameters, progress, follow, calls)


def commands_of(parameter_file: Path) -> list[tuple[str, list[str]]]:
    """Return (name, command) of every node of the simulated stand, in the order of stopping: the motor first."""
    words = ["--params-file", str(parameter_file)]
    return [
        (part.name, [str(part.executable), "--ros-args", *enclave_arguments(part.name), *words])
        for part in REAL_TIME_PARTS
    ]


def keep_running(nodes: Processes) -> None:
    """Run the nodes until Ctrl-C, which passes through; raises NodeDiedError where one ends by itself."""
    from atpid_control.nodes.composition import watching

    with watching(lambda _text: None) as (watch, listen), stop_key(watch.stop_motor):
        while True:
            _check(nodes, watch, except_for="")
            listen()


def _check(nodes: Processes, watch: Any, except_for: str) -> None:
    for text in nodes.check(except_for):
        to_stderr(text)
        watch.restarted(text)


def run_realtime(
    commands: Sequence[tuple[str, list[str]]], logs: Path, progress: Callable[[float], None], *,
    source: str = "plant_node", namespace: str = "", follow: Callable[[float, Any], None] | None = None,
    calls: Sequence[tuple[float, str]] = (), restarts: int = 0,
) -> None:  # fmt: skip
    """Run the graph until the node `source` has ended; `progress` is called with the data time [s].

    `follow` and `calls`: see `atpid_control.nodes.composition.BenchWatch`.

    What the nodes wait for, or compile, before the first estimate goes to standard error. Raises NodeDiedError, at
    once and with its reason, where a node ends early; PlantFailedError where the plant fails, BenchError where data
    stop. KeyboardInterrupt passes through after all nodes have been stopped and the bag is closed.
    """
    from atpid_control.nodes.composition import watching

    moves = any(name == "motor_node" for name, _ in commands)  # a replay has no motor
    with (
        Processes(commands, logs, restarts=restarts) as nodes,
        watching(to_stderr, namespace, follow, calls) as (watch, listen),
        stop_key(watch.stop_motor) if moves else nullcontext(),
    ):
        last = nodes[source]
        elapsed, since = 0.0, time.monotonic()
        while last.status is None:
            listen()
            _check(nodes, watch, except_for=source)
            if watch.elapsed != elapsed:
                elapsed, since = watch.elapsed, time.monotonic()
                progress(elapsed)
            elif time.monotonic() - since > (_LOOP_TIMEOUT if elapsed else _START_TIMEOUT):
                raise BenchError(
                    f"no estimate for {time.monotonic() - since:.0f} s, at {elapsed:.1f} s of the run: see {logs}"
                )
        if last.status == _FAILED:
            raise PlantFailedError(watch.failure or last.reason())
        if last.status != 0:
            nodes.check(except_for="")
