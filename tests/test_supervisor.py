# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor in the real-time bench: nodes that hang or end, levels that are passed, the operator's stop."""

import math
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingState, Event, SupervisorState
from graph_runs import scene_file
from std_srvs.srv import Trigger
from supervised_graph import Supervised

from atpid_control.runs.read import open_bag
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import NodeDiedError

pytestmark = pytest.mark.slow

#: Longer than all tests take together.
STEADY = {"duration": 900.0, "steady_window": [890.0, 900.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [900.0, 0.015]]}
WIDER = {"closed": 0.017, "range": [0.017, 1.4], "speed": 0.3, "controller": "lookup"}
#: Silence after which a run is given up, of a node that is started again meanwhile [s].
GIVE_UP = 8.0
Start = Callable[..., Supervised]


@pytest.fixture(scope="module")
def graph(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Supervised]:
    """The nodes of one bench, which get one supervisor after the other, in the order of the tests."""
    with own_domain():
        rclpy.init()
        made = Supervised(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("graph"), **STEADY)
        made.nodes.__enter__()
        made.until(lambda: made.watch.plant)  # until then a motor that may move seeks its height, which is on-time
        yield made
        made.close()
        rclpy.try_shutdown()


@pytest.fixture
def start(graph: Supervised) -> Iterator[Start]:
    def begin(moving: bool = True, **supervisor: Any) -> Supervised:
        """Return the nodes, once the ceiling is held or moves with a new supervisor's permission, or at once."""
        graph.supervise(**supervisor)
        if moving:
            graph.until(lambda: graph.watch.state.state == SupervisorState.READY)
            graph.arm("supervisor_node/rearm")  # which activates it where a test before has stopped it
        return graph

    yield begin
    graph.unsupervise()


def test_a_level_that_is_passed_switches_the_motor_off_and_so_does_the_operator_until_a_rearm(start: Start) -> None:
    """The first test: the ceiling is still closed, and travels for 0.9 s once it may."""
    running = start(moving=False, beam_displacement_warning=0.002, motor_on_time_abort=0.6)
    watch = running.watch
    running.until(lambda: watch.when(Event.ABORT, "motor_on_time"))
    running.until(lambda: watch.mode == CeilingState.DISARMED)
    running.until(lambda: watch.when(Event.LIMIT, "beam_displacement"))
    assert watch.state.stop
    assert "motor_on_time" in watch.state.reason
    height = watch.ceiling[-1].height
    running.spin(0.5)
    assert (watch.mode, watch.ceiling[-1].height) == (CeilingState.DISARMED, height)
    running.arm("supervisor_node/rearm")
    asked = time.monotonic()
    assert running.call(Trigger, "supervisor_node/stop").success
    running.until(lambda: watch.mode == CeilingState.DISARMED)
    print(f"stop by service of the supervisor to motor off: {time.monotonic() - asked:.3f} s")
    assert watch.when(Event.STOPPED)


def test_a_loop_that_fails_its_check_is_refused_with_what_failed(scenes: Path, tmp_path: Path, start: Start) -> None:
    other = scene_file(scenes / "thesis_4_3.yaml", tmp_path, ceiling=WIDER)
    running = start(moving=False, scene=str(other), check_time=3.0)
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.status == 2
    expected = "loop check: ceiling: scene 0.017 to 1.4 m, motor node 0.017 to 1 m; allowed: a scene inside the motor's"
    assert supervisor.reason().startswith(expected)
    running.until(lambda: running.watch.when(Event.ABORT, expected))
    # off, or never on where the check failed before the motor was armed
    running.until(lambda: running.watch.mode not in (CeilingState.MOVING, CeilingState.HOLDING))


def test_a_needed_node_that_stays_away_ends_the_run_with_its_name(start: Start) -> None:
    running = start(give_up=1.0)
    running.nodes["selector_node"].process.send_signal(signal.SIGSTOP)
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.status == 2
    assert supervisor.reason() == "selector_node has not answered for 1 s: the run ends"
    running.nodes["selector_node"].process.send_signal(signal.SIGCONT)


def test_a_node_whose_replacement_does_not_come_ends_the_run_with_its_name(start: Start) -> None:
    running = start(give_up=1.0, restart_time=3.0)
    running.nodes["selector_node"].process.kill()
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.reason() == "selector_node has not answered for 3 s: the run ends"


