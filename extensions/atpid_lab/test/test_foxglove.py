# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A running graph served to Foxglove, on this machine only: messages as they are and traces, but no handshake."""

from contextlib import closing
from itertools import count
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingState, SampleBlock
from node_graph import NodeGraph

from atpid_lab.nodes.foxglove_node import FoxgloveNode, Server, ServerError

NAMES = ["support_displacement", "beam_displacement"]
LASERS: dict[str, Any] = {"channels": NAMES, "units": ["m", "m"], "skew": [0.0, 0.0], "rate": 1000.0}


def test_messages_and_traces_are_sent_at_their_stamps() -> None:
    with closing(NodeGraph()) as graph:
        node = graph.make(FoxgloveNode, {"port": 0, "rate": 100.0})
        sent, blocks = list[Any](), count()
        node.server.send = sent.append
        laser = graph.peer.create_publisher(SampleBlock, "sensors/laser", 10)
        ceiling = graph.peer.create_publisher(CeilingState, "ceiling/state", 10)

        def publish() -> None:
            first = 50 * next(blocks)
            data = np.repeat(np.arange(first, first + 50.0), 2).tolist()
            block = SampleBlock(first_index=first, data=data, **LASERS)
            block.header.stamp.sec, milliseconds = divmod(5000 + first, 1000)
            block.header.stamp.nanosec = 1_000_000 * milliseconds
            for message in (SampleBlock(handshake=True, **LASERS), block):
                laser.publish(message)
            ceiling.publish(CeilingState(mode=CeilingState.HOLDING, height=0.2))

        topics = {"/rosout", "/sensors/laser", "/ceiling/state", "/traces/beam_displacement", "/traces/ceiling_mode"}
        graph.until(lambda: topics <= {record.topic for record in sent}, publish)
        node.close()
    assert all(len(record.data) > 800 for record in sent if record.topic == "/sensors/laser"), "no handshake"
    numbers = [(r.time_ns, float(np.frombuffer(r.data[4:])[0])) for r in sent if r.topic == "/traces/beam_displacement"]
    assert all(at == round((5000 + index) * 1e6) and index % 10.0 == 0.0 for at, index in numbers), "100 a second"


def test_only_this_machine_is_served() -> None:
    with closing(Server(0)) as server:
        with open("/proc/net/tcp", encoding="ascii") as table:
            listening = [row[1] for row in map(str.split, table) if row[3] == "0A"]
        assert [row for row in listening if row.endswith(f":{server.port:04X}")] == [f"0100007F:{server.port:04X}"]
        with pytest.raises(ServerError, match=f"port {server.port}"):
            Server(server.port)
