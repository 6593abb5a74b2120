# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Ratings of heights in a search: amplitudes over all approach paths, at the quick level and the complete.

Near the optimum the motion depends on the path of the ceiling before.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any

from atpid_sim.engine.state import State
from atpid_sim.maps.response import NEVER, REPEATS, DamperResponse, EarlyEnd, Path, Timing, WindowResponse

#: From a damper, a height [m] and a time to settle at the first height [s] to the path of the ceiling.
Approach = Callable[[DamperResponse, float, float], Path]
#: Duration of slow travels of the ceiling [s]: the thesis's opening time.
TRAVEL = 1.0
#: Duration of a quick travel [periods].
_QUICK = 0.05
#: Clearance before the ceiling is raised or lowered, as a share of the final one.
_BELOW, _ABOVE = 0.5, 1.25


def at_once(_damper: DamperResponse, height: float, _rest: float) -> Path:
    """Open the closed damper at once."""
    return ((0.0, height),)


def opened(damper: DamperResponse, height: float, _rest: float) -> Path:
    """Open the closed damper slowly."""
    return (0.0, damper.diameter), (TRAVEL, height)


def _passed(damper: DamperResponse, height: float, rest: float, share: float) -> Path:
    """Come from another clearance, settled there: a share of the final one."""
    before = damper.diameter + share * (height - damper.diameter)
    return (0.0, before), (rest, before), (rest + TRAVEL, height)


raised: Approach = partial(_passed, share=_BELOW)
lowered: Approach = partial(_passed, share=_ABOVE)


def travelled(present: float, speed: float, delay: float = 0.0) -> Approach:
    """Come from a present height [m], settled there, at a speed [m/s], a delay [s] later."""

    def approach(_damper: DamperResponse, height: float, rest: float) -> Path:
        start = rest + delay
        return (0.0, present), (start, present), (start + max(abs(height - present) / speed, 1e-6), height)

    return approach


def later(approach: Approach, periods: float) -> Approach:
    """Move the ceiling as an approach does, so many periods of the support later: in another phase of the motion."""

    def path(damper: DamperResponse, height: float, rest: float) -> Path:
        (_, first), *moves = approach(damper, height, rest)
        delay = periods * damper.period
        if not moves:  # opened at once
            first, moves = damper.diameter, [(_QUICK * damper.period, height)]
        return (0.0, first), (delay, first), *((delay + time, reached) for time, reached in moves)

    return path


def _jumped(damper: DamperResponse, height: float, rest: float, phase: float, share: float) -> Path:
    """Raise the ceiling quickly from a share of the clearance, settled there, in a phase [periods].

    Not at once: a ceiling of 1e5 m/s that leaves a grain in contact tears it, where the contact is damped.
    """
    before, begin = damper.diameter + share * (height - damper.diameter), rest + phase * damper.period
    return (0.0, before), (begin, before), (begin + _QUICK * damper.period, height)


#: Raised quickly, in several phases: after these some motions stay irregular that are regular after all others.
JUMPS: tuple[Approach, ...] = tuple(
    partial(_jumped, phase=phase, share=share)
    for phase, share in ((0.37, 0.5), (0.71, 0.5), (0.11, 0.25), (0.62, 0.25), (0.45, 0.1), (0.9, 0.1), (0.27, 0.75))
)
#: All: a height that is good after each of them is good from every previous state.
ALL_APPROACHES: tuple[Approach, ...] = (raised, lowered, opened, at_once)
#: Approaches of a damper that is closed now.
FROM_CLOSED: tuple[Approach, ...] = (raised, opened, at_once)


#: Heights whose amplitudes differ by less than this share are equally good [-].
FLAT = 2e-3
#: Where the approach paths to a height end in amplitudes further apart than this, its motion is not reproducible, and
#: the surcharge on its amplitude.
REPRODUCIBLE, SURCHARGE = 1e-2, 1.05
#: While not all approaches are known, a height this much worse than the best so far is given up.
EXCEEDED = 1.08
#: How near to the steady motion a rating ends, and one that confirms another, relative to the amplitude [-].
_CLOSE, _CONFIRMED_CLOSE = 5e-4, 5e-3
#: A rating settles this many times as long as a transient lasts, since close to the cliff an instability grows slowly.
_PATIENT = 1.5
#: Where some approach paths end in a regular motion better than any before and others in an irregular one, these are
#: followed on, so many times as long as before, or where grains rebound far for so many periods: many come to the
#: regular one as well.
_LATER, _LATEST = 1.0, 4000.0
#: The height that is chosen is confirmed on the approach paths begun so many periods later: what depends on the phase
#: shows by chance only.
_PHASES = (0.37, 0.71)
#: Where grains rebound far, irregular motions come to a regular one after so many periods, or fewer.
_LONG_WAY = 180.0
#: Surcharge on an amplitude to which all paths come late: where others settle sooner they are preferred.
_SLOW = 0.02

