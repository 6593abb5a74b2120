# SPDX-License-Identifier: Apache-2.0
"""Asks each node, by a standard service that it answers between two callbacks: one that hangs does not answer.

A lifecycle node is asked for its state, another one for no parameters at all.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_control.supervision.answers import Answers

#: Between two questions; and until one without an answer is asked again: discovery may lose the first [s].
PERIOD, AGAIN = 0.1, 0.5
LIFECYCLE_NODES = ("motor_node", "labjack_node", "ni_node")
MOTOR = "motor_node"
INACTIVE = "inactive"


@dataclass
class _Question:
    """The questions to one node."""

    client: Client
    request: Any
    asked: float = 0.0  # steady [s]
    pending: Future | None = None
    state: str = ""  # of a lifecycle node


class NodeQuestions:
    """Asks all nodes, one question at a time to each."""

    def __init__(self, node: Node, answers: Answers) -> None:
        self._node, self._answers = node, answers
        self._questions = {name: self._question(name) for name in answers.nodes}
        self._change = node.create_client(ChangeState, f"{MOTOR}/change_state")
        self._rearm = node.create_client(Trigger, f"{MOTOR}/rearm")

    def ask(self, now: float) -> None:
        """Ask every node whose turn it is at the steady time `now` [s]."""
        for name, question in self._questions.items():
            waited = now - question.asked
            if waited < (PERIOD if question.pending is None else AGAIN) or not question.client.service_is_ready():
                continue
            if question.pending is not None:
                question.client.remove_pending_request(question.pending)
            question.asked = now
            question.pending = question.client.call_async(question.request)
            question.pending.add_done_callback(partial(self._answered, name))

    def in_words(self, name: str) -> str:
        """Return what a silent node does, in words: whether its process has ended or only does not answer."""
        full = self._node.resolve_service_name(name)
        claim = f"@atpid/{os.environ.get('ROS_DOMAIN_ID', '0')}{full}"
        running = claim in Path("/proc/net/unix").read_text(errors="replace").split()
        return "does not answer" if running else "has ended or runs on another machine, and does not answer"

    def rearm_motor(self) -> None:
        """Activate the motor node where it is inactive, else clear its faults; its own log has the result."""
        if MOTOR in self._questions and self._questions[MOTOR].state == INACTIVE:
            self._change.call_async(ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE)))
        else:
            self._rearm.call_async(Trigger.Request())

    def _question(self, name: str) -> _Question:
        if name in LIFECYCLE_NODES:
            return _Question(self._node.create_client(GetState, f"{name}/get_state"), GetState.Request())
        return _Question(self._node.create_client(GetParameters, f"{name}/get_parameters"), GetParameters.Request())

    def _answered(self, name: str, future: Future) -> None:
        question = self._questions[name]
        if question.pending is None or future is not question.pending or future.exception() is not None:
            return
        question.pending = None
        if name in LIFECYCLE_NODES:
            question.state = str(future.result().current_state.label)
        self._answers.answered(name, time.monotonic())
