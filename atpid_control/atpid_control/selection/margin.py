# SPDX-License-Identifier: Apache-2.0
"""A height with a margin: the best in the worst of many systems that may be the true one, found by a deadline.

The systems are the corners of the box of uncertainties, in the order of a two-level design, so that the first ones
already show every quantity at both ends, and after them random ones inside. Heights are looked at in those systems that
fail first; then the height that is least in the worst of them is verified in one system after another. What does not
hold gives way to the next height. So there is an answer at any time, and with it the number of systems it holds in.
"""

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import hadamard
from scipy.optimize import brentq

from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.maps import Best, DamperResponse, Ending, Timing
from atpid_sim.maps.best import FLAT, Mapper
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.system import Array, reduced_mass

#: Clearances that are looked at, as shares of the bare optimum's: so many at a time, this far apart, down to the least.
_BATCH, _STEP, _LEAST = 7, 0.05, 0.1
#: And between the best and its neighbours, in these steps.
_BETWEEN = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)
#: An irregular motion in any case counts as this many times as large: the margin is to avoid it.
_RUMBLE = 1.5
#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-4
#: How near to its steady motion a run ends, relative, and periods the next height is watched after the one below it.
_CLOSE, _NEXT = 5e-3, Timing(12.0, 6.0)
#: Columns of the Hadamard matrix of order 16 that are the fractional factorial design 2^(5-1) of resolution V: five
#: factors at two levels in 16 runs, products of two clear of each other (Box, Hunter and Hunter: E = ABCD).
_COLUMNS = (1, 2, 4, 8, 15)
_CORNERS = 16
#: Random systems inside the box, and their seed.
_INSIDE, _SEED = 16, 18
#: Another height has to promise less by this share for one to give way to it: not all is known of it.
_NOTABLE = 0.02
#: Systems verified between two looks at the clock.
_VERIFIED = 4
#: Time in which the ceiling opens slowly [s].
_TRAVEL = 1.0
#: Period-to-period variation from which on a short look shows rumble, and no transient that fades.
_RUMBLING = 0.1
#: Heights of irregular motion in a row, above which the others are taken to be irregular as well.
_CLIFF = 2
#: Largest logarithm of the factor by which the damping of a contact is changed, and the speed at which its restitution
#: is what it shall be [m/s].
_WIDEST, _SPEED = 5.0, 1.0
#: Systems in which heights are looked at: those that fail first, and those that respond most.
_FAILING, _RESPONDING = 3, 2
#: Least amplitude within its error bars, over the identified one.
_LEAST_AMPLITUDE = 0.05


@dataclass(frozen=True)
class Uncertainty:
    """How far each quantity may lie from its value, to either side, apart from the amplitude."""

    stiffness: float = 0.05  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]
    mass: float = 5e-3  # relative, of the beam [-]
    frequency: float = 5e-4  # relative, of the excitation: what identification leaves open [-]
    restitution: float = 0.05  # relative [-]


@dataclass(frozen=True)
class System:
    """A system that may be the true one."""

    damper: DamperResponse
    amplitude: float  # how far the support's amplitude lies from the identified one, in its error bars [-]
    frequency: float  # of the excitation, over the identified one [-]
    offset: float  # of the ceiling [m]
    travel: float  # time in which the ceiling opens [s]


@dataclass(frozen=True)
class Robust:
    """A safe height, and what it holds for."""

    height: float  # [m]
    amplitude: float  # of the beam where everything is as expected [m]
    worst: float  # largest of the beam in the systems verified [m]
    least: float  # least efficiency there, against the closed damper of the same system [-]
    verified: int  # systems it was verified in
    sampled: int  # systems there are
    regular: bool  # in all of them the motion repeats
    evaluations: int


def systems_of(scene: Scene, damper: DamperResponse, uncertainty: Uncertainty) -> list[System]:
    """Return the systems of a scene and its uncertainties, the expected one first.

    Each mass and restitution has a table of contacts, so they and the stiffness lie at their ends only.
    """
    made: dict[tuple[float, ...], DamperResponse] = {}
    found = [System(damper, 0.0, 1.0, 0.0, 0.0)]
    for k, (amplitude, frequency, *ends) in enumerate(points().tolist()):
        key = tuple(ends)
        if key not in made:
            made[key] = _changed(scene, damper.frequency, uncertainty, *ends)
        # a corner and the one that differs from it in the restitution alone are opened in different ways
        travel = _TRAVEL * ((k + k // _CORNERS) % 2)
        driven = 1.0 + frequency * uncertainty.frequency
        found.append(System(made[key], amplitude, driven, uncertainty.resolution, travel))
    return found


def points() -> Array:
    """Return points (n, 5) of the box: amplitude, frequency, mass, stiffness, restitution, each from -1 to 1.

    16 corners of a design, the 16 others, then corners of the last three with the first two anywhere inside.
    """
    first = np.asarray(hadamard(_CORNERS)[:, _COLUMNS], dtype=float)
    second = first * np.array([1.0, 1.0, 1.0, 1.0, -1.0])
    inside = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_INSIDE, 5))
    inside[:, 2:] = np.sign(inside[:, 2:])
    return np.concatenate([first, second, inside])


