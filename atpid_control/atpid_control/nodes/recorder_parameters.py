# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of recorder_node, what they mean for the session, and those of the other nodes, which it keeps."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from atpid_common.nodes.handshake import Question
from atpid_common.parameters import Entry, Values
from atpid_control.recording.session import Writing
from atpid_control.recording.trigger import EDGES, trigger_of
from atpid_control.runs.topics import DEFAULT, Topic
from atpid_control.runs.writer import CHUNK, COMPRESSIONS, Split
from atpid_sim.scene import load_scene

_NODES = ["plant_node", "labjack_node", "ni_node", "identifier_node", "selector_node", "motor_node", "excitation_node"]
PARAMETERS = (
    Entry("bag", "", "folder to make; empty: run-<id> in the current folder"),
    Entry("scene", "", "scene file, kept in the bag verbatim; empty: none"),
    Entry("files", [""], "further configuration files to keep in the bag verbatim"),
    Entry("run_id", "", "name of the run; empty: date, time and a random part"),
    Entry("commit", "", "version of the code; empty: that of git"),
    Entry("lockstep", False, "true: log times are the messages' stamps and the order is theirs; false: as received"),
    Entry("topics", list(DEFAULT), "what to record: 'name pkg/msg/Type', then best_effort or transient_local"),
    Entry("parameters_of", _NODES, "nodes whose parameters are kept in the bag; not in lockstep"),
    Entry("compression", "zstd", "compression of chunks", choices=tuple(COMPRESSIONS)),
    Entry("max_bag_size", 0, "size of a file from which the bag goes on in another one; 0: never", "bytes", 0, 2**40),
    Entry("max_bag_duration", 0.0, "time from which the bag goes on in another file; 0: never", "s", 0.0, 1e6),
    Entry("trigger", "", "begin to record when a signal passes trigger_level: 'TOPIC SIGNAL'; empty: at once"),
    Entry("trigger_level", 0.0, "level of the trigger, in the unit of the signal"),
    Entry("trigger_edge", "rising", "how the signal passes it", choices=EDGES),
    Entry("trigger_pre", 1.0, "recorded before the sample that passes the level", "s", 0.0, 600.0),
    Entry("trigger_post", 0.0, "recorded after it; 0: until the run ends", "s", 0.0, 1e6),
    Entry("trigger_memory", 2**26, "what may be held before the trigger", "bytes", 2**16, 2**33),
    Entry("chunk", 0, "largest size of a chunk: what a crash can lose; 0: that of the scene", "bytes", 0, 16_777_216),
    Entry(
        "chunk_period",
        0.02,
        "after which a chunk ends that is not full: what a crash can lose; 0: never; not used in lockstep",
        "s",
        0.0,
        3600.0,
    ),
    Entry("sync_period", 1.0, "between two flushes to the disk: what a power cut can lose; 0: never", "s", 0.0, 3600.0),
)


def writing_of(values: Values, topics: list[Topic], scene: Path | None) -> Writing:
    """Return how the file is written; the scene states the size of a chunk. Raises BagError, SceneError."""
    settings = {name: values[f"trigger_{name}"] for name in ("level", "edge", "pre", "post", "memory")}
    return Writing(
        chunk=values["chunk"] or (load_scene(scene).recording.chunk if scene else CHUNK),
        compression=values["compression"],
        split=Split(values["max_bag_size"], values["max_bag_duration"]),
        trigger=trigger_of(values["trigger"], topics, **settings),
    )


#: Parameters that rclpy declares for every node.
OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")

_Keep = Callable[[str, Values], None]


class ParameterReader:
    """Gets the parameters of each node once, as soon as its services are there."""

    def __init__(self, node: Node, names: Sequence[str], keep: _Keep) -> None:
        """Take the nodes' names; `keep` is called with a node's name and its parameters."""
        self._node, self._keep = node, keep
        self._open: dict[str, tuple[Client, Question, object]] = {}
        for name in names:
            self._question(name, ListParameters, "list_parameters", partial(self._on_names, name))

    def poll(self) -> None:
        """Ask those that have not answered yet; to be called periodically."""
        for _, question, request in list(self._open.values()):
            question.ask(request, time.monotonic())

    def _on_names(self, name: str, answer: ListParameters.Response) -> None:
        names = [key for key in answer.result.names if not key.startswith(OF_RCLPY)]
        self._close(name)
        self._question(name, GetParameters, "get_parameters", partial(self._on_values, name, names), names=names)

    def _on_values(self, name: str, names: Sequence[str], answer: GetParameters.Response) -> None:
        self._close(name)
        values = map(parameter_value_to_python, answer.values)
        plain = (v if v is None or isinstance(v, bool | int | float | str) else list(v) for v in values)
        self._keep(name, dict(zip(names, plain, strict=False)))

    def _question(self, name: str, kind: Any, service: str, answered: Callable[..., None], **request: object) -> None:
        client = self._node.create_client(kind, f"{name}/{service}")
        self._open[name] = client, Question(client, answered), kind.Request(**request)

    def _close(self, name: str) -> None:
        self._node.destroy_client(self._open.pop(name)[0])
