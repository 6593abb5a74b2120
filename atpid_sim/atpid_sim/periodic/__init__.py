# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of beam and grain: found by Newton's method, their multipliers, and where they lose stability."""

from atpid_sim.periodic.cliff import Cliff, Loss, find_cliff, raised
from atpid_sim.periodic.return_map import Conditions, ReturnMap
from atpid_sim.periodic.solve import PeriodicMotion, SearchEnding, SteadyEnding, SteadyState, periodic_motion, solve
from atpid_sim.periodic.steady import steady_state

__all__ = [
    "Cliff", "Conditions", "Loss", "PeriodicMotion", "ReturnMap", "SearchEnding", "SteadyEnding", "SteadyState",
    "find_cliff", "periodic_motion", "raised", "solve", "steady_state",
]  # fmt: skip