def _changed(
    scene: Scene, frequency: float, uncertainty: Uncertainty, mass: float, stiffness: float, restitution: float
) -> DamperResponse:
    """Return the response of a system at these ends, driven at the same frequency [Hz], its grain unchanged."""
    beam = scene.beam.model_dump()
    beam["mass"] *= 1.0 + mass * uncertainty.mass
    beam["stiffness"] *= 1.0 + stiffness * uncertainty.stiffness
    fraction = scene.grain_mass / (scene.grain_mass + beam["mass"])
    changed = scene.with_(beam=beam, mass_fraction=fraction)
    if isinstance(scene.excitation, HarmonicExcitation):
        changed = changed.with_(frequency=frequency)
    if uncertainty.restitution > 0.0:
        changed = with_restitution(changed, 1.0 + restitution * uncertainty.restitution)
    made = DamperResponse(changed, _RTOL)
    made.sufficient(0.0, math.inf)  # its table of contacts, in milliseconds
    return made


def with_stiffness(scene: Scene, damper: DamperResponse, factor: float) -> DamperResponse:
    """Return the response of a beam whose stiffness is `factor` times as large, driven at the same frequency."""
    beam = scene.beam.model_dump()
    beam["stiffness"] *= factor
    return DamperResponse(scene.with_(beam=beam, frequency=damper.frequency), _RTOL)


def with_restitution(scene: Scene, factor: float) -> Scene:
    """Return the scene with a contact whose restitution is `factor` times as large, at most 1.

    It is changed by the parameter that damps the contact, at the speed of the beam on its support's amplitude; a law
    without such a parameter, or without damping, stays as it is.
    """
    contact = scene.contact.model_dump(exclude_none=True)
    if "restitution" in contact:
        return scene.with_(contact=contact | {"restitution": min(contact["restitution"] * factor, 1.0)})
    name = next((name for name in ("damping_ratio", "damping") if contact.get(name)), None)
    if name is None:
        return scene
    mass, speed = reduced_mass(system_of(scene)), _SPEED
    wanted = min(restitution_of(contact_of(scene), speed, mass) * factor, 1.0 - 1e-9)

    def with_damping(log_factor: float) -> Scene:
        return scene.with_(contact=contact | {name: contact[name] * math.exp(log_factor)})

    def excess(log_factor: float) -> float:
        return restitution_of(contact_of(with_damping(log_factor)), speed, mass) - wanted

    if not excess(-_WIDEST) > 0.0 > excess(_WIDEST):
        return scene
    return with_damping(brentq(excess, -_WIDEST, _WIDEST, xtol=1e-3))


@dataclass(frozen=True)
class Excitation:
    """What was identified."""

    amplitude: float  # of the support [m]
    spread: float  # to either side [m]
    frequency: float  # [Hz]


class Verified(NamedTuple):
    """What a height comes to in a system."""

    amplitude: float  # of the beam [m]
    remaining: float  # over that of the closed damper [-]
    regular: bool

    @property
    def rating(self) -> float:
        """The amplitude [m], raised where the motion is irregular."""
        return self.amplitude * (1.0 if self.regular else _RUMBLE)


