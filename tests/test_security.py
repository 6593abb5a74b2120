# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Security (docs/security.md): the policy is that of the nodes, DDS is on the loopback, an intruder moves nothing."""

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingCommand, Event
from graph_runs import parameters, scene_file
from spun import Spun

from atpid_control.cli import main
from atpid_control.runs.read import Bag, open_bag
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes import policy
from atpid_control.stand.nodes.policy import OPERATOR, Rights
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.running import commands_of, run_realtime
from atpid_lab.nodes.foxglove_node import Server, ServerError

#: Height the intruder commands [m]; the scene's own heights are others.
FOREIGN = 0.95
#: Nodes that are named where two command the ceiling.
INTRUSION = {"/intruder", "/selector_node"}
#: Ports from here on are the system's own choice (Linux, ip_local_port_range).
EPHEMERAL = 32768
#: Those of the stand that the bench runs as well.
NODES = {"identifier_node", "selector_node", "motor_node", "recorder_node", "supervisor_node"}
#: Commands it sends, at least.
MESSAGES = 20
#: What is opened in the bench beside what the policy of the stand names, and what is not, without hardware.
SIMULATED = {
    "motor_node": Rights(subscribe={"/plant/truth"}),
    "supervisor_node": Rights(request={"/plant_node/get_parameters"}),
}
ON_THE_STAND = {
    "supervisor_node": Rights(
        request={"/labjack_node/get_state", "/ni_node/get_state"}
        | {f"/excitation_node/{service}" for service in ("change_state", "get_state", "stop")}
    )
}


@pytest.fixture(scope="module")
def kept(root: Path) -> str:
    return (root / "atpid_control/config/security/stand.policy.xml").read_text()


