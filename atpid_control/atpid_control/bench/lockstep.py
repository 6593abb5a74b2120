# SPDX-License-Identifier: Apache-2.0
"""The lockstep bench: all nodes in this process, the next block as soon as the loop has answered the last."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from atpid_control.bench.graph import PARTS, Parameters


def run_lockstep(parameters: Parameters, progress: Callable[[float], None]) -> None:
    """Run the graph until the plant has finished; `progress` is told the simulated time [s].

    Raises PlantFailedError where the plant fails, BenchError where the loop stops.
    """
    # nodes/ alone imports rclpy; by name, so that this module can be read, tested and linted without it
    composition = importlib.import_module("atpid_control.nodes.composition")
    composition.run_lockstep([(part.package, part.name) for part in PARTS], parameters, progress)
