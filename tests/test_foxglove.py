# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A running graph served to Foxglove: a client of its protocol receives messages and traces, on this machine only."""

import asyncio
import json
import struct
import time
from array import array
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingState, SampleBlock
from rclpy.parameter import Parameter
from rosbags.typesys import Stores, get_typestore
from spun import Pair
from tornado.websocket import WebSocketClientConnection, websocket_connect

from atpid_control.nodes.foxglove_node import FoxgloveNode
from atpid_control.stand.domain import own_domain
from atpid_control.views.traces.records import NUMBER, TEXT
from atpid_control.views.traces.server import Server, ServerError

START_NS = 5_000_000_000
MODE, BEAM = "/traces/ceiling_mode", "/traces/beam_displacement"


class Client:
    """Subscribes to every topic that is announced, and keeps what it receives."""

    def __init__(self) -> None:
        self.stream: WebSocketClientConnection | None = None
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.received: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        self._topics: dict[int, str] = {}

    def take(self, message: str | bytes | None) -> None:
        if isinstance(message, bytes) and message[0] == 1:
            number, time_ns = struct.unpack_from("<IQ", message, 1)
            self.received[self._topics[number]].append((time_ns, message[13:]))
        elif isinstance(message, str):
            self._told(json.loads(message))

    def _told(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            assert self.stream is not None
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}
            self._topics |= {channel["id"]: channel["topic"] for channel in message["channels"]}
            new = [{"id": channel["id"], "channelId": channel["id"]} for channel in message["channels"]]
            self.stream.write_message(json.dumps({"op": "subscribe", "subscriptions": new}))


class Graph(Pair):
    """The node, and a peer that publishes as a stand does."""

    def __init__(self) -> None:
        super().__init__()
        parameters = [Parameter("port", value=0), Parameter("rate", value=100.0)]
        self.served = FoxgloveNode(parameter_overrides=parameters, context=self.context)
        self.executor.add_node(self.served)
        self.laser = self.peer.create_publisher(SampleBlock, "sensors/laser", 10)
        self.ceiling = self.peer.create_publisher(CeilingState, "ceiling/state", 10)
        self.published = 0

    def publish(self) -> None:
        if self.laser.get_subscription_count():
            self.laser.publish(block(0, handshake=True))
            self.ceiling.publish(CeilingState(mode=CeilingState.HOLDING, height=0.2))
            self.laser.publish(block(self.published))
            self.published += 50

    def close(self) -> None:
        self.executor.remove_node(self.served)
        self.served.close()
        self.served.destroy_node()
        super().close()


@pytest.fixture
def graph() -> Iterator[Graph]:
    with own_domain(), closing(Graph()) as made:
        yield made


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


async def visit(graph: Graph) -> Client:
    """Return a client that has received samples, and the state of the ceiling in words."""
    client, end = Client(), time.monotonic() + 100.0
    address = f"ws://127.0.0.1:{graph.served.server.port}/"
    client.stream = await websocket_connect(
        address, on_message_callback=client.take, subprotocols=["foxglove.sdk.v1"]
    )  # fmt: skip
    # a topic of traces is announced with its first message, so that later ones are subscribed to
    while len(client.received[BEAM]) < 20 or not client.received[MODE]:
        assert time.monotonic() < end, "it does not come"
        if {"/sensors/laser", "/ceiling/state"} <= client.channels.keys():
            graph.publish()
        graph.executor.spin_once(timeout_sec=0.05)
        await asyncio.sleep(0.01)
    client.stream.close()
    return client


def test_a_viewer_receives_messages_and_traces(graph: Graph) -> None:
    client = asyncio.run(visit(graph))
    store = get_typestore(Stores.ROS2_JAZZY)
    assert client.info["capabilities"] == []  # it can only be read
    channel = client.channels[BEAM]
    assert (channel["encoding"], channel["schemaEncoding"], channel["schemaName"]) == ("cdr", "ros2msg", NUMBER)
    assert "float64 data" in channel["schema"].splitlines()
    for time_ns, data in client.received[BEAM]:
        sample: Any = store.deserialize_cdr(data, NUMBER)
        index = round(sample.data / 1e-4)
        assert time_ns == START_NS + index * 1_000_000
        assert index % 10 == 0  # 100 of 1000 a second
    words: list[Any] = [store.deserialize_cdr(data, TEXT) for _, data in client.received[MODE]]
    assert {word.data for word in words} == {"holding"}
    assert client.channels["/sensors/laser"]["schemaName"] == "atpid_interfaces/msg/SampleBlock"
    blocks = client.received["/sensors/laser"]
    assert blocks
    assert all(len(data) > 800 for _, data in blocks)  # no handshake


def test_only_this_machine_is_served() -> None:
    with closing(Server(0)) as server, open("/proc/net/tcp", encoding="ascii") as table:
        rows = [line.split() for line in table][1:]
        listening = {row[1] for row in rows if row[3] == "0A" and int(row[1].partition(":")[2], 16) == server.port}
        assert listening == {f"0100007F:{server.port:04X}"}
        with pytest.raises(ServerError, match=rf"\b{server.port}\b.*port"):
            Server(server.port)
