# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Curves of periodic motions: a branch in one parameter through its folds, and a cliff in two.

Both are followed by pseudo-arclength (H. B. Keller 1977): the next point is sought on the plane across the line through
the last two, at a distance from the last, so that a curve may turn. A branch is the fixed point of the return map; a
cliff has one unknown more and one equation more, the condition of the bifurcation that ends the stable motion:
prod(1 - m) = 0 over all multipliers m for a fold, prod(1 + m) = 0 for a doubling, prod(1 - m n) = 0 over all pairs for
beating, and for grazing that the grain turns at a distance from the wall of (almost) zero. The last is solved on the
side without the touch, where the map is smooth; with it the largest multiplier grows as one over the touch's speed.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.cliff import Loss, changed
from atpid_sim.periodic.return_map import Conditions, ReturnMap, passage
from atpid_sim.periodic.solve import PeriodicMotion, described, size_of, sorted_multipliers, tolerance_of
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: _Ranges of the parameters that are free, by their names in `Conditions`, in SI units.
_Ranges = Mapping[str, tuple[float, float]]
#: Lengths of a step: the first, the largest and the least, in units of the motion's size and of the parameters' ranges;
#: smallest cosine of the angle between steps, and largest length of one over the length asked for.
_FIRST, _LARGEST, _LEAST, _STRAIGHT, _AWAY = 5e-3, 8e-2, 2e-6, 0.97, 1.5
#: Steps of Newton's method at most; half-widths of its differences, and largest last step where there is a condition on
#: multipliers, of instantaneous and of integrated contacts.
_ITERATIONS, _NARROW, _WIDE, _LAST = 14, (1e-7, 3e-6), (1e-5, 1e-3), (1e-9, 1e-5)
#: Distance from the wall that counts as none, in half-widths.
_TOUCH = 10.0
#: Share of the map's largest slope by which rounding may leave more of a passage; largest multiplier followed.
_ROUNDED, _MOST = 1e-2, 1e4
#: How far a branch that stays stable is taken over a touch at which the map has no derivative, in ranges.
_OVER_TOUCH = (1e-4, 1e-3, 1e-2)
#: Halvings of a step in which a condition changes its sign, and how far from zero it may be there: else it jumps.
_HALVINGS, _ZERO = 32, 1e-3
#: How far above 1 the largest modulus may be on a cliff, and how far below one a motion has to be stable, relative.
_OVER, _JUST_BELOW = 1e-3, 1e-3
#: Where another bifurcation takes over: how far below and along a stable motion is looked for, relative; how often;
#: relative change of the height beyond which it is the cliff of another motion.
_FURTHER, _RESTARTS, _ANOTHER = (0.01, 0.003, 0.001, 0.03), 20, 0.1
#: Share of a range within which a curve is at its end; points of one at most, as it may be closed.
_END, _POINTS = 1e-4, 1000


@dataclass(frozen=True)
class Bifurcation:
    """Where a branch changes its stability, or ends."""

    loss: Loss
    motion: PeriodicMotion  # at it; of grazing at a distance from the wall of 1e-6 of its size, 3e-5 if integrated
    ends_stability: bool  # stable before, not behind


@dataclass(frozen=True)
class Branch:
    """A branch of periodic motions, stable or not, and its bifurcations, in the order in which it was followed."""

    motions: tuple[PeriodicMotion, ...]
    bifurcations: tuple[Bifurcation, ...]

    @property
    def cliff(self) -> Bifurcation | None:
        """The bifurcation that first ends its stability; None where nothing does."""
        return next((each for each in self.bifurcations if each.ends_stability), None)


def follow_branch(integration: Integration, motion: PeriodicMotion, ranges: _Ranges, to_cliff: bool = False) -> Branch:
    """Follow a periodic motion in one parameter, at first upward, through folds to the end of its range, or its own.

    ranges: of the one parameter. to_cliff: end where the motion stops to be stable. Raises NumericalFailure.
    """
    motions, found = [motion], list[Bifurcation]()
    for following in itertools.islice(_steps(integration, motion, ranges), _POINTS):
        found += _between(integration, motions[-1], following, ranges)
        grazed = bool(found) and found[-1].loss is Loss.GRAZING and found[-1].ends_stability
        if grazed or following.largest_multiplier > _MOST:
            break
        motions.append(following)
        if to_cliff and following.stability_margin <= 0.0:
            break
    else:
        last, named = motions[-1], bool(found) and found[-1].loss is Loss.GRAZING
        touch = None if named or _at_end(last, ranges) else _touch(integration, last, ranges) or last
        if touch is not None and (touch is not last or last.stability_margin > 0.0):
            found.append(Bifurcation(Loss.GRAZING, touch, last.stability_margin > 0.0))
    return Branch(tuple(motions), tuple(found))


