# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wall clock set back and forward by an hour under a running node, by a preloaded library (clock_step.c)."""

import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import CeilingState
from motor_graph import SIMULATED, arguments

from atpid_common.nodes.messages import nanoseconds_of
from atpid_common.testing import PATIENCE

PACE = 0.02  # of the motor's states [s]
HOUR = 3600.0
LASER = {
    "backend": "simulated", "handshake": "false", "rate": 1000.0, "channels": "[support_displacement]",
    "terminals": "[x]", "calibrations": "[laser_support.yaml]", "topic": "sensors/laser",
}  # fmt: skip


@pytest.fixture
def bench() -> Iterator[Bench]:
    with closing(Bench()) as made:
        yield made


@contextmanager
def stepped(
    folder: Path, module: str, parameters: dict[str, object]
) -> Iterator[tuple[Callable[[float], int], Callable[[], str]]]:
    """Run a node of the driver as a process; yield what sets its wall clock, and what ends it and returns its log."""
    library, step = folder / "clock_step.so", folder / "step"
    source = Path(__file__).with_name("clock_step.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl", "-lpthread"], check=True)
    step.write_bytes(struct.pack("d", 0.0))
    environment = os.environ | {"LD_PRELOAD": str(library), "ATPID_CLOCK_STEP": str(step)}
    command = [sys.executable, "-m", f"atpid_driver.nodes.{module}", *arguments(**parameters)]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)

    def end() -> str:
        process.send_signal(signal.SIGINT)
        return process.communicate(timeout=PATIENCE)[1]

    try:
        with step.open("r+b", buffering=0) as file:
            yield lambda seconds: file.seek(0) or file.write(struct.pack("d", seconds)), end
    finally:
        process.kill()
        process.communicate()


def test_a_motor_whose_clock_is_set_goes_on_and_ends_when_interrupted(bench: Bench, tmp_path: Path) -> None:
    """Its states are paced by a timer alone: nothing else would wake a wait that the step has made an hour longer."""
    states: list[CeilingState] = []
    bench.peer.create_subscription(CeilingState, "ceiling/state", states.append, 100)

    def goes_on(shift: float) -> None:
        bench.until(lambda: abs(states[-1].header.stamp.sec - time.time() - shift) < 600.0)
        states.clear()
        bench.until(lambda: len(states) >= 50)
        paced = [nanoseconds_of(state.header.stamp) * 1e-9 for state in states]
        assert paced[-1] - paced[0] > 0.9 * 49 * PACE, "at its pace, not without a pause"

    with stepped(tmp_path, "motor_node", SIMULATED) as (step, end):
        bench.until(lambda: len(states) > 20)
        for shift in (-HOUR, 0.0):
            step(shift)
            goes_on(shift)
        log = end()
    assert f"{-HOUR:+.3f} s" in log
    assert f"{HOUR:+.3f} s" in log


def test_stamps_of_samples_go_on_with_the_devices_clock(bench: Bench, tmp_path: Path) -> None:
    with stepped(tmp_path, "acquisition_node", LASER) as (step, end):
        bench.until(lambda: len(bench.blocks) > 5)
        step(-HOUR)
        before = len(bench.blocks)
        bench.until(lambda: len(bench.blocks) >= before + 40)
        end()
    first, last = bench.blocks[0], bench.blocks[-1]
    elapsed = (nanoseconds_of(last.header.stamp) - nanoseconds_of(first.header.stamp)) * 1e-9
    assert elapsed == pytest.approx((last.first_index - first.first_index) / last.rate, abs=1e-3)
    assert last.dropped == 0
