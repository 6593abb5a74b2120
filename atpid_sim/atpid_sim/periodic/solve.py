# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions by Newton's method on the return map, whether they are stable, and what a search for one returns.

A motion of period one or two is a fixed point of the return map over one or two periods. The multipliers, the
eigenvalues of the map's derivative there, are the factors by which small disturbances grow from one passage of the
section to the next: below 1 in modulus they die out.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns
from atpid_sim.engine.sections import Sections
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.return_map import Conditions, Orbit, ReturnMap, Slope, passage
from atpid_sim.results import Labelled, Rows, in_unit
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: Least multiplier of which a logarithm is taken.
_LEAST = 1e-12


class SteadyEnding(Enum):
    """How a search for a steady motion ended."""

    FOUND = "the steady motion was found, and one more period verified it"
    CHANGING = "excitation or ceiling change until the end: there is no steady motion"
    IRREGULAR = "the motion does not come to repeat itself, after up to 8 periods of the support: run it as it is"
    BY_CHANCE = "runs that differ slightly end in different motions: run the scene as it is"


class Method(Enum):
    """How a steady motion was found."""

    SHORT = "the transient followed with tabulated contacts until it contracted, the rest solved for"
    LONG = "the transient run at this fidelity until it drew together, the rest solved for"
    WAITED = "run at this fidelity until it repeated itself"


@dataclass(frozen=True, repr=False)
class SteadyState(Labelled):
    """A stable periodic motion that a scene ends in."""

    amplitude: float  # half peak-to-peak of the beam [m]
    error_estimate: float  # relative, of the amplitude: what is left of the way, tolerance, and model error
    periods: int  # of the drive after which it repeats itself
    multipliers: NDArray[np.complex128]  # (n,), the largest modulus first; of a grain that never flies two are 0
    followed: float  # how much was run, beyond the scene's end where it took that [s]
    section: Array  # (n,), see `periodic.return_map`
    phase: float  # of the section, as a share of a period
    impacts: Rows  # (k,) with the columns of `results.IMPACT`, times after the section
    fidelity: str
    method: Method = Method.SHORT

    labels = (
        {"amplitude": ("m", ""), "followed": ("s", ""), "multipliers": ("1", "multiplier"), "section": ("", "place")}
        | {"impacts": ("", "impact")}
        | in_unit("1", "stability_margin settling_periods")
    )

    @property
    def stability_margin(self) -> float:
        """Distance to instability, 1 - largest modulus of the multipliers [-]."""
        return 1.0 - float(abs(self.multipliers[0]))

    @property
    def settling_periods(self) -> float:
        """Periods of the drive in which a small disturbance falls to 1/e in the end."""
        return -self.periods / math.log(max(float(abs(self.multipliers[0])), _LEAST))


@dataclass(frozen=True, repr=False)
class SteadySearch(Labelled):
    """How a search ended, and the steady motion where one was found."""

    ending: SteadyEnding
    state: SteadyState | None = None


#: Newton's steps at most, and how often one is halved where it does not come closer.
_STEPS, _HALVINGS = 20, 6
#: Distance between two passages, relative to the motion's size, below which they are the same: rounding of
#: instantaneous impacts, or this many tolerances of integrated contacts.
_ROUNDING, _TOLERANCES = 1e-11, 30.0
#: Share of its distance from a motion to which a run has to come, twice that at most, and passages that it may take.
_ARRIVED, _PASSAGES = 0.1, 400
#: Tolerance of runs whose differences give multipliers.
_DIFFERENCES = 1e-9


class SearchEnding(Enum):
    """How a search for a periodic motion ended."""

    FOUND = "a periodic motion was found and repeats itself"
    NOT_CONVERGED = "Newton's method did not converge: no periodic motion of this period is near the start"
    NO_SECTION = "no section can be taken: the grain does not fly freely, or a run did not reach its end"


@dataclass(frozen=True)
class PeriodicMotion:
    """A motion that repeats itself after `periods` periods of the drive."""

    conditions: Conditions
    periods: int
    phase: float  # of the section, as a share of a period
    section: Array  # section state (n,): each mode [m], its velocity [m/s], the grain [m], its velocity [m/s]
    sections: Sections  # how that lies in a state of the engine
    amplitude: float  # half peak-to-peak of the beam [m]
    impacts: Array  # (k, 3): time after the section [s], wall (+1 floor, -1 ceiling), closing speed [m/s]
    slope: Array  # derivative of the return map (n, n)
    multipliers: NDArray[np.complex128]  # (n,), the largest modulus first
    multiplier_error: float  # of the largest modulus: its change when the differences are twice as wide
    residual: float  # distance between two passages, relative to the motion's size
    iterations: int

    @property
    def state(self) -> State:
        """State of the engine as the motion passes the section."""
        state = self.sections.flying(self.section)
        state.y[columns.TIME] = self.phase / self.conditions.frequency
        return state

    @property
    def largest_multiplier(self) -> float:
        """Largest modulus of the multipliers [-]."""
        return float(abs(self.multipliers[0]))

    @property
    def stability_margin(self) -> float:
        """Distance to instability, 1 - largest modulus of the multipliers [-]: negative where unstable."""
        return 1.0 - self.largest_multiplier

    @property
    def settling_periods(self) -> float:
        """Periods in which a small disturbance falls to 1/e in the end; infinite where it does not."""
        largest = self.largest_multiplier
        if largest >= 1.0:
            return math.inf
        return -self.periods / math.log(largest) if largest > 0.0 else 0.0

    @property
    def walls(self) -> tuple[int, ...]:
        """Walls in the order in which they are struck from the section on: +1 floor, -1 ceiling."""
        return tuple(int(wall) for wall in self.impacts[:, 1])


