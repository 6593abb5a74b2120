# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The SROS 2 policy: which node may publish, receive, serve and request what, and nothing else (docs/security.md)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

#: Version of the policy's form (sros2, policy.xsd).
_VERSION = "0.2.0"
_ACTION = "/_action/"
#: Who is no node of the graph: a person with `ros2`, or with this project's own commands.
OPERATOR = "operator"
_HEAD = (
    " SPDX-License-Identifier: Apache-2.0 ",
    " Made by `atpid policy` from the nodes themselves; do not edit. See docs/security.md. ",
)


def enclave_of(node: str) -> str:
    """Return the enclave, by whose key and certificate a node is known, of a node of this name."""
    return f"/atpid/{node}"


def enclave_arguments(node: str) -> list[str]:
    """Return what follows `--ros-args` for it; without security it has no effect."""
    return ["--enclave", enclave_of(node)]


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


def operator_rights(nodes: Iterable[Rights], own: Rights) -> Rights:
    """Return an operator's: sees every topic, may request every service and action, publishes nothing of the graph.

    own: what every node does, whatever its task.
    """
    everything = Rights()
    for one in nodes:
        everything |= one
    seen = Rights(subscribe=everything.publish, request=everything.reply, call=everything.execute)
    return seen | own


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
        enclave = ElementTree.SubElement(enclaves, "enclave", path=enclave_of(node))
        profiles = ElementTree.SubElement(enclave, "profiles")
        profile = ElementTree.SubElement(profiles, "profile", ns=namespace, node=node)
        for group, item, kinds in _FORM:
            for kind in kinds:
                _allow(profile, group, item, kind, sorted(getattr(allowed, kind)))
    ElementTree.indent(root)
    comments = "\n".join(f"<!--{line}-->" for line in _HEAD)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{comments}\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _allow(profile: ElementTree.Element, group: str, item: str, kind: str, names: Sequence[str]) -> None:
    if names:
        element = ElementTree.SubElement(profile, group, {kind: "ALLOW"})
        for name in names:
            ElementTree.SubElement(element, item).text = name
