# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves a running graph to Foxglove and PlotJuggler: its messages as they are, and their traces."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import foxglove
from rclpy.node import Node

from atpid_common.errors import InputError
from atpid_common.message_checks import CHECKS
from atpid_common.nodes.checked import Dropped
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.parameters import Entry
from atpid_control.nodes.bag_qos import class_of, subscription_qos
from atpid_control.runs.decode import Decoder, message_type, stamp_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import kind_of, reason_to_leave_out
from atpid_control.runs.topics import DEFAULT, Topic, decoder_of, parse
from atpid_lab.traces.file import TraceError, Tracer
from atpid_lab.traces.records import PREFIX, TraceRecord, definition
from atpid_sim.scene import load_scene

#: The only address: a viewer on another machine comes through a tunnel (docs/foxglove.md).
HOST = "127.0.0.1"


class ServerError(InputError):
    """A port that cannot be served; one line."""


class Server:
    """A WebSocket server in the protocol of Foxglove; it takes no messages, parameters or calls from its clients."""

    def __init__(self, port: int) -> None:
        """Serve on `port` of this machine, 0: any free one. Raises ServerError."""
        # a viewer that leaves is no error of a node
        foxglove.set_log_level("CRITICAL")
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(name="ATPID", host=HOST, port=port, context=self._context)
        except RuntimeError as error:
            raise ServerError(f"port {port}: cannot be served ({error}); give another port, or 0 for any") from None
        self._channels: dict[str, foxglove.Channel] = {}

    @property
    def port(self) -> int:
        """The port it serves on."""
        return int(self._server.port)

    def offer(self, topic: str, kind: str) -> None:
        """Announce a topic of message type `kind`; raise TypeUnknownError for a type that is not installed."""
        own = topic.startswith(PREFIX)  # standard types, whose packages need not be here
        text = definition(kind) if own else message_type(kind).definition.encode()
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text)
        self._channels[topic] = foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._context)

    def send(self, record: TraceRecord) -> None:
        """Send one message to the clients that subscribe to its topic."""
        if record.topic not in self._channels:
            self.offer(record.topic, record.type)
        self._channels[record.topic].log(record.data, log_time=record.time_ns)

    def close(self) -> None:
        """Disconnect the clients."""
        self._server.stop()


PARAMETERS = (
    Entry("port", 8765, f"port on {HOST}; 0: any free one, which is logged", "", 0, 65535),
    Entry("rate", 200.0, "samples of a channel a second, at most", "Hz", 0.1, 1e6),
    Entry("scene", "", "scene file: the efficiency needs it; empty: none"),
)


class FoxgloveNode(Node):
    """Parameters, topics, and one call into the tracer for each message."""

    def __init__(self, **node_options: Any) -> None:
        """Serve and subscribe. Raises ServerError, SceneError, ParameterError."""
        super().__init__("foxglove_node", **node_options)
        values = declare(self, PARAMETERS)
        scene = load_scene(Path(values["scene"])) if values["scene"] else None
        self._tracer = Tracer(scene, values["rate"])
        self.server = Server(values["port"])
        for topic in parse(DEFAULT, lockstep=False):
            named = replace(topic, name=self.resolve_topic_name(topic.name))
            self.server.offer(named.name, named.type)
            # no publisher waits for a viewer: what it is too slow for is lost to it alone
            asked = subscription_qos(replace(named, best_effort=not named.transient_local))
            take = partial(self._on_message, named, decoder_of(named.type))
            self.create_subscription(class_of(named.type), named.name, take, asked, raw=True)
        self.get_logger().info(f"Foxglove: ws://{HOST}:{self.server.port}, layout docs/foxglove/atpid.json")

    def _on_message(self, topic: Topic, decoder: Decoder, data: bytes) -> None:
        kind = kind_of(topic.type)
        try:
            message = decoder.decode(0, data)
        except BagError as error:
            Dropped.of(self).add(topic.name, str(error))
            return
        if reason := reason_to_leave_out(kind, message):
            Dropped.of(self).add(topic.name, reason)
        elif not getattr(message, "handshake", False):
            now_ns = int(self.get_clock().now().nanoseconds)
            time_ns = stamp_of(message) if message_type(topic.type).has_header else now_ns
            self.server.send(TraceRecord(topic.name, topic.type, time_ns, data))
            try:
                for record in self._tracer.push(kind, message) if kind in CHECKS else ():
                    self.server.send(record)
            except TraceError as error:
                Dropped.of(self).add(topic.name, str(error))

    def close(self) -> None:
        """Disconnect the viewers."""
        self.server.close()


main = partial(run_node, FoxgloveNode)

if __name__ == "__main__":
    sys.exit(main())
