# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A height with a margin: the best in the worst of many systems that may be the true one, found by a deadline.

Heights are looked at in those systems that fail first; then the height that is least in the worst of them is verified
in one system after another. What does not hold gives way to the next height, and one with an irregular motion in any
system to all that leave the beam less than twice as much, down to nearly closed. So there is an answer at any
time, and with it the number of systems it holds in.

The systems are the corners of the box of uncertainties, in the order of a two-level design, so that the first ones
already show every quantity at both ends, after them random ones inside, the ends of each quantity alone, and the
corners twice again: opened in the other way to a height that is too low, and raised from half the clearance at once.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from atpid_control.selection.protocol import Excitation
from atpid_sim.maps import Approach, DamperResponse, EarlyEnd, Timing
from atpid_sim.maps.height_search import BELOW_RESONANCE, LAST_BELOW
from atpid_sim.maps.ratings import FLAT, JUMPS, Mapper, at_once, opened
from atpid_sim.robust import RUMBLE, Response, corners, inside, lowest_best, with_beam, with_restitution
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array

#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-4
#: Random systems inside the box, and their seed.
_INSIDE, _SEED = 16, 18
#: Corners of a two-level design; there are twice as many.
_CORNERS = 16


@dataclass(frozen=True)
class MarginBox:
    """How far each quantity may lie from its value, to either side, apart from the amplitude.

    The excitation's frequency is identified, and with it the beam's mass is known but for its stiffness.
    """

    stiffness: float = 0.02  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]
    mass: float = 5e-3  # relative, of the beam [-]
    frequency: float = 5e-4  # relative, of the excitation [-]
    restitution: float = 0.05  # relative [-]


@dataclass(frozen=True)
class UncertainSystem:
    """A system that may be the true one."""

    damper: DamperResponse
    amplitude: float  # how far the support's amplitude lies from the identified one, in its error bars [-]
    frequency: float  # of the excitation, over the identified one [-]
    offset: float  # of the ceiling [m]
    approach: Approach  # how the ceiling comes to its height


def systems_of(scene: Scene, damper: DamperResponse, uncertainty: MarginBox) -> list[UncertainSystem]:
    """Return the systems of a scene and its uncertainties, the expected one first.

    Each mass and restitution has a table of contacts, so they and the stiffness lie at their ends only.
    """
    made: dict[tuple[float, ...], DamperResponse] = {}
    found = [UncertainSystem(damper, 0.0, 1.0, 0.0, at_once)]
    for (amplitude, frequency, *ends), (approach, side) in zip(points().tolist(), _approaches(), strict=True):
        key = tuple(ends)
        if key not in made:
            made[key] = _changed(scene, damper.frequency, uncertainty, *ends)
        driven = 1.0 + frequency * uncertainty.frequency
        found.append(UncertainSystem(made[key], amplitude, driven, side * uncertainty.resolution, approach))
    return found


def points() -> Array:
    """Return points (n, 5) of the box: amplitude, frequency, mass, stiffness, restitution, each from -1 to 1.

    16 corners of a design, the 16 others, then corners of the last three with the first two anywhere inside, the middle
    of each face, and the 32 corners twice again.
    """
    first = corners(5)
    second = first * np.array([1.0, 1.0, 1.0, 1.0, -1.0])
    drawn = inside(_INSIDE, 5, _SEED)
    drawn[:, 2:] = np.sign(drawn[:, 2:])
    return np.concatenate([first, second, drawn, np.eye(5), -np.eye(5), *(2 * [first, second])])


