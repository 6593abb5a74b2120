# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Polls a standard service of each node; a node whose executor hangs does not reply.

A lifecycle node is asked for its state, another one for no parameters at all.
"""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import Any

from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from atpid_common.nodes.question import Question
from atpid_control.supervision.states import NodeLiveness

#: Between two questions [s].
PERIOD = 0.1
LIFECYCLE_NODES = ("motor_node", "excitation_node", "labjack_node", "ni_node")


class NodeQuestions:
    """Asks all nodes, one question at a time to each."""

    def __init__(self, node: Node, answers: NodeLiveness) -> None:
        self._node, self._answers = node, answers
        self._questions = [self._question(name) for name in answers.nodes]
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        self._claims = {name: f"@atpid/{domain}{node.resolve_service_name(name)}" for name in answers.nodes}
        self._seen: set[str] = set()

    def ask(self, now: float) -> None:
        """Ask every node whose turn it is at the steady time `now` [s]."""
        for question, request in self._questions:
            question.ask(request, now, PERIOD)

    def ended(self) -> set[str]:
        """Return the nodes whose processes have run on this machine and have ended, by the names that they claim."""
        running = self._running()
        self._seen |= running
        return self._seen - running

    def runs_here(self, name: str) -> bool:
        """Return whether a node has a process on this machine, which has got so far as to claim its name."""
        return name in self._running()

    def _running(self) -> set[str]:
        claims = set(Path("/proc/net/unix").read_text(errors="replace").split())
        return {name for name, claim in self._claims.items() if claim in claims}

    def in_words(self, name: str) -> str:
        """Return what a silent node does, in words: whether its process has ended or only does not answer."""
        if name in self.ended():
            return "has ended, and does not answer"
        return (
            "does not answer" if name in self._seen else "runs on another machine, or not at all, and does not answer"
        )

    def _question(self, name: str) -> tuple[Question, Any]:
        kind, service = (GetState, "get_state") if name in LIFECYCLE_NODES else (GetParameters, "get_parameters")
        client = self._node.create_client(kind, f"{name}/{service}")
        return Question(client, partial(self._answered, name)), kind.Request()

    def _answered(self, name: str, _answer: Any) -> None:
        self._answers.answered(name, time.monotonic())
