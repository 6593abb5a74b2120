# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A driver of another package: publishes a counter at a rate, late, with gaps, jitter and out of order as it is told.

    python driver_of_others.py KIND RATE LOSS JITTER REORDER SECONDS

KIND: imu, state (both with a stamp), array, number or scans (10 scans of 2 numbers a message). A number published is
the index of its scan, and the line printed the time of scan 0 [ns]: they state where what arrives belongs.
"""

import random
import sys
import time
from importlib import import_module

import rclpy
from atpid_interfaces.msg import CeilingState
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64, Float64MultiArray

from atpid_common.nodes.messages import time_of


def message(kind: str, index: int, stamp_ns: int) -> object:
    if kind == "imu":
        imu = import_module("sensor_msgs.msg").Imu()
        imu.header.stamp = time_of(stamp_ns)
        imu.linear_acceleration.z, imu.angular_velocity.x = float(index), -float(index)
        return imu
    if kind == "state":
        state = CeilingState(height=float(index), target=-float(index))
        state.header.stamp = time_of(stamp_ns)
        return state
    if kind == "number":
        return Float64(data=float(index))
    if kind == "scans":
        return Float64MultiArray(data=[sign * float(10 * index + n) for n in range(10) for sign in (1.0, -1.0)])
    return Float64MultiArray(data=[float(index), -float(index)])


def main() -> None:
    kind, (rate, loss, jitter, reorder, seconds) = sys.argv[1], map(float, sys.argv[2:])
    rclpy.init(args=[])
    node, chance = Node("driver_of_others"), random.Random(1)
    publisher = node.create_publisher(type(message(kind, 0, 0)), "imu/data", QoSProfile(depth=1000))
    period, waiting = 1.0 / rate, list[tuple[float, int, int]]()  # when, index, stamp
    began, wall = time.monotonic(), time.time_ns()
    print(wall, flush=True)
    index, last = 0, 0.0
    while time.monotonic() < began + seconds:
        due = began + index * period
        if not (loss and index * period > 3.0 and chance.random() < loss):
            shaken = wall + round((index * period + chance.uniform(-0.2, 0.2) * (jitter > 0.0) * period) * 1e9)
            delay = chance.expovariate(1.0 / jitter) if jitter else 0.0
            if kind not in ("imu", "state"):  # nothing in a message would state its place
                delay = max(delay, last - due)
                last = due + delay
            waiting.append((due + delay + (3.0 * period if chance.random() < reorder else 0.0), index, shaken))
        index += 1
        waiting.sort()
        while waiting and waiting[0][0] < began + index * period:
            at, number, stamp = waiting.pop(0)
            time.sleep(max(0.0, at - time.monotonic()))
            publisher.publish(message(kind, number, stamp))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
