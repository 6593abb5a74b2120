# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wall clock set back and forward by an hour under a running node, by a preloaded library (clock_step.c)."""

import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import CeilingState
from motor_graph import SIMULATED

from atpid_common.nodes.messages import nanoseconds_of

pytestmark = pytest.mark.slow

PACE = 0.02  # of the motor's states [s]

SOURCE = Path(__file__).with_name("clock_step.c")
LASER = {
    "backend": "simulated", "handshake": "false", "rate": 1000.0, "channels": "[support_displacement]",
    "terminals": "[x]", "calibrations": "[laser_support.yaml]",
}  # fmt: skip


class SteppedNode:
    """A node of the driver as a process whose wall clock can be set."""

    def __init__(self, folder: Path, module: str, parameters: dict[str, object]) -> None:
        library, self._step = folder / "clock_step.so", folder / "step"
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, SOURCE, "-ldl", "-lpthread"], check=True)
        self._step.write_bytes(struct.pack("d", 0.0))
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        environment = os.environ | {"LD_PRELOAD": str(library), "ATPID_CLOCK_STEP": str(self._step)}
        command = [sys.executable, "-m", f"atpid_driver.nodes.{module}", "--ros-args", *words]
        self.process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)

    def step(self, seconds: float) -> None:
        """Set its wall clock."""
        with self._step.open("r+b") as file:
            file.write(struct.pack("d", seconds))

    def end(self) -> str:
        """Interrupt it and return what it has logged."""
        self.process.send_signal(signal.SIGINT)
        return self.process.communicate(timeout=100.0)[1]


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.mark.parametrize("seconds", [-3600.0, 3600.0])
def test_a_motor_whose_clock_is_set_goes_on_and_ends_when_interrupted(
    bench: Bench, tmp_path: Path, seconds: float
) -> None:
    """Its states are paced by a timer alone: nothing else would wake a wait that the step has made an hour longer."""
    states: list[CeilingState] = []
    bench.peer.create_subscription(CeilingState, "ceiling/state", states.append, 100)
    node = SteppedNode(tmp_path, "motor_node", SIMULATED)
    try:
        bench.until(lambda: len(states) > 20)
        node.step(seconds)
        bench.until(lambda: abs(states[-1].header.stamp.sec - time.time() - seconds) < 600.0)
        before = len(states)
        bench.until(lambda: len(states) >= before + 100)
        paced = [nanoseconds_of(state.header.stamp) * 1e-9 for state in states[before : before + 100]]
        assert paced[-1] - paced[0] > 0.9 * 99 * PACE, "it goes on at its pace, not without a pause"
        assert f"the wall clock was set by {seconds:+.3f} s" in node.end()
    finally:
        node.process.kill()
        node.process.communicate()


def test_stamps_of_samples_go_on_with_the_devices_clock(bench: Bench, tmp_path: Path) -> None:
    node = SteppedNode(tmp_path, "acquisition_node", LASER | {"topic": "sensors/laser"})
    try:
        bench.until(lambda: len(bench.blocks) > 5)
        node.step(-3600.0)
        before = len(bench.blocks)
        bench.until(lambda: len(bench.blocks) >= before + 40)
        node.end()
    finally:
        node.process.kill()
        node.process.communicate()
    first, last = bench.blocks[0], bench.blocks[-1]
    elapsed = (nanoseconds_of(last.header.stamp) - nanoseconds_of(first.header.stamp)) * 1e-9
    assert elapsed == pytest.approx((last.first_index - first.first_index) / last.rate, abs=1e-3)
    assert last.dropped == 0