def follow_cliff(integration: Integration, cliff: Bifurcation, ranges: _Ranges) -> tuple[Bifurcation, ...]:
    """Follow what ends the stability of a branch over the height in a second parameter, both ways.

    ranges: of the height first, then of the second parameter. Where another bifurcation comes first the curve goes on
    with that. The points are in order along the curve; it ends at a range, or where no stable motion is found below.
    """
    down, up = (_one_way(integration, cliff, ranges, way) for way in (-1.0, 1.0))
    return (*reversed(down), cliff, *up)


def _one_way(integration: Integration, cliff: Bifurcation, ranges: _Ranges, way: float) -> list[Bifurcation]:
    found, following = [cliff], cliff
    for _ in range(_RESTARTS):
        steps = _steps(integration, following.motion, ranges, following.loss, way)
        for motion in itertools.islice(steps, _POINTS):
            if following.loss is Loss.GRAZING:
                below = changed(integration, motion, _below(motion, _JUST_BELOW))
                if below is None or below.stability_margin <= 0.0:
                    break
            elif motion.largest_multiplier > 1.0 + _OVER:
                break
            found.append(Bifurcation(following.loss, motion, True))
        last = found[-1].motion
        another = None if _at_end(last, ranges) else _next_cliff(integration, last, ranges, way)
        if another is None or abs(another.motion.conditions.height / last.conditions.height - 1.0) > _ANOTHER:
            break
        found.append(following := another)
    return found[1:]


def _next_cliff(integration: Integration, last: PeriodicMotion, ranges: _Ranges, way: float) -> Bifurcation | None:
    """Return the bifurcation that ends the stable motion below a point of a cliff, a little further along."""
    height, (name, (low, high)) = ranges.items()
    for share in _FURTHER:
        further = getattr(last.conditions, name) + way * share * (high - low)
        motion = changed(integration, last, _below(last, share))
        if motion is not None and low < further < high:
            motion = changed(integration, motion, motion.conditions._replace(**{name: further}))
        if motion is not None and motion.stability_margin > 0.0:
            return follow_branch(integration, motion, dict([height]), to_cliff=True).cliff
    return None


def _below(motion: PeriodicMotion, share: float) -> Conditions:
    return motion.conditions._replace(height=motion.conditions.height * (1.0 - share))


def _at_end(motion: PeriodicMotion, ranges: _Ranges) -> bool:
    """Return whether a motion is at the end of the range of a parameter."""
    values = {name: (getattr(motion.conditions, name) - low) / (high - low) for name, (low, high) in ranges.items()}
    return any(min(value, 1.0 - value) < _END for value in values.values())