class Search:
    """The search for the height that is best in the worst of the systems."""

    def __init__(
        self, systems: list[System], excitation: Excitation, best: Best, limits: tuple[float, float], mapper: Mapper
    ) -> None:
        """See `robust_height`."""
        self._systems, self._given, self._limits, self._map = systems, excitation, limits, mapper
        self._diameter = systems[0].damper.diameter
        self._clearance = best.height - self._diameter
        level = systems[0].damper.sufficient(excitation.amplitude, FLAT).fidelity
        self._error = math.inf if level != systems[0].damper.fidelity else 0.0
        self._worst: dict[float, float] = {}  # height [m]: largest amplitude found so far [m]
        # the cliff lies at a share of the ballistic clearance, so it is lowest where that is least
        units = [damper.ballistic_clearance(a) for damper, a, _ in map(self._excited, range(len(systems)))]
        self._dangerous = sorted(range(len(systems)), key=lambda number: units[number])  # those first that fail first
        ends = {
            self._systems[k].damper: k for k in reversed(self._dangerous)
        }  # of each structure the one that fails first
        self._shown = sorted(ends.values(), key=self._dangerous.index)
        self._shown = [*self._shown[:_FAILING], *self._shown[-_RESPONDING:]]
        self.evaluations = 0

    def look(self, until: float) -> None:
        """Look at heights in the systems that fail first and respond most, then between the best of them.

        Lower ones follow until the best in the worst of these systems lies inside. until: as in `verify`.
        """
        top, step = 1.0, _STEP
        while top > _LEAST:
            lowest = self._raise([top - step * k for k in range(_BATCH)])
            if self.height > lowest or lowest <= self._limits[0] or time.monotonic() > until:
                break
            top -= step * _BATCH
        if time.monotonic() < until:
            best = (self.height - self._diameter) / self._clearance
            self._raise([best + part * step for part in _BETWEEN if best + part * step <= 1.0])

    def _raise(self, shares: list[float]) -> float:
        """Look at the heights at shares of the bare optimum's clearance, within the limits; return the lowest [m]."""
        low, high = self._limits
        heights = sorted({min(max(self._diameter + self._clearance * share, low), high) for share in shares})
        jobs = [(number, heights) for number in self._shown]
        found = list(self._map(self._raised, jobs))
        self.evaluations += len(jobs) * len(heights)
        self._worst.update(zip(heights, map(max, zip(*found, strict=True)), strict=True))
        return heights[0]

    @property
    def height(self) -> float:
        """The best height as far as is known [m]: the lowest that is not notably worse than the best."""
        limit = min(self._worst.values()) * (1.0 + FLAT)
        return min(height for height, value in self._worst.items() if value <= limit)

    def verify(self, until: float) -> Robust:
        """Verify the best height in one system after another; return it with what it holds for.

        until: when to end, on the monotonic clock [s]; the expected system comes first and is verified in any case.
        """
        while True:
            height, known = self.height, dict[int, Verified]()
            order = [0, *(number for number in self._dangerous if number != 0)]
            while len(known) < len(order) and (not known or time.monotonic() < until):
                numbers = order[len(known) : len(known) + _VERIFIED]
                known.update(zip(numbers, self._map(self._verified, [(k, height) for k in numbers]), strict=True))
                self.evaluations += len(numbers)
                if self._gives_way(height, known) and time.monotonic() < until:
                    break
            else:
                found = list(known.values())
                return Robust(
                    height=height,
                    amplitude=known[0].amplitude,
                    worst=max(one.amplitude for one in found),
                    least=1.0 - max(one.remaining for one in found),
                    verified=len(found),
                    sampled=len(order),
                    regular=all(one.regular for one in found),
                    evaluations=self.evaluations,
                )

    def _gives_way(self, height: float, known: dict[int, Verified]) -> bool:
        """Enter the worst found at a height [m]; return whether another one promises notably less.

        The system that was the worst is the first in which the other one is verified.
        """
        worst = max(known, key=lambda number: known[number].rating)
        self._worst[height] = max(self._worst[height], known[worst].rating)
        if (1.0 + _NOTABLE) * self._worst[self.height] >= self._worst[height]:
            return False
        self._dangerous.remove(worst)
        self._dangerous.insert(0, worst)
        return True

    def _excited(self, number: int) -> tuple[DamperResponse, float, float]:
        """Return response, support amplitude [m] and offset of the ceiling [m] of a system."""
        one, given = self._systems[number], self._given
        amplitude = max(given.amplitude + one.amplitude * given.spread, _LEAST_AMPLITUDE * given.amplitude)
        damper = one.damper.at_frequency(given.frequency * one.frequency)
        return damper.sufficient(amplitude, self._error), amplitude, one.offset

    def _raised(self, job: tuple[int, list[float]]) -> list[float]:
        """Amplitudes [m] at rising heights [m], the first opened from closed, the others raised from the one before."""
        number, heights = job
        damper, amplitude, offset = self._excited(number)
        value, irregular = math.inf, 0
        state, timing, found = damper.closed_state(amplitude), Timing(0.8 * damper.settling(), 8.0), []
        for height in heights:
            if irregular < _CLIFF:
                path = ((state.time, max(height + offset, damper.diameter)),)
                response = damper.follow_on(amplitude, state, path, timing, Ending(_CLOSE))
                rumbles = response.variation > _RUMBLING
                irregular = irregular + 1 if rumbles else 0
                value = response.amplitude * (_RUMBLE if rumbles else 1.0)
            found.append(value)
            timing = _NEXT
        return found

    def _verified(self, job: tuple[int, float]) -> Verified:
        number, height = job
        damper, amplitude, offset = self._excited(number)
        reached = max(height + offset, damper.diameter)
        travel, state = self._systems[number].travel, damper.closed_state(amplitude)
        path = ((0.0, damper.diameter), (travel, reached)) if travel > 0.0 else ((0.0, reached),)
        response = damper.follow_on(amplitude, state, path, Timing(damper.settling(), 12.0))
        return Verified(response.amplitude, response.amplitude / damper.closed_amplitude(amplitude), response.regular)


def robust_height(
    systems: list[System], excitation: Excitation, best: Best, limits: tuple[float, float], mapper: Mapper, until: float
) -> Robust:
    """Return the height whose largest amplitude over the systems is least.

    best: the bare optimum; limits: of the height [m]; until: when to end, on the monotonic clock [s], with what has
    been found so far. Raises NumericalFailure.
    """
    search = Search(systems, excitation, best, limits, mapper)
    search.look(until)
    return search.verify(until)