@dataclass(frozen=True)
class Search:
    """How a search ended, and the motion where one was found."""

    ending: SearchEnding
    motion: PeriodicMotion | None


def periodic_motion(
    integration: Integration, conditions: Conditions, state: State, phase: float = 0.0, periods: int = 1
) -> Search:
    """Return the periodic motion near a simulated one.

    integration: system, contact, fidelity and tolerance: fidelity `impact` is exact to rounding; with `soft` take
    1e-10. state: a state of the simulated motion at `phase` of the drive (a share of a period), settled as far as
    it may be. periods: after how many the motion is to repeat itself; each motion of period one is one of period two.
    """
    if periods < 1:
        raise ValueError(f"periods: given {periods}; allowed: at least 1")
    try:
        section_phase, section = passage(integration, conditions, state, phase, periods)
        return solve(ReturnMap(integration, conditions, section_phase, periods), section)
    except NumericalFailure:
        return Search(SearchEnding.NO_SECTION, None)


def solve(returns: ReturnMap, start: Array) -> Search:
    """Return the fixed point of a return map near a section state (n,)."""
    try:
        orbit = returns.orbit(start)
        scale = size_of(returns.integration, orbit.amplitude, returns.conditions)
        section, residual, iterations = _newton(returns, start, scale)
        if residual > tolerance_of(returns.integration):
            return Search(SearchEnding.NOT_CONVERGED, None)
        return Search(SearchEnding.FOUND, described(returns, section, scale, residual, iterations))
    except NumericalFailure:
        return Search(SearchEnding.NO_SECTION, None)
    except np.linalg.LinAlgError:  # a multiplier of exactly 1
        return Search(SearchEnding.NOT_CONVERGED, None)


def tolerance_of(integration: Integration) -> float:
    """Return the distance of two passages, relative to the motion's size, up to which they count as the same."""
    return _ROUNDING if integration.fidelity == "impact" else max(_ROUNDING, _TOLERANCES * integration.rtol)


def least_size(integration: Integration, conditions: Conditions) -> float:
    """Return the displacement [m] below which the amplitude of the beam is not the size of a motion."""
    return max(1e-3 * conditions.amplitude * integration.static_response, 1e-12)


def size_of(integration: Integration, amplitude: float, conditions: Conditions) -> Array:
    """Return the size (n,) of a motion with an amplitude of the beam [m]: displacements and velocities."""
    return integration.sizes(conditions.frequency) * max(amplitude, least_size(integration, conditions))


def arrives(returns: ReturnMap, start: Array, section: Array, scale: Array, leading: float) -> bool:
    """Return whether passages from a section state (n,) come to a fixed point (n,), as its leading multiplier has it.

    In more than four dimensions a run may come nearer for long and still end in another motion close by.
    """
    if not leading < 1.0:
        return False
    count = math.ceil(math.log(_ARRIVED) / math.log(max(leading, _ARRIVED)))
    if count > _PASSAGES:
        return False
    passages = returns.passages(start, count)
    if len(passages) < count:
        return False
    allowed = max(2.0 * _ARRIVED * _distance(start - section, scale), tolerance_of(returns.integration))
    return _distance(passages[-1] - section, scale) <= allowed


def multipliers_at(returns: ReturnMap, section: Array, scale: Array) -> NDArray[np.complex128]:
    """Return the multipliers (n,) at a section state (n,), from finely integrated runs. Raises NumericalFailure."""
    integration = returns.integration
    fine = integration.at_level(integration.fidelity, min(integration.rtol, _DIFFERENCES))
    return sorted_multipliers(returns.by(fine).slope(section, scale).matrix)


def sorted_multipliers(slope: Array) -> NDArray[np.complex128]:
    """Return the eigenvalues (n,) of a derivative (n, n), the largest modulus first."""
    found = np.linalg.eigvals(slope).astype(complex)
    return found[np.argsort(-np.abs(found), kind="stable")]


def _newton(returns: ReturnMap, start: Array, scale: Array) -> tuple[Array, float, int]:
    """Return section state, distance to its image relative to `scale`, and steps taken. Raises NumericalFailure."""
    section = start
    change = returns(section) - section
    for iteration in range(_STEPS):
        distance = _distance(change, scale)
        if distance <= tolerance_of(returns.integration):
            return section, distance, iteration
        step = np.linalg.solve(np.eye(len(section)) - returns.slope(section, scale).matrix, change)
        for halving in range(_HALVINGS):
            tried = section + step / 2.0**halving
            try:
                tried_change = returns(tried) - tried
            except NumericalFailure:
                continue
            if _distance(tried_change, scale) < distance:
                section, change = tried, tried_change
                break
        else:
            return section, distance, iteration
    return section, _distance(change, scale), _STEPS


def _distance(change: Array, scale: Array) -> float:
    return float(np.max(np.abs(change / scale)))


def described(returns: ReturnMap, section: Array, scale: Array, residual: float, iterations: int) -> PeriodicMotion:
    """Return the motion of a fixed point (n,) with its impacts and multipliers. Raises NumericalFailure."""
    orbit: Orbit = returns.orbit(section)
    slope: Slope = returns.slope(section, scale)
    multipliers = sorted_multipliers(slope.matrix)
    coarse = float(np.abs(np.linalg.eigvals(slope.coarse)).max())
    return PeriodicMotion(
        conditions=returns.conditions,
        periods=returns.periods,
        phase=returns.phase,
        section=section,
        sections=returns.integration.sections,
        amplitude=orbit.amplitude,
        impacts=orbit.impacts,
        slope=slope.matrix,
        multipliers=multipliers,
        multiplier_error=abs(coarse - float(abs(multipliers[0]))),
        residual=residual,
        iterations=iterations,
    )