class _Problem:
    """Equations of a point of a curve near a motion, in units of its size and of the parameters' ranges."""

    def __init__(self, integration: Integration, near: PeriodicMotion, ranges: _Ranges, loss: Loss | None) -> None:
        self.integration, self.near, self.names, self.loss = integration, near, tuple(ranges), loss
        # the section moves with the flight
        self.phase, self.section = passage(integration, near.conditions, near.state, near.phase, near.periods)
        self.size, spans = size_of(integration, near.amplitude, near.conditions), [b - a for a, b in ranges.values()]
        self.scale = np.array([*self.size, *spans])
        exact = integration.fidelity == "impact"
        self.width = (_NARROW if loss in (None, Loss.GRAZING) else _WIDE)[0 if exact else 1]
        self.last = math.inf if loss is None else _LAST[0 if exact else 1]
        self.tolerance = tolerance_of(integration)

    def point(self, motion: PeriodicMotion) -> Array:
        """Return the unknowns of a motion of the same branch: its state at this section, and its parameters."""
        conditions, turn = motion.conditions, (self.phase - motion.phase) % 1.0
        once = ReturnMap(self.integration, conditions, self.phase)
        section = motion.section
        if turn > 0.0:
            section = ReturnMap(self.integration, conditions, motion.phase).part(section, turn)
        passed = [section]
        for _ in range(motion.periods - 1):
            passed.append(once(passed[-1]))
        section = min(passed, key=lambda each: float(np.abs((each - self.section) / self.size).max()))
        return np.asarray(np.array([*section, *(getattr(conditions, name) for name in self.names)]) / self.scale)

    def returns(self, point: Array) -> tuple[ReturnMap, Array]:
        """Return map and section state of a point. Raises NumericalFailure where a parameter is none."""
        values = dict(zip(self.names, (point * self.scale)[len(self.size) :].tolist(), strict=True))
        if min(values.values()) <= 0.0:
            raise NumericalFailure("the curve leaves the values that a parameter may have")
        conditions = self.near.conditions._replace(**values)
        returns = ReturnMap(self.integration, conditions, self.phase, self.near.periods)
        return returns, point[: len(self.size)] * self.size

    def __call__(self, point: Array) -> Array:
        """Return what is missing to a point of the curve."""
        returns, section = self.returns(point)
        after, orbit = returns.passed(section)
        missing: Array = (after - section) / self.size
        if self.loss is None:
            return missing
        if self.loss is not Loss.GRAZING:
            slope = returns.slope(section, self.size).matrix
            return np.array([*missing, np.prod(factors(sorted_multipliers(slope))[self.loss]).real])
        clearance = returns.clearance(section) / self.scale[0]
        if math.isinf(clearance) or sorted(orbit.impacts[:, 1]) != sorted(self.near.impacts[:, 1]):
            raise NumericalFailure("another number of touches than the motion near by has")
        return np.array([*missing, clearance - _TOUCH * self.width])

    def solve(self, guess: Array, direction: Array | None = None) -> PeriodicMotion:
        """Return the motion near a guess, in the plane across a direction there; raises NumericalFailure."""

        def whole(point: Array) -> Array:
            missing = self(point)
            return missing if direction is None else np.array([*missing, direction @ (point - guess)])

        point, missing, taken = guess, whole(guess), math.inf
        slope = _slope(whole, point, self.width)
        for iteration in range(_ITERATIONS):
            rounded = max(1.0, _ROUNDED * float(np.abs(slope).max()))
            if np.abs(missing[: len(self.size)]).max() <= self.tolerance * rounded and taken <= self.last:
                returns, section = self.returns(point)
                residual = float(np.abs(missing[: len(self.size)]).max())
                return described(returns, section, self.size, residual, iteration)
            step = np.asarray(np.linalg.lstsq(slope, -missing, rcond=1e-12)[0], dtype=float)
            taken = float(np.abs(step).max())
            if not taken <= 1.0:
                break
            after = whole(point + step)
            slope = slope + np.outer(after - missing - slope @ step, step) / (step @ step + 1e-300)  # Broyden's
            point, missing = point + step, after
        raise NumericalFailure("Newton's method did not converge to a point of the curve")


def factors(multipliers: NDArray[np.complex128]) -> dict[Loss, NDArray[np.complex128]]:
    """Return the factors whose product vanishes at a fold or branching, a doubling, and beating."""
    pairs = np.prod(list(itertools.combinations(multipliers, 2)), axis=1)
    return {Loss.FOLD: 1.0 - multipliers, Loss.DOUBLING: 1.0 + multipliers, Loss.BEATING: 1.0 - pairs}


def _condition(motion: PeriodicMotion, loss: Loss) -> float:
    return float(np.prod(factors(motion.multipliers)[loss]).real)


def _slope(function: Callable[[Array], Array], point: Array, width: float) -> Array:
    steps = width * np.eye(len(point))
    return np.array([(function(point + each) - function(point - each)) / (2.0 * width) for each in steps]).T


