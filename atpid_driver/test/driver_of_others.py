# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A driver of another package: publishes counters at a rate, late, with gaps, jitter and out of order.

    python driver_of_others.py SECONDS [KIND:RATE:LOSS:JITTER:REORDER ...]

KIND: state (with a stamp), array, number or scans (10 scans of 2 numbers a message), each on others/KIND. A number
published is the index of its scan, and the line printed the time of scan 0 [ns]: they state where what arrives belongs.
"""

import random
import sys
import time
from collections.abc import Iterator

import rclpy
from atpid_interfaces.msg import CeilingState
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64, Float64MultiArray

from atpid_common.nodes.messages import time_of


def message(kind: str, index: int, stamp_ns: int) -> object:
    if kind == "state":
        state = CeilingState(height=float(index), target=-float(index))
        state.header.stamp = time_of(stamp_ns)
        return state
    if kind == "number":
        return Float64(data=float(index))
    if kind == "scans":
        return Float64MultiArray(data=[sign * float(10 * index + n) for n in range(10) for sign in (1.0, -1.0)])
    return Float64MultiArray(data=[float(index), -float(index)])


def plan(
    kind: str, rate: float, loss: float, jitter: float, reorder: float, *, seconds: float
) -> Iterator[tuple[float, str, int, float]]:
    """Yield when each message is published [s], of which kind, its index, and its stamp after the begin [s]."""
    chance, last = random.Random(1), 0.0
    for index in range(int(seconds * rate)):
        due = index / rate
        if loss and due > 3.0 and chance.random() < loss:
            continue
        stamp = due + (chance.uniform(-0.2, 0.2) / rate if jitter else 0.0)
        delay = chance.expovariate(1.0 / jitter) if jitter else 0.0
        if kind != "state":  # nothing in a message would state its place
            last = max(due + delay, last)
            delay = last - due
        yield due + delay + (3.0 / rate if chance.random() < reorder else 0.0), kind, index, stamp


def main() -> None:
    seconds, streams = float(sys.argv[1]), [stream.split(":") for stream in sys.argv[2:]]
    rclpy.init(args=[])
    node = Node("driver_of_others")
    publishers = {
        kind: node.create_publisher(type(message(kind, 0, 0)), f"others/{kind}", QoSProfile(depth=1000))
        for kind, *_ in streams
    }
    due = sorted(one for kind, *how in streams for one in plan(kind, *map(float, how), seconds=seconds))
    began, wall = time.monotonic(), time.time_ns()
    print(wall, flush=True)
    for at, kind, index, stamp in due:
        time.sleep(max(0.0, began + at - time.monotonic()))
        publishers[kind].publish(message(kind, index, wall + round(stamp * 1e9)))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