def test_nodes_that_hang_or_end_are_named_the_ceiling_held_and_the_motor_off(start: Start, graph: Supervised) -> None:
    """The last test, as the bench where nodes are started again: it ends all nodes, and reads the bag."""
    if graph.nodes["selector_node"].status is not None:  # by the test above
        graph.again("selector_node")
    running = start(give_up=GIVE_UP, restart_time=60.0)
    a_motor_that_is_started_again_does_not_move_the_ceiling(running)
    one_that_hangs_is_named(running, "recorder_node")
    killed_and_started_again(running, "selector_node")
    checked = running.call(Trigger, "supervisor_node/check")
    assert (checked.success, checked.message) == (True, "loop check passed")
    running.close_nodes()
    bag = open_bag(running.folder / "bag")
    assert "selector_node answers again" in " ".join(event.text for _, event in bag.messages("/events"))
    assert "recorder_node does not answer" in " ".join(event.text for _, event in bag.messages("/events"))
    states = {message.state for _, message in bag.messages("/supervisor/state")}
    assert {SupervisorState.READY, SupervisorState.FAULT} <= states


def a_motor_that_is_started_again_does_not_move_the_ceiling(running: Supervised) -> None:
    watch = running.watch

    def settled() -> bool:
        """Whether the ceiling has been opened and is at rest."""
        return bool(watch.mode == CeilingState.HOLDING and watch.true) and (
            watch.true[-1] == watch.ceiling[-1].height > 0.2
        )

    running.until(settled)
    height, before = watch.true[-1], len(watch.true)
    running.nodes["motor_node"].stop()
    running.spin(0.1)  # what it has still published
    seen = len(watch.ceiling)
    running.again("motor_node")
    running.until(lambda: any(state.mode == CeilingState.HOLDING for state in watch.ceiling[seen:]))
    blocks = len(watch.true)
    running.until(lambda: len(watch.true) >= blocks + 20)
    # nowhere but where it was and where the selector, which may just have been started again, has sent it since
    lowest = min([height, *(asked for asked in watch.asked if not math.isnan(asked))]) - 1e-6
    assert lowest > 0.2
    assert min(watch.true[before:]) > lowest
    assert min(state.height for state in watch.ceiling[seen:] if not math.isnan(state.height)) > lowest
    running.until(lambda: watch.state.state == SupervisorState.READY)
    running.arm()


def one_that_hangs_is_named(running: Supervised, name: str) -> None:
    """Let a node hang: the motor stays off when it is back, until a person arms it."""
    watch = running.watch
    running.nodes[name].process.send_signal(signal.SIGSTOP)
    hung = time.monotonic()
    running.until(lambda: watch.when(Event.STALE, f"{name} does not answer") > hung)
    # 0.45 s of the supervisor's own time; the rest for a machine with other work
    assert watch.when(Event.STALE, f"{name} does not answer") - hung < 2.0
    named = [event.value for at, event in watch.events if at > hung and f"{name} does not answer" in event.text]
    assert named[0] <= 0.5
    running.until(lambda: watch.state.state == SupervisorState.FAULT and not watch.state.permit)
    running.until(lambda: watch.mode == CeilingState.FAULT)
    height = watch.ceiling[-1].height
    running.nodes[name].process.send_signal(signal.SIGCONT)
    running.until(lambda: watch.state.state == SupervisorState.READY)
    running.spin(1.0)
    assert watch.mode == CeilingState.FAULT, "a person arms it, not the node that is back"
    assert watch.ceiling[-1].height == height
    running.arm()


def killed_and_started_again(running: Supervised, name: str) -> None:
    """Kill a node: it is started again once, and the motor stays off until a person arms it.

    Its replacement is stopped while it loads, as on a busy machine, for longer than a node may hang. That time counts
    again from when it has loaded, in which discovery alone takes seconds on a busy machine.
    """
    watch, supervisor = running.watch, running.nodes["supervisor_node"]
    killed = time.monotonic()
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    lines = running.nodes.check("")
    assert lines == [f"{name} ended with status -9 and is started again, which may take 60 s; 0 restarts are left"]
    running.nodes[name].process.send_signal(signal.SIGSTOP)
    running.until(lambda: watch.state.state == SupervisorState.FAULT)
    place = list(watch.state.nodes).index(name)
    running.until(lambda: watch.state.silence[place] > GIVE_UP + 1.0)
    assert supervisor.status is None
    running.nodes[name].process.send_signal(signal.SIGCONT)
    running.until(lambda: watch.when(Event.RESUMED, f"{name} answers again") > killed)
    running.until(lambda: watch.state.state == SupervisorState.READY)
    assert supervisor.status is None
    assert watch.when(Event.STALE, f"{name} has ended") > killed
    assert watch.mode == CeilingState.FAULT
    height, seen = watch.ceiling[-1].height, len(watch.ceiling)
    running.arm()
    # where it stands as it is armed: what the controller commands next moves it by 0.3 m in each second
    armed = next(state for state in watch.ceiling[seen:] if state.mode in (CeilingState.MOVING, CeilingState.HOLDING))
    assert armed.height == pytest.approx(height, abs=0.05)
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    with pytest.raises(NodeDiedError, match=f"{name} ended with status -9"):
        running.nodes.check("")