def test_the_policy_is_that_of_the_nodes(kept: str, scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """After a change of the nodes: `make policy`."""
    assert main(["policy", str(scenes / "stand_realtime.yaml")]) == 0
    assert capsys.readouterr().out == kept


def read_policy(text: str) -> dict[str, Rights]:
    found: dict[str, Rights] = {}
    for profile in ElementTree.fromstring(text).iter("profile"):
        rights = found.setdefault(str(profile.get("node")), Rights())
        for element in profile:
            for kind in element.attrib:
                getattr(rights, kind).update(str(item.text) for item in element)
    return found


def who(rights: dict[str, Rights], kind: str, name: str) -> set[str]:
    return {node for node, one in rights.items() if name in getattr(one, kind)}


def test_only_the_selector_commands_and_an_operator_or_the_supervisor_for_him_arms(kept: str) -> None:
    assert not set("*?[") & set(kept.partition("<profiles>")[2])
    rights = read_policy(kept)
    sole = {
        "/ceiling/command": "selector_node", "/ceiling/state": "motor_node", "/excitation": "identifier_node",
        "/sensors/laser": "labjack_node", "/sensors/accelerometer": "ni_node", "/supervisor/state": "supervisor_node",
    }  # fmt: skip
    assert {topic: who(rights, "publish", topic) for topic in sole} == {topic: {node} for topic, node in sole.items()}
    allowed = {
        "/motor_node/rearm": {OPERATOR, "supervisor_node"},  # by the supervisor where an operator has asked it to
        "/excitation_node/rearm": {OPERATOR, "live_node"},
        "/motor_node/change_state": {OPERATOR},
        "/excitation_node/change_state": {OPERATOR},
        "/motor_node/set_parameters": {OPERATOR},
        "/motor_node/set_parameters_atomically": {OPERATOR},
        "/motor_node/stop": {OPERATOR, "live_node", "supervisor_node"},
        "/supervisor_node/stop": {OPERATOR, "live_node"},  # whose page an operator uses
        "/supervisor_node/rearm": {OPERATOR, "live_node"},
    }
    assert {service: who(rights, "request", service) for service in allowed} == allowed
    assert rights[OPERATOR].publish == {"/rosout", "/parameter_events"}
    asked = {name.rpartition("/")[2] for name in rights["recorder_node"].request}
    assert asked == {"list_parameters", "get_parameters"}


@dataclass
class Watched:
    """What was seen of a bench in real time, into which an intruder came."""

    opened: dict[str, Rights] = field(default_factory=dict)
    received_on: dict[str, set[str]] = field(default_factory=dict)  # addresses of a process's ports, by process
    reported: bool = False
    bag: Any = None


class Intruder:
    """Looks at the graph, and commands the ceiling although it may not, until that is reported."""

    def __init__(self, watched: Watched) -> None:
        self.watched = watched
        self.spun: Spun | None = None
        self.sent, self.finished = 0, False

    def __call__(self, reached: float) -> None:
        if self.finished:
            return
        if self.spun is None:
            self.spun = Spun("intruder")
            self.commands = self.spun.node.create_publisher(CeilingCommand, "ceiling/command", 1)
            self.spun.node.create_subscription(Event, "events", self.on_event, 100)
        elif self.sent < MESSAGES or not self.watched.reported:
            self.spun.executor.spin_once(timeout_sec=0.0)
            if self.commands.get_subscription_count() == 2:  # motor and recorder
                self.commands.publish(CeilingCommand(height=FOREIGN, sequence=1))
                self.sent += 1
        elif set(self.spun.node.get_node_names()) >= NODES:
            self.watched.received_on = {str(process): addresses(process) for process in below(os.getpid())}
            self.watched.opened = {name: policy.opened(self.spun.node, name) for name in sorted(NODES)}
            self.close()

    def on_event(self, event: Event) -> None:
        self.watched.reported |= event.kind == Event.REFUSED and set(re.findall(r"/\w+", event.text)) >= INTRUSION

    def close(self) -> None:
        if self.spun is not None and not self.finished:
            self.spun.close()
        self.finished = True


def below(process: int) -> list[int]:
    """Return the processes below this one."""
    tasks = Path(f"/proc/{process}/task").iterdir()
    children = [int(child) for task in tasks for child in (task / "children").read_text().split()]
    return children + [each for child in children for each in below(child)]


def addresses(process: int) -> set[str]:
    """Return the addresses on which a process has opened UDP ports below the ephemeral ones, from which DDS sends."""
    links = [os.readlink(file) for file in Path(f"/proc/{process}/fd").iterdir()]
    sockets = {link[8:-1] for link in links if link.startswith("socket:[")}
    found = set()
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        words = line.split()
        address, _, port = words[1].partition(":")
        if words[9] in sockets and int(port, 16) < EPHEMERAL:
            found.add(address)
    return found


@pytest.fixture(scope="module")
def watched(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("security")
    scene = scene_file(scenes / "thesis_4_3.yaml", folder, duration=8.0, steady_window=[7.0, 8.0])
    _, started = parameters(scene, folder / "run", lockstep=False)
    write_parameters(started, folder / "run" / "parameters.yaml")
    made = Watched()
    intruder = Intruder(made)
    with own_domain():
        try:
            run_realtime(commands_of(folder / "run" / "parameters.yaml"), folder / "run", intruder)
        finally:
            intruder.close()
    made.bag = open_bag(folder / "run" / "bag")
    return made


def test_an_unauthorised_publisher_moves_nothing_and_is_named(watched: Watched) -> None:
    bag: Bag = watched.bag
    foreign = [ns for ns, message in bag.messages("/ceiling/command") if message.height == FOREIGN]
    assert len(foreign) > MESSAGES // 2  # it was in the graph; a busy recorder misses some of a topic that keeps one
    assert not any(abs(state.target - FOREIGN) < 0.01 for _, state in bag.messages("/ceiling/state"))
    events = list(bag.messages("/events"))
    refused = [event for _, event in events if event.kind == Event.REFUSED]
    assert [event.severity for event in refused] == [Event.ALARM]
    assert set(re.findall(r"/\w+", refused[0].text)) >= INTRUSION
    # the ceiling stays meanwhile, and follows the selector again when the intruder has left
    moved = [ns for ns, event in events if event.kind == Event.MOVED]
    assert not [ns for ns in moved if foreign[0] < ns < foreign[-1]]
    assert max(moved) > foreign[-1]


def test_each_right_of_the_policy_is_used_by_the_graph_and_no_other_is_needed(watched: Watched, kept: str) -> None:
    rights = read_policy(kept)
    for name, opened in watched.opened.items():
        missing = opened - rights[name] - SIMULATED.get(name, Rights())
        assert not missing, f"{name} needs {missing}"
        unused = rights[name] - opened - policy.LATER.get(name, Rights()) - ON_THE_STAND.get(name, Rights())
        if name == "recorder_node":  # it gets a node's parameters once and then needs no client any more
            unused.request.clear()
        assert not unused, f"{name} does not need {unused}"


def test_dds_receives_on_the_loopback_only(watched: Watched) -> None:
    found = [one for one in watched.received_on.values() if one]
    assert len(found) >= 5
    assert set.union(*found) == {"0100007F"}


def test_a_viewer_is_served_on_this_machine_only() -> None:
    with closing(Server(0)) as server, open("/proc/net/tcp", encoding="ascii") as table:
        rows = [line.split() for line in table][1:]
        listening = {row[1] for row in rows if row[3] == "0A" and int(row[1].partition(":")[2], 16) == server.port}
        assert listening == {f"0100007F:{server.port:04X}"}
        with pytest.raises(ServerError, match=rf"\b{server.port}\b.*port"):
            Server(server.port)


def test_a_node_without_keys_does_not_start_where_security_is_enforced(tmp_path: Path) -> None:
    environment = os.environ | {
        "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(tmp_path),
    }  # fmt: skip
    command = [sys.executable, "-m", "atpid_control.nodes.identifier_node"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 2
    assert len([line for line in done.stderr.splitlines() if line.startswith("error: ")]) == 1
    assert "Traceback" not in done.stderr
