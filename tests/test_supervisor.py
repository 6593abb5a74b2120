# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor in the real-time bench: nodes that hang, levels that are passed, the operator's stop."""

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

STEADY = {"duration": 90.0, "steady_window": [80.0, 90.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [90.0, 0.015]]}
WIDER = {"closed": 0.017, "range": [0.017, 1.4], "speed": 0.3, "controller": "lookup"}
Start = Callable[..., Supervised]


@pytest.fixture
def start(scenes: Path, tmp_path: Path) -> Iterator[Start]:
    made: list[Supervised] = []

    def begin(moving: bool = True, **supervisor: Any) -> Supervised:
        """Return the nodes, once the ceiling moves with the supervisor's permission, or as they are started."""
        made.append(Supervised(scenes / "thesis_4_3.yaml", tmp_path, supervisor, **STEADY))
        made[-1].nodes.__enter__()
        if moving:
            made[-1].until(lambda: made[-1].watch.state.state == SupervisorState.READY)
            made[-1].arm()  # where a busy machine missed a beat while the nodes were starting
            made[-1].until(lambda: made[-1].watch.mode in (CeilingState.MOVING, CeilingState.HOLDING))
        return made[-1]

    with own_domain():
        rclpy.init()
        yield begin
        for running in made:
            running.close()
        rclpy.try_shutdown()


def test_a_hung_node_is_named_the_ceiling_held_and_the_motor_off(start: Start, tmp_path: Path) -> None:
    running = start(restart_time=60.0)  # as the bench where nodes are started again
    watch = running.watch
    running.nodes["recorder_node"].process.send_signal(signal.SIGSTOP)
    hung = time.monotonic()
    running.until(lambda: watch.when(Event.STALE, "recorder_node does not answer") > hung)
    # 0.45 s of the supervisor's own time; the rest for a machine with other work
    assert watch.when(Event.STALE, "recorder_node does not answer") - hung < 2.0
    named = next(event.value for _, event in watch.events if "recorder_node does not answer" in event.text)
    assert named <= 0.5
    running.until(lambda: watch.state.state == SupervisorState.FAULT and not watch.state.permit)
    running.until(lambda: watch.mode == CeilingState.FAULT)
    height = watch.ceiling[-1].height
    running.nodes["recorder_node"].process.send_signal(signal.SIGCONT)
    running.until(lambda: watch.state.state == SupervisorState.READY)
    running.spin(1.0)
    assert watch.mode == CeilingState.FAULT, "a person arms it, not the node that is back"
    assert watch.ceiling[-1].height == height
    running.arm()
    killed_and_started_again(running, "selector_node")
    checked = running.call(Trigger, "supervisor_node/check")
    assert (checked.success, checked.message) == (True, "loop check passed")
    running.close_nodes()
    bag = open_bag(tmp_path / "bag")
    assert "selector_node answers again" in " ".join(event.text for _, event in bag.messages("/events"))
    assert "recorder_node does not answer" in " ".join(event.text for _, event in bag.messages("/events"))
    states = {message.state for _, message in bag.messages("/supervisor/state")}
    assert {SupervisorState.READY, SupervisorState.FAULT} <= states


def killed_and_started_again(running: Supervised, name: str) -> None:
    """Kill a node: it is started again once, and the motor stays off until a person arms it."""
    watch = running.watch
    killed = time.monotonic()
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    lines = running.nodes.check("")
    assert lines == [f"{name} ended with status -9 and is started again, which may take 60 s; 0 restarts are left"]
    running.until(lambda: watch.when(Event.RESUMED, f"{name} answers again") > killed)
    running.until(lambda: watch.state.state == SupervisorState.READY)
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


def test_a_level_that_is_passed_switches_the_motor_off_and_so_does_the_operator_until_a_rearm(start: Start) -> None:
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


def test_a_needed_node_that_stays_away_ends_the_run_with_its_name(start: Start) -> None:
    running = start(give_up=1.0)
    running.nodes["selector_node"].process.send_signal(signal.SIGSTOP)
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.status == 2
    assert supervisor.reason() == "selector_node has not answered for 1 s: the run ends"
    running.nodes["selector_node"].process.send_signal(signal.SIGCONT)


def test_a_node_that_is_started_again_may_take_longer_than_one_that_hangs(start: Start) -> None:
    """Its replacement is stopped while it loads, as on a busy machine, for longer than a node may hang.

    That time counts again from when it has loaded, in which discovery alone takes seconds on a busy machine.
    """
    running = start(give_up=5.0, restart_time=60.0)
    watch, name = running.watch, "selector_node"
    killed = time.monotonic()
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    running.nodes.check("")
    running.nodes[name].process.send_signal(signal.SIGSTOP)
    running.until(lambda: watch.state.state == SupervisorState.FAULT)
    place = list(watch.state.nodes).index(name)
    running.until(lambda: watch.state.silence[place] > 6.0)
    assert running.nodes["supervisor_node"].status is None
    running.nodes[name].process.send_signal(signal.SIGCONT)
    running.until(lambda: watch.when(Event.RESUMED, f"{name} answers again") > killed)
    assert running.nodes["supervisor_node"].status is None


def test_a_node_whose_replacement_does_not_come_ends_the_run_with_its_name(start: Start) -> None:
    running = start(give_up=1.0, restart_time=3.0)
    running.nodes["selector_node"].process.kill()
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.reason() == "selector_node has not answered for 3 s: the run ends"


def test_a_loop_that_fails_its_check_is_refused_with_what_failed(scenes: Path, tmp_path: Path, start: Start) -> None:
    (tmp_path / "other").mkdir()
    other = scene_file(scenes / "thesis_4_3.yaml", tmp_path / "other", ceiling=WIDER)
    running = start(moving=False, scene=str(other), check_time=3.0)
    supervisor = running.nodes["supervisor_node"]
    running.until(lambda: supervisor.status is not None)
    assert supervisor.status == 2
    expected = "loop check: ceiling: scene 0.017 to 1.4 m, motor node 0.017 to 1 m; allowed: a scene inside the motor's"
    assert supervisor.reason().startswith(expected)
    running.until(lambda: running.watch.when(Event.ABORT, expected))
    # off, or never on where the check failed before the motor was armed
    running.until(lambda: running.watch.mode not in (CeilingState.MOVING, CeilingState.HOLDING))
