# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of beam and grain: found by Newton's method, their multipliers, and where they lose stability."""

from atpid_sim.periodic.cliff import Cliff, Loss, find_cliff, raised
from atpid_sim.periodic.return_map import Conditions, ReturnMap, passage
from atpid_sim.periodic.solve import (
    Method,
    PeriodicMotion,
    Search,
    SearchEnding,
    SteadyEnding,
    SteadySearch,
    SteadyState,
    periodic_motion,
    solve,
)
from atpid_sim.periodic.steady import steady_state

__all__ = [
    "Cliff", "Conditions", "Loss", "Method", "PeriodicMotion", "ReturnMap", "Search", "SearchEnding",
    "SteadyEnding", "SteadySearch", "SteadyState", "find_cliff", "passage", "periodic_motion", "raised", "solve",
    "steady_state",
]  # fmt: skip