#: Like `map`, its answers in the order of the jobs: on one core, or a pool's `map` on all.
Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Ratings:
    """Rates heights at one amplitude and keeps the amplitudes over their approach paths.

    A height is rated at the quick level, confirmed there in other phases, and checked at the complete one. As soon as
    the two levels disagree about a reproducible motion, only the complete one is taken.
    """

    def __init__(
        self, damper: DamperResponse, amplitude: float, approaches: Sequence[Approach], mapper: Mapper, irregular: float
    ) -> None:
        """See `best_height`; irregular: what the amplitude of an irregular motion counts as, in times itself [-]."""
        self._damper, self._amplitude, self._approaches, self._map = damper, amplitude, approaches, mapper
        self.quick = damper.sufficient(amplitude, FLAT)
        self._long = Timing(_PATIENT * damper.settling(), 16.0)
        if irregular > 1.0:
            self._long = Timing(max(self._long.settle, _LONG_WAY), 16.0, REPEATS)
        self._rated: dict[float, list[float]] = {}  # height [m]: amplitudes [m], quick
        self._checked: dict[float, list[float]] = {}  # the same, complete
        self._others: dict[float, list[float]] = {}  # the same of the paths in other phases
        self._surcharge, self._irregular = irregular, set[float]()  # heights of irregular motion [m]
        self.hopeful = set[float]()  # heights at which late paths are followed on in any case [m]
        self._late: dict[float, float] = {}  # height [m]: largest share of paths that come late to a regular motion
        self.evaluations = 0
        self.disagreement = 0.0  # largest between two levels at a height with reproducible motion, relative

    @property
    def heights(self) -> list[float]:
        """All heights rated [m]."""
        return list(self._rated | self._checked)

    def complete(self, height: float) -> bool:
        """Whether a height [m] is confirmed and checked."""
        return height in self._checked and height in self._others

    def checked(self, height: float) -> bool:
        """Whether a height [m] is rated at the complete level."""
        return height in self._checked

    def value(self, height: float) -> float:
        """Return what a rated height [m] counts with [m]: the worst amplitude over its paths, and surcharges.

        They are for paths that disagree, for paths that come late, and the mean of what other phases are worse by.
        """
        worst, others = self.worst(height), self._others.get(height, [])
        more = sum(max(one / worst - 1.0, 0.0) for one in others) / max(len(others), 1)
        slow = _SLOW * self._late.get(height, 0.0)
        gap = _gap(self._found(height))
        surcharge = 1.0 if gap <= REPRODUCIBLE else min(1.0 + gap, SURCHARGE)
        if height in self._irregular:
            surcharge = max(surcharge, self._surcharge)
        return worst * (1.0 + more + slow) * surcharge

    def worst(self, height: float) -> float:
        """Return the largest amplitude [m] over the paths to a rated height [m]."""
        return max(self._found(height))

    def reproducible(self, height: float) -> bool:
        """Whether all paths to a rated height [m], in all phases, end in the same motion."""
        return _gap(self._found(height) + self._others.get(height, [])) <= REPRODUCIBLE

    def _found(self, height: float) -> list[float]:
        return self._checked.get(height) or self._rated[height]

    def go_on(self, height: float) -> None:
        """Do the next that a height [m] not yet complete needs: rate, confirm or check it."""
        quick = self.quick is not self._damper and self.disagreement <= FLAT
        if quick and height not in self._rated and height not in self._checked:
            least = min(map(max, self._rated.values()), default=math.inf)
            # where grains rebound far a transient may exceed for long what the motion comes to
            limit = EXCEEDED * least if self._surcharge == 1.0 else math.inf
            self._rated[height] = self._rate(self.quick, height, EarlyEnd(_CLOSE, limit))
        elif quick and height not in self._others:
            self._confirm(height, self.quick)
        elif height not in self._checked:
            self.check(height)
        else:
            self._confirm(height, self._damper)

    def _confirm(self, height: float, damper: DamperResponse) -> None:
        """Rate a height [m] on the approach paths in other phases."""
        self._others[height] = self._rate(
            damper, height, EarlyEnd(_CONFIRMED_CLOSE), approaches=self._in_other_phases()
        )

    def _in_other_phases(self) -> list[Approach]:
        return [later(approach, phase) for approach, phase in zip(self._approaches, cycle(_PHASES), strict=False)]

    def check(self, height: float) -> None:
        """Rate a height [m] with the complete level; where its motion is reproducible in both, they are compared."""
        before = self._rated.get(height, [])
        self._checked[height] = found = self._rate(self._damper, height, EarlyEnd(_CLOSE))
        if before and max(_gap(before), _gap(found)) <= REPRODUCIBLE:
            self.disagreement = max(self.disagreement, abs(max(found) / max(before) - 1.0))

    def lasts(self, height: float, longer: float) -> bool:
        """Rate a height [m] in runs so many times as long; return whether they come to no more than the usual ones.

        Where an irregular motion has a surcharge, they are made in other phases and after jumps as well, and once more
        twice as long.
        """
        if height not in self._checked:
            self._checked[height] = self._rate(self._damper, height, NEVER)
        usual = max(self._checked[height])
        long = replace(self._long, settle=longer * self._long.settle / _PATIENT, window=longer * self._long.window)
        ways = [*self._approaches, *((*self._in_other_phases(), *JUMPS) if self._surcharge > 1.0 else ())]
        found = self._rate(self.quick, height, NEVER, long, ways)
        if self._surcharge > 1.0:
            # a slow beating passes for a regular motion in one window; beside a cliff transients are slow as well
            usual, long = min(usual, max(found)), replace(long, settle=2.0 * long.settle)
            self._checked[height] = found = self._rate(self.quick, height, NEVER, long, ways)
        else:
            self._checked[height] = self._checked[height] + found
        return max(found) <= (1.0 + REPRODUCIBLE) * usual

    def _rate(
        self,
        damper: DamperResponse,
        height: float,
        ending: EarlyEnd,
        timing: Timing | None = None,
        approaches: Sequence[Approach] = (),
    ) -> list[float]:
        """Return the amplitudes [m] at a height [m] over approach paths, by default all; timing: that of a rating."""
        jobs = [(damper, height, path, ending, timing or self._long) for path in approaches or self._approaches]
        self.evaluations += len(jobs)
        ends = list(self._map(self._approached, jobs))
        least = min((self.value(other) for other in self.heights if other != height), default=math.inf)
        late = [k for k, (response, _) in enumerate(ends) if not response.regular]
        better = any(response.regular and response.amplitude < least for response, _ in ends)
        if late and (better or height in self.hopeful):
            self._late[height] = max(self._late.get(height, 0.0), len(late) / len(ends))
            after = replace(self._long, settle=_LATEST if self._surcharge > 1.0 else _LATER * self._long.settle)
            more = [(damper, height, ends[k][1], replace(ending, limit=math.inf), after) for k in late]
            for k, end in zip(late, self._map(self._continued, more), strict=True):
                ends[k] = end
        if not all(response.regular for response, _ in ends):
            self._irregular.add(height)
        return [response.amplitude for response, _ in ends]

    def _approached(
        self, job: tuple[DamperResponse, float, Approach, EarlyEnd, Timing]
    ) -> tuple[WindowResponse, State]:
        damper, height, approach, ending, timing = job
        path = approach(damper, height, 0.5 * damper.settling() * damper.period)
        state = damper.closed_state(self._amplitude)
        return damper.follow_on(self._amplitude, state, path, timing, ending), state

    def _continued(self, job: tuple[DamperResponse, float, State, EarlyEnd, Timing]) -> tuple[WindowResponse, State]:
        damper, height, before, ending, timing = job
        state = before.copy()
        return damper.follow_on(self._amplitude, state, ((state.time, height),), timing, ending), state


def _gap(found: list[float]) -> float:
    """How far amplitudes differ, relative to the largest."""
    return (max(found) - min(found)) / max(found)
