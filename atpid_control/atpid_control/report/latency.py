# SPDX-License-Identifier: Apache-2.0
"""The latency of a run in real time: how long after the last sample of a block its estimate and its command are out."""

from collections.abc import Iterator, Mapping
from itertools import chain, pairwise
from typing import Any

from atpid_common.latency import percentile
from atpid_control.bags.read import Bag, stamp_of
from atpid_control.identification.identifier import last_stamp_ns

#: Stages of the loop, from the last sample of a block on.
STAGES = ("sample_to_block", "block_to_estimate", "estimate_to_command", "sample_to_command")

Latency = Mapping[str, Mapping[str, float]]


def latency_of(bag: Bag) -> Latency:
    """Return median, 99th percentile and maximum of each stage [s] of a run in real time; empty where there is none.

    A recorded time is that of the recorder, so a stage can come out a little too short or too long, even negative.
    """
    return {
        name: {"p50": percentile(values, 0.5), "p99": percentile(values, 0.99), "max": max(values)}
        for name, values in zip(STAGES, zip(*_answered(bag), strict=True), strict=False)
    }


def summary_line(latency: Latency) -> str:
    """Return the line of the summary; empty where nothing was measured."""
    if not latency:
        return ""
    whole = latency["sample_to_command"]
    stages = ", ".join(f"{name.replace('_', ' ')} {1e3 * latency[name]['p99']:.1f}" for name in STAGES[:-1])
    figures = f"median {1e3 * whole['p50']:.1f}, 99 % {1e3 * whole['p99']:.1f}, largest {1e3 * whole['max']:.1f} ms"
    return f"sample to command: {figures} (99 % of {stages} ms)"


def _answered(bag: Bag) -> Iterator[tuple[float, float, float, float]]:
    """Yield the stages' durations [s] for each block of the laser that has an estimate and a command."""
    estimates, commands = (
        {stamp_of(message): received for received, message in bag.of_kind(kind)}  # when each was recorded [ns]
        for kind in ("Excitation", "CeilingCommand")
    )
    for block_ns, block in laser_blocks(bag):
        scans = len(block.data) // max(1, len(block.channels))
        end = last_stamp_ns(stamp_of(block), int(block.first_index), scans, float(block.rate))
        if end in estimates and end in commands:
            times = (end, block_ns, estimates[end], commands[end])
            first, second, third = ((after - before) * 1e-9 for before, after in pairwise(times))
            yield first, second, third, (times[-1] - end) * 1e-9


def laser_blocks(bag: Bag) -> Iterator[tuple[int, Any]]:
    """Yield (log time [ns], block) of the laser."""
    lasers = (topic for topic in bag.topics_of("SampleBlock") if topic.endswith("laser"))
    return chain.from_iterable(map(bag.messages, lasers))
