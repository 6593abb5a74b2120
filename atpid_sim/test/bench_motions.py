# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of the standard bench, near the ends of runs."""

from atpid_sim.engine.state import State
from atpid_sim.maps import DamperResponse
from atpid_sim.periodic import Conditions, PeriodicMotion, SearchEnding, periodic_motion
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.integration import Integration, Observation


def bench(mass_fraction: float = 0.1, fidelity: str = "soft") -> Integration:
    return Integration(standard_bench(grain={"mass_fraction": mass_fraction, "radius": 0.0085}), fidelity, 1e-10)


def settled(integration: Integration, amplitude: float, height: float) -> tuple[Conditions, State]:
    """Conditions, and the state at phase zero after the closed damper was opened and 50 periods have passed."""
    damper = DamperResponse(integration.scene)
    state, end = damper.closed_state(amplitude), 56.0 * damper.period
    path = (0.0, damper.diameter), (6.0 * damper.period, height)
    damper.advance(amplitude, state, path, Observation((end, end)))
    return Conditions(amplitude, damper.frequency, height), state


def motion_of(integration: Integration, amplitude: float, height: float, periods: int = 1) -> PeriodicMotion:
    found = periodic_motion(integration, *settled(integration, amplitude, height), periods=periods)
    assert found.ending is SearchEnding.FOUND
    assert found.motion is not None
    return found.motion
