# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes the stand's SROS 2 policy: which node may publish, receive, serve and request what, and nothing else.

Each node is made, not started, and asked what it has opened (docs/security.md).
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import reduce
from operator import or_
from pathlib import Path

from rclpy.context import Context
from rclpy.node import Node

from atpid_common.arguments import file_path, path_to
from atpid_common.errors import DONE
from atpid_common.nodes.node_main import initialise
from atpid_common.output import writing
from atpid_control.selection.map_cache import map_for
from atpid_control.stand import parts
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import make_node
from atpid_control.stand.parameters import Parameters
from atpid_sim.scene import load_scene

#: Version of the policy's form (sros2, policy.xsd).
_VERSION = "0.2.0"
_ACTION = "/_action/"
#: Who is no node of the graph: a person with `ros2`, or with this project's own commands.
OPERATOR = "operator"
_HEAD = (
    " SPDX-License-Identifier: Apache-2.0 ",
    " Made by `atpid policy` from the nodes themselves; do not edit. See docs/security.md. ",
)


@dataclass
class Rights:
    """What one node may do: absolute names."""

    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)  # services
    request: set[str] = field(default_factory=set)
    execute: set[str] = field(default_factory=set)  # actions
    call: set[str] = field(default_factory=set)

    @property
    def actions_folded(self) -> Rights:
        """The same with an action in place of the topics and services it consists of."""
        names = (self.publish, self.subscribe, self.reply, self.request)
        publish, subscribe, reply, request = ({name for name in group if _ACTION not in name} for group in names)
        execute, call = self.execute | _actions(self.reply), self.call | _actions(self.request)
        return Rights(publish, subscribe, reply, request, execute, call)

    def __or__(self, other: Rights) -> Rights:
        return Rights(*(getattr(self, name) | getattr(other, name) for name in self.__dataclass_fields__))

    def __sub__(self, other: Rights) -> Rights:
        return Rights(*(getattr(self, name) - getattr(other, name) for name in self.__dataclass_fields__))

    def __bool__(self) -> bool:
        return any(getattr(self, name) for name in self.__dataclass_fields__)


def _actions(services: Iterable[str]) -> set[str]:
    return {name.partition(_ACTION)[0] for name in services if _ACTION in name}


def _operator_rights(nodes: Iterable[Rights], own: Rights) -> Rights:
    """Return an operator's: sees every topic, may request every service and action, publishes nothing of the graph.

    own: what every node does, whatever its task.
    """
    everything = reduce(or_, nodes, Rights())
    return Rights(subscribe=everything.publish, request=everything.reply, call=everything.execute) | own


#: Element of the policy, of one name in it, and the kinds of right that are its attribute.
_FORM = (
    ("topics", "topic", ("publish", "subscribe")),
    ("services", "service", ("reply", "request")),
    ("actions", "action", ("execute", "call")),
)


def policy(rights: Mapping[str, Rights], namespace: str = "/") -> str:
    """Return the policy as sros2 reads it (`ros2 security generate_artifacts -p FILE`); each node has an enclave."""
    root = ElementTree.Element("policy", version=_VERSION)
    enclaves = ElementTree.SubElement(root, "enclaves")
    for node, allowed in sorted(rights.items()):
        enclave = ElementTree.SubElement(enclaves, "enclave", path=parts.enclave_of(node))
        profiles = ElementTree.SubElement(enclave, "profiles")
        profile = ElementTree.SubElement(profiles, "profile", ns=namespace, node=node)
        for group, item, kinds in _FORM:
            for kind in kinds:
                if names := sorted(getattr(allowed, kind)):
                    element = ElementTree.SubElement(profile, group, {kind: "ALLOW"})
                    for name in names:
                        ElementTree.SubElement(element, item).text = name
    ElementTree.indent(root)
    comments = "\n".join(f"<!--{line}-->" for line in _HEAD)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{comments}\n{ElementTree.tostring(root, encoding="unicode")}\n'


#: What a node opens only while it works, or with other parameters than those of its file.
LATER = {
    "identifier_node": Rights(subscribe={"/ceiling/state"}),  # where it infers from the beam
    "selector_node": Rights(subscribe={"/sensors/laser"}),  # while it searches
}
_LISTED, _READ = "/list_parameters", "/get_parameters"
EXAMPLE = "scenes/stand_realtime.yaml --out atpid_control/config/security/stand.policy.xml"


def stand() -> tuple[parts.Part, ...]:
    """Return the stand's nodes, with what excites it where a package that is installed has that."""
    exciter = (parts.added_part(parts.EXCITER).part,) if parts.is_installed(parts.EXCITER) else ()
    return (parts.SERIAL_MOTOR, *exciter, parts.SUPERVISOR, parts.LABJACK, parts.NI, *parts.LOOP, parts.LIVE)


@contextmanager
def made(scene: Path, folder: Path) -> Iterator[dict[str, Node]]:
    """Yield the stand's nodes by name, in a domain of their own; none is spun, so no device is opened."""
    made_of = stand()
    given: Parameters = {
        "selector_node": {"scene": str(scene), "map": str(map_for(load_scene(scene)) or "")},
        "motor_node": {"supervised": True},
        parts.EXCITER: {"supervised": True},
        "supervisor_node": {"nodes": [part.name for part in made_of if part not in (parts.SUPERVISOR, parts.LIVE)]},
        "live_node": {"scene": str(scene), "port": 0},
        "recorder_node": {"scene": str(scene), "bag": str(folder / "bag")},
    }
    context = Context()
    with own_domain():
        initialise([], context=context)
        nodes: dict[str, Node] = {}
        try:
            for part in made_of:
                values = part.configured() | given.get(part.name, {})
                nodes[part.name] = make_node(part, values, context=context)
            yield nodes
        finally:
            for node in nodes.values():
                getattr(node, "close", lambda: None)()
                node.destroy_node()
            context.shutdown()


def opened(observer: Node, name: str, namespace: str = "/") -> Rights:
    """Return what the node `name` has opened, as `observer` sees it in the graph."""
    queries = (
        observer.get_publisher_names_and_types_by_node,
        observer.get_subscriber_names_and_types_by_node,
        observer.get_service_names_and_types_by_node,
        observer.get_client_names_and_types_by_node,
    )
    return Rights(*({topic for topic, _ in query(name, namespace)} for query in queries)).actions_folded


def _rights_of(nodes: Mapping[str, Node]) -> dict[str, Rights]:
    """Return the rights of each node, and of an operator."""
    found = {name: opened(node, name) | LATER.get(name, Rights()) for name, node in nodes.items()}
    for one in found.values():  # the values of parameters are requested once their names are known
        one.request |= {name.removesuffix(_LISTED) + _READ for name in one.request if name.endswith(_LISTED)}
    return found | {OPERATOR: _operator_rights(found.values(), Rights(publish={"/rosout", "/parameter_events"}))}


def run(given: Namespace) -> int:
    """Make the policy; return 0."""
    with tempfile.TemporaryDirectory(prefix="atpid-policy-") as folder, made(given.scene, Path(folder)) as nodes:
        text = policy(_rights_of(nodes))
    if given.out is None:
        print(text, end="")
    else:
        with writing(given.out):
            given.out.write_text(text, encoding="utf-8")
    return DONE


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="a scene of the stand")
    parser.add_argument("--out", type=path_to(".xml"), metavar="FILE", help="file to write; default: standard output")
