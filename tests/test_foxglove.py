# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A running graph served to Foxglove: a client of its protocol receives messages and traces, on this machine only."""

import base64
import json
import os
import socket
import struct
import time
from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from atpid_interfaces.msg import CeilingState, SampleBlock
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosbags.typesys import Stores, get_typestore

from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.foxglove_node import FoxgloveNode
from atpid_control.stand.domain import own_domain
from atpid_control.views.traces.records import NUMBER, TEXT
from atpid_control.views.traces.server import Server, ServerError

LIMIT = 60.0  # for what takes a second on a quiet machine [s]
START_NS = 5_000_000_000


class Client:
    """The least of a client: handshake, subscription, frames; without waiting."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), LIMIT)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = (
            "GET / HTTP/1.1", f"Host: 127.0.0.1:{port}", "Upgrade: websocket", "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Protocol: foxglove.sdk.v1", "", "",
        )  # fmt: skip
        self._socket.sendall("\r\n".join(lines).encode())
        self._bytes = b""
        while b"\r\n\r\n" not in self._bytes:
            self._bytes += self._socket.recv(4096)
        answer, _, self._bytes = self._bytes.partition(b"\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 101"), answer
        self._socket.setblocking(False)
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.received: dict[str, list[tuple[int, bytes]]] = {}
        self._subscribed: dict[int, str] = {}

    def poll(self) -> None:
        """Take what has come, and subscribe to every topic that is announced."""
        try:
            while more := self._socket.recv(65536):
                self._bytes += more
        except BlockingIOError:
            pass
        while (frame := self._frame()) is not None:
            opcode, payload = frame
            if opcode == 1:
                self._text(json.loads(payload))
            elif opcode == 2 and payload[0] == 1:
                number, time_ns = struct.unpack_from("<IQ", payload, 1)
                self.received.setdefault(self._subscribed[number], []).append((time_ns, payload[13:]))

    def _frame(self) -> tuple[int, bytes] | None:
        if len(self._bytes) < 2:
            return None
        begin, length = 2, self._bytes[1] & 0x7F
        if length >= 126:
            size = 2 if length == 126 else 8
            if len(self._bytes) < 2 + size:
                return None
            begin, length = 2 + size, int.from_bytes(self._bytes[2 : 2 + size], "big")
        if len(self._bytes) < begin + length:
            return None
        frame = self._bytes[0] & 0x0F, self._bytes[begin : begin + length]
        self._bytes = self._bytes[begin + length :]
        return frame

    def _text(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            for channel in message["channels"]:
                self.channels[channel["topic"]] = channel
                self._subscribed[channel["id"]] = channel["topic"]
            new = [{"id": channel["id"], "channelId": channel["id"]} for channel in message["channels"]]
            self._send({"op": "subscribe", "subscriptions": new})

    def _send(self, message: dict[str, Any]) -> None:
        data, mask = json.dumps(message).encode(), os.urandom(4)
        masked = bytes(byte ^ mask[place % 4] for place, byte in enumerate(data))
        self._socket.setblocking(True)
        self._socket.sendall(b"\x81" + bytes([0x80 | 126]) + struct.pack(">H", len(data)) + mask + masked)
        self._socket.setblocking(False)

    def close(self) -> None:
        self._socket.close()


class Graph:
    """The node, and one that publishes as a stand does."""

    def __init__(self, context: Context) -> None:
        port = Parameter("port", Parameter.Type.INTEGER, 0)
        rate = Parameter("rate", Parameter.Type.DOUBLE, 100.0)
        self.served = FoxgloveNode(parameter_overrides=[port, rate], context=context)
        self.stand = Node("stand", context=context)
        self.laser = self.stand.create_publisher(SampleBlock, "sensors/laser", 10)
        self.ceiling = self.stand.create_publisher(CeilingState, "ceiling/state", 10)
        self._executor = TurnExecutor(context=context)
        for node in (self.served, self.stand):
            self._executor.add_node(node)

    def until(self, happened: Callable[[], bool], repeat: Callable[[], None] = lambda: None) -> None:
        end = time.monotonic() + LIMIT
        while not happened():
            assert time.monotonic() < end, "it has not happened"
            repeat()
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()
        self.served.close()
        for node in (self.served, self.stand):
            node.destroy_node()


@pytest.fixture
def graph() -> Iterator[Graph]:
    with own_domain() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        made = Graph(context)
        try:
            yield made
        finally:
            made.close()
            rclpy.try_shutdown(context=context)


def block(first: int, *, handshake: bool = False) -> SampleBlock:
    """Return 50 ms at 1000 Hz, the value of each sample its index."""
    made = SampleBlock(handshake=handshake, first_index=first, rate=1000.0)
    made.channels, made.units = ["support_displacement", "beam_displacement"], ["m", "m"]
    made.skew = array("d", [0.0, 0.0])
    stamp_ns = START_NS + first * 1_000_000
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    if not handshake:
        made.data = array("d", np.repeat(np.arange(first, first + 50) * 1e-4, 2).tobytes())
    return made


@pytest.mark.slow
def test_a_viewer_receives_messages_and_traces(graph: Graph) -> None:
    client = Client(graph.served.server.port)
    store = get_typestore(Stores.ROS2_JAZZY)
    published = 0

    def publish() -> None:
        nonlocal published
        client.poll()
        if {"/sensors/laser", "/ceiling/state"} <= client.channels.keys() and graph.laser.get_subscription_count():
            graph.laser.publish(block(0, handshake=True))
            graph.ceiling.publish(CeilingState(mode=CeilingState.HOLDING, height=0.2))
            graph.laser.publish(block(published))
            published += 50

    try:
        # a topic of traces is announced with its first message, so that later ones are subscribed to
        graph.until(lambda: len(client.received.get("/traces/beam_displacement", ())) > 20, publish)
        graph.until(lambda: "/traces/ceiling_mode" in client.received, publish)
    finally:
        client.close()
    assert client.info["capabilities"] == []  # it can only be read
    channel = client.channels["/traces/beam_displacement"]
    assert (channel["encoding"], channel["schemaEncoding"], channel["schemaName"]) == ("cdr", "ros2msg", NUMBER)
    assert "float64 data" in channel["schema"]
    for time_ns, data in client.received["/traces/beam_displacement"]:
        sample: Any = store.deserialize_cdr(data, NUMBER)
        index = round(sample.data / 1e-4)
        assert time_ns == START_NS + index * 1_000_000
        assert index % 10 == 0  # 100 of 1000 a second
    words: list[Any] = [store.deserialize_cdr(data, TEXT) for _, data in client.received["/traces/ceiling_mode"]]
    assert {word.data for word in words} == {"holding"}
    assert len(client.received["/sensors/laser"]) >= 1
    assert client.channels["/sensors/laser"]["schemaName"] == "atpid_interfaces/msg/SampleBlock"
    assert all(len(data) > 800 for _, data in client.received["/sensors/laser"])  # no handshake


def test_only_this_machine_is_served() -> None:
    server = Server(0)
    try:
        with open("/proc/net/tcp", encoding="ascii") as table:
            rows = [line.split() for line in table][1:]
        listening = {row[1] for row in rows if row[3] == "0A" and int(row[1].partition(":")[2], 16) == server.port}
        assert listening == {f"0100007F:{server.port:04X}"}
        with pytest.raises(ServerError, match=f"port {server.port}: cannot be served .* give another port"):
            Server(server.port)
    finally:
        server.close()