def _steps(
    integration: Integration, motion: PeriodicMotion, ranges: _Ranges, loss: Loss | None = None, way: float = 1.0
) -> Iterator[PeriodicMotion]:
    """Yield the motions of a curve behind its first; the last parameter rises at first (way 1) or falls (way -1)."""
    before: PeriodicMotion | None = None
    step, direction, ended = _FIRST, np.zeros(0), False
    while not ended:
        if step < _LEAST:  # as where the map has no derivative: a motion that is stable beyond as well goes on
            beyond = next(_over_touch(integration, motion, ranges, way), None) if loss is None else None
            if beyond is None:
                return
            before, motion, step = None, beyond, _FIRST
            yield motion
        try:
            problem = _Problem(integration, motion, ranges, loss)
            here = problem.point(motion)
            if before is None:
                direction = np.linalg.svd(_slope(problem, here, problem.width))[2][-1]  # the tangent
                direction = direction * way * math.copysign(1.0, direction[-1])
            else:
                direction = here - problem.point(before)
                direction /= np.linalg.norm(direction)
            first = len(problem.size)
            limits = np.array(list(ranges.values())).T / problem.scale[first:]
            guess, plane = here + step * direction, direction
            over = np.flatnonzero((guess[first:] < limits[0]) | (guess[first:] > limits[1])) + first
            if ended := len(over) > 0:  # the first limit that the step passes is its end
                shares = (np.clip(guess[first:], *limits)[over - first] - here[over]) / direction[over]
                guess, plane = here + shares.min() * direction, np.eye(len(here))[over[np.argmin(shares)]]
            found = problem.solve(guess, plane)
            moved = problem.point(found) - here
            length = float(np.linalg.norm(moved))
            if length > _AWAY * step or moved @ direction < _STRAIGHT * length:
                raise NumericalFailure("another curve, or a sharp bend")
        except (NumericalFailure, np.linalg.LinAlgError):
            step, ended = 0.5 * step, False
            continue
        before, motion = motion, found
        way = math.copysign(1.0, direction[-1])
        step = min(1.4 * step, _LARGEST)
        yield found


def _over_touch(
    integration: Integration, motion: PeriodicMotion, ranges: _Ranges, way: float
) -> Iterator[PeriodicMotion]:
    """Yield what a stable motion becomes a little further along, where it is stable there."""
    ((name, (low, high)),) = ranges.items()
    for share in _OVER_TOUCH:
        value = getattr(motion.conditions, name) + way * share * (high - low)
        if low < value < high and motion.stability_margin > 0.0:
            found = changed(integration, motion, motion.conditions._replace(**{name: value}))
            if found is not None and found.stability_margin > 0.0:
                yield found


def _between(
    integration: Integration, before: PeriodicMotion, after: PeriodicMotion, ranges: _Ranges
) -> list[Bifurcation]:
    """Return the bifurcations between two neighbours of a branch: where conditions change their sign."""
    ends, found = before.stability_margin > 0.0 >= after.stability_margin, list[tuple[float, Loss, PeriodicMotion]]()
    problem = _Problem(integration, before, ranges, None)
    start, way = problem.point(before), problem.point(after) - problem.point(before)
    for loss in (Loss.FOLD, Loss.DOUBLING, Loss.BEATING):
        sign = _condition(before, loss)
        if sign * _condition(after, loss) >= 0.0:
            continue
        motion, share = before, 0.0
        for halving in range(1, _HALVINGS):
            try:
                tried = problem.solve(start + (share + 0.5**halving) * way, way / np.linalg.norm(way))
            except (NumericalFailure, np.linalg.LinAlgError):  # as where the map has no derivative
                continue
            if _condition(tried, loss) * sign > 0.0:
                motion, share = tried, share + 0.5**halving
        near = factors(motion.multipliers)[loss]
        if np.abs(near).min() > _ZERO:  # the condition jumps
            touch = _touch(integration, after, ranges) or _touch(integration, motion, ranges)
            return [Bifurcation(Loss.GRAZING, touch or motion, ends)] if ends or touch else []
        values = [getattr(each.conditions, next(iter(ranges))) for each in (before, motion, after)]
        name = Loss.BRANCHING if loss is Loss.FOLD and values[1] not in (min(values), max(values)) else loss
        on_circle = motion.multipliers[np.abs(np.abs(motion.multipliers) - 1.0) < _ZERO]
        if loss is not Loss.BEATING or on_circle.imag.any():  # else two real ones whose product passes 1
            found.append((share, name, motion))
    found.sort(key=lambda each: each[0])
    return [Bifurcation(name, motion, ends and place == 0) for place, (_, name, motion) in enumerate(found)]


def _touch(integration: Integration, motion: PeriodicMotion, ranges: _Ranges) -> PeriodicMotion | None:
    """Return the motion near another one of a branch in which the grain just touches a wall once more."""
    try:
        problem = _Problem(integration, motion, ranges, Loss.GRAZING)
        here = problem.point(motion)
        found = problem.solve(here)
        return found if np.abs(problem.point(found) - here).max() <= 2.0 * _LARGEST else None
    except (NumericalFailure, np.linalg.LinAlgError):
        return None