def _approaches() -> list[tuple[Approach, float]]:
    """Return how the ceiling comes to its height at each of `points`, and to which side of it it errs (1 or -1).

    A corner and the one that differs from it in the restitution alone are opened in different ways.
    """
    pair, size = 2 * _CORNERS, len(points()) - 2 * 2 * _CORNERS
    turns = [(k + k // _CORNERS) % 2 for k in range(size)]
    first = [((at_once, opened)[turn], 1.0) for turn in turns]
    lower = [((opened, at_once)[turn], -1.0) for turn in turns[:pair]]
    return [*first, *lower, *((JUMPS[turn], 1.0) for turn in turns[:pair])]


def _changed(
    scene: Scene, frequency: float, uncertainty: MarginBox, mass: float, stiffness: float, restitution: float
) -> DamperResponse:
    """Return the response of a system at these ends, driven at the same frequency [Hz], its grain unchanged."""
    changed = with_beam(scene, mass=1.0 + mass * uncertainty.mass, stiffness=1.0 + stiffness * uncertainty.stiffness)
    if scene.excitation.is_tone:
        changed = changed.with_(frequency=frequency)
    if uncertainty.restitution > 0.0:
        # a contact without such a parameter stays as it is
        changed = with_restitution(changed, 1.0 + restitution * uncertainty.restitution) or changed
    made = DamperResponse(changed, _RTOL)
    made.sufficient(0.0, math.inf)  # its table of contacts, in milliseconds
    return made


#: Clearances that are looked at, as shares of the bare optimum's: so many at a time, each by this share less than the
#: one before, down to the least.
_BATCH, _STEP, _LEAST = 7, 0.05, 0.02
#: A height of irregular motion in any system gives way to regular ones that leave the beam less than so many times its
#: amplitude [-].
IRREGULAR = 2.0
#: And between the best and its neighbours, in these steps.
_BETWEEN = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)
#: Clearances of the expected system, as shares of the ballistic one, where its bare optimum is not known.
_FIRST, _LAST, _COARSE = 0.30, 1.02, 0.08
#: How near to its steady motion a run ends, relative, and periods the next height is watched after the one below it.
_CLOSE, _NEXT = 5e-3, Timing(12.0, 6.0)
#: The same of a run that verifies a height, how many times as long as a transient it settles, and periods watched.
_VERIFIED_CLOSE, _PATIENT, _WATCHED = 5e-4, 2.0, 24.0
#: Another height has to promise less by this share for one to give way to it: not all is known of it.
_NOTABLE = 0.02
#: Systems verified before the next look at whether another height promises less.
_VERIFIED = 4
#: Period-to-period variation from which on a short look shows rumble, and no transient that fades.
_RUMBLING = 0.1
#: Heights of irregular motion in a row, above which the others are taken to be irregular as well.
_CLIFF = 2
#: Systems in which heights are looked at: those that fail first, and those that respond most.
_FAILING, _RESPONDING = 3, 2
#: Least amplitude within its error bars, over the identified one.
_LEAST_AMPLITUDE = 0.05


@dataclass(frozen=True)
class Robust:
    """A safe height, and what it holds for."""

    height: float  # [m]
    amplitude: float  # of the beam where everything is as expected [m]
    worst: float  # largest of the beam in the systems verified [m]
    least: float  # least efficiency there, against the closed damper of the same system [-]
    verified: int  # systems it was verified in
    sampled: int  # systems there are
    irregular: int  # systems among them in which the motion does not repeat
    evaluations: int


class MarginSearch:
    """The search for the height whose largest amplitude over the systems is least.

    Only the expected system is verified in any case.
    """

    def __init__(
        self,
        systems: list[UncertainSystem],
        excitation: Excitation,
        limits: tuple[float, float],
        mapper: Mapper,
        late: Callable[[], bool],
    ) -> None:
        """Take the systems.

        excitation: its amplitude may lie its deviation to either side; limits: of the height [m]; late: whether to end
        with what has been found so far, asked before every run.
        """
        self._systems, self._given, self._map, self._late = systems, excitation, mapper, late
        expected = systems[0].damper
        self._diameter, self._limits = expected.diameter, limits
        level = expected.sufficient(excitation.amplitude, FLAT).fidelity
        self._error = math.inf if level != expected.fidelity else 0.0
        self._worst: dict[float, float] = {}  # height [m]: largest amplitude found so far [m]
        self._clearance, self._top = math.nan, 1.0  # of the bare optimum [m], and the share looked at next
        self._irregular = set[float]()  # heights of irregular motion in some system [m]
        self._known: dict[float, dict[int, Response]] = {}  # height [m]: what it comes to, by the system's number
        # the cliff lies at a share of the ballistic clearance, so it is lowest where that is least
        units = [damper.ballistic_clearance(a) for damper, a, _ in map(self._excited, range(len(systems)))]
        self._dangerous = sorted(range(len(systems)), key=lambda number: units[number])  # those first that fail first
        # of each structure the one that fails first
        ends = {self._systems[k].damper: k for k in reversed(self._dangerous)}
        shown = sorted(ends.values(), key=self._dangerous.index)
        self._shown = list(dict.fromkeys([*shown[:_FAILING], *shown[-_RESPONDING:]]))
        self.evaluations = 0

    def found(self, bare: float) -> Robust:
        """Return the height; bare: the bare optimum [m], NaN: unknown. Raises NumericalFailure."""
        self._look(self._bare() if math.isnan(bare) else bare)
        return self._verify()

    def _bare(self) -> float:
        """Return about the bare optimum [m] from a look at the expected system; its lowest height if time is over."""
        damper = self._systems[0].damper.at_frequency(self._given.frequency)
        below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
        unit, last = damper.ballistic_clearance(self._given.amplitude), LAST_BELOW if below else _LAST
        heights = self._allowed(unit, np.arange(_FIRST, last, _COARSE).tolist())
        found = list(self._map(self._raised, [(0, [height]) for height in heights]))
        self.evaluations += sum(map(len, found))
        return min(((*seen, math.inf)[0], height) for seen, height in zip(found, heights, strict=True))[1]

    def _look(self, bare: float) -> None:
        """Look at heights up to the bare optimum [m] in the systems that fail first and respond most.

        Lower ones follow until the best in the worst of these systems lies inside, then some between the best of them.
        """
        self._clearance = bare - self._diameter
        while self._lower() and self.height == min(self._worst) and not self._late():
            pass
        length = self.height - self._diameter
        between = [length * (1.0 + part * _STEP) for part in _BETWEEN]
        self._raise(self._allowed(1.0, [one for one in between if one <= self._clearance]))

    def _lower(self) -> bool:
        """Look at the next lower heights; return whether there were any."""
        if self._top < _LEAST or min(self._worst, default=math.inf) <= max(self._limits[0], self._diameter):
            return False
        shares = [self._top * (1.0 - _STEP) ** k for k in range(_BATCH)]
        self._top = shares[-1] * (1.0 - _STEP)
        self._raise(self._allowed(self._clearance, shares))
        return True

    def _allowed(self, unit: float, shares: Sequence[float]) -> list[float]:
        """Return the heights [m] at shares of a clearance [m], rising, within the limits."""
        low, high = self._limits
        return sorted({min(max(self._diameter + unit * share, low), high) for share in shares})

    def _raise(self, heights: list[float]) -> None:
        """Look at rising heights [m]. Where none is seen in all systems, the lowest is what is left."""
        jobs = [(number, heights) for number in self._shown]
        found = list(self._map(self._raised, jobs))
        self.evaluations += sum(map(len, found))
        seen = list(zip(*(values[: min(map(len, found))] for values in found), strict=True))
        for height, worst in zip(heights, map(max, seen), strict=False):
            self._worst.setdefault(height, worst)
        if not self._worst:
            self._worst[heights[0]] = math.inf

    @property
    def height(self) -> float:
        """The best height as far as is known [m]: the lowest that is not notably worse than the best."""
        return lowest_best(self._worst)

    def _verify(self) -> Robust:
        """Verify the best height in one system after another, the expected one first; return what it holds for.

        One with an irregular motion gives way to all others, and where there is no other, lower ones are looked at.
        """
        while True:
            height = self.height
            known = self._known.setdefault(height, {})
            order = [0, *(number for number in self._dangerous if number != 0)]
            while left := [number for number in order if number not in known]:
                numbers = left[:_VERIFIED]
                found = self._map(self._verified, [(number, height) for number in numbers])
                known.update((k, one) for k, one in zip(numbers, found, strict=True) if one is not None)
                if self._late():
                    return self._held(height, known)
                if self._gives_way(height, known):
                    break
            else:
                return self._held(height, known)

    def _held(self, height: float, known: dict[int, Response]) -> Robust:
        """Return a height [m] with what it has been found to hold for."""
        found = known.values()
        return Robust(
            height=height,
            amplitude=known[0].amplitude,
            worst=max(one.amplitude for one in found),
            least=min(one.efficiency for one in found),
            verified=len(found),
            sampled=len(self._systems),
            irregular=sum(not one.regular for one in found),
            evaluations=self.evaluations + sum(map(len, self._known.values())),
        )

    def _gives_way(self, height: float, known: dict[int, Response]) -> bool:
        """Enter the worst found at a height [m]; return whether another one is looked at in its place.

        The system that was the worst is the first in which the other one is verified.
        """
        worst = max(known, key=lambda number: (not known[number].regular, known[number].amplitude))
        largest = max(one.amplitude for one in known.values())
        self._worst[height] = max(self._worst[height], largest * (1.0 if known[worst].regular else IRREGULAR))
        if not known[worst].regular:
            self._irregular.add(height)
            while self.height in self._irregular and not self._late() and self._lower():
                pass
        if (1.0 + _NOTABLE) * self._worst[self.height] >= self._worst[height]:
            return False
        self._dangerous.remove(worst)
        self._dangerous.insert(0, worst)
        return True

    def _excited(self, number: int) -> tuple[DamperResponse, float, float]:
        """Return response, support amplitude [m] and offset of the ceiling [m] of a system."""
        one, given = self._systems[number], self._given
        amplitude = max(given.amplitude + one.amplitude * given.amplitude_std, _LEAST_AMPLITUDE * given.amplitude)
        damper = one.damper.at_frequency(given.frequency * one.frequency)
        return damper.sufficient(amplitude, self._error), amplitude, one.offset

    def _raised(self, job: tuple[int, list[float]]) -> list[float]:
        """Amplitudes [m] in a system at rising heights [m], as many of them as the time is enough for.

        The first is opened from closed, the others are raised from the one before.
        """
        number, heights = job
        damper, amplitude, offset = self._excited(number)
        value, irregular = math.inf, 0
        state, timing, found = damper.closed_state(amplitude), Timing(0.8 * damper.settling(), 8.0), list[float]()
        for height in heights:
            if self._late():
                break
            if irregular < _CLIFF:
                path = ((state.time, max(height + offset, damper.diameter)),)
                response = damper.follow_on(amplitude, state, path, timing, EarlyEnd(_CLOSE))
                rumbles = response.variation > _RUMBLING
                irregular = irregular + 1 if rumbles else 0
                value = response.amplitude * (RUMBLE if rumbles else 1.0)
            found.append(value)
            timing = _NEXT
        return found

    def _verified(self, job: tuple[int, float]) -> Response | None:
        """What a height [m] comes to in a system; None: the time has passed, and it is not the expected one."""
        number, height = job
        if number != 0 and self._late():
            return None
        damper, amplitude, offset = self._excited(number)
        reached = max(height + offset, damper.diameter)
        rest, state = 0.5 * damper.settling() * damper.period, damper.closed_state(amplitude)
        path = self._systems[number].approach(damper, reached, rest)
        timing = Timing(_PATIENT * damper.settling(), _WATCHED)
        response = damper.follow_on(amplitude, state, path, timing, EarlyEnd(_VERIFIED_CLOSE))
        reduction = efficiency(response.amplitude, damper.closed_amplitude(amplitude))
        return Response(response.amplitude, reduction, response.regular)
