# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Impacts in a recorded run of the damper: where pieces of the beam's free response cross.

Between two impacts the beam is a linear oscillator on a moving support: its displacement is the response to the
measured support and a free vibration of two unknowns. These are fitted to each piece alone; stiffness, damping and
rest position, which need not be known well, to all pieces together. Two pieces cross at the centroid of the force
between them, however long it lasts. A piece in which the grain sticks or hits unseen does not fit and is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import correlate, find_peaks
from scipy.stats import chi2

from atpid_control.analysis.signals import Signals
from atpid_lab.beam.fit import damped_frequency, forced
from atpid_lab.contact.estimate import ContactError
from atpid_sim.system import Array, System

#: Half the window in which a jump is looked for, and what is left out beside an impact, in periods of the beam.
_WINDOW, _GUARD = 1.0 / 20.0, 1.0 / 60.0
#: A jump stands out of the noise by so many standard deviations, and is at least this share of the largest.
_STANDS_OUT, _SHARE = 6.0, 0.01
#: Fewest samples of a piece.
_FEWEST_SAMPLES = 6
#: Noise is at least this share of the beam's motion: the interpolation of the support is no better.
_LEAST_NOISE = 1e-5
#: A piece fits where its sum of squares is not above what noise has once in 10 000, by this factor.
_ONCE, _SLACK = 1e-4, 1.7
#: An impact with a corner this much rounder than usual is several in a row.
_ROUNDER = 3.0
#: Relative standard deviations of stiffness and damping as the scene states them.
_KNOWN = np.array([0.003, 0.05])
#: Variance of these by that of white noise: the support's noise, which reaches the beam through resonance, is slow.
_COLOURED = 6.0

Indices = NDArray[np.intp]
_Times = NDArray[np.floating]
#: A part of the record: first sample, and the one after its last.
Part = tuple[int, int]


class Impact(NamedTuple):
    """The beam at impacts, (n,) each."""

    time: Array  # [s]
    beam: Array  # [m]
    before: Array  # its velocity [m/s]
    after: Array
    acceleration: Array  # of it, but for the force of the impact [m/s^2]


class Flights(NamedTuple):
    """Flights of the grain, n of them, each from one impact to the next."""

    begins: Impact
    ends: Impact
    number: Indices  # (n,) of the impact each begins with
    errors: Array  # (p, 10, n) what p independent errors of one standard deviation do to `begins` and `ends`
    impacts: int  # found in all


@dataclass(frozen=True)
class _Beam:
    """Beam without the grain, over its mass, and the record it is fitted to."""

    stiffness: float  # [1/s^2]
    damping: float  # [1/s]
    rest: float  # reading with spring and weight in balance [m]
    step: float  # [s]
    support: Array  # (n,) [m]
    measured: Array  # (n,) [m], NaN: lost
    noise: float  # of the beam [m]

    @cached_property
    def explained(self) -> CubicSpline:
        """What the support makes of it [m], over time [s]."""
        motion = forced(self.support, self.step, self.stiffness, self.damping) + self.rest
        return CubicSpline(self.step * np.arange(motion.size), motion)

    @cached_property
    def left(self) -> Array:
        """What it does not (n,) [m]."""
        return np.asarray(self.measured - self.explained(self.explained.x))

    def free(self, tau: _Times) -> Array:
        """Return displacement and velocity (2, 2, ...) of the free vibrations from displacement and velocity one."""
        half, omega = 0.5 * self.damping, damped_frequency(self.stiffness, self.damping)
        decay, cos, sin = np.exp(-half * tau), np.cos(omega * tau), np.sin(omega * tau) / omega
        slope = -self.stiffness * decay * sin, decay * (cos - half * sin)
        return np.array([(decay * (cos + half * sin), decay * sin), slope])

    def samples(self, periods: float) -> int:
        """Return how many samples a time in periods of the free vibration has."""
        return round(periods * 2.0 * math.pi / (damped_frequency(self.stiffness, self.damping) * self.step))

    def fitted(self, part: Part) -> tuple[Array, Array, Array]:
        """Return residual (m,) over noise, start (2,) of the free vibration and the root (2, 2) of its covariance."""
        target = self.left[slice(*part)]
        valid = np.isfinite(target)
        columns = self.free(self.step * np.flatnonzero(valid))[0].T
        orthogonal, triangle = np.linalg.qr(columns)
        inverse = np.linalg.inv(triangle)
        start = inverse @ (orthogonal.T @ target[valid])
        return (target[valid] - columns @ start) / self.noise, start, inverse * self.noise

    def valid(self, part: Part) -> int:
        """Return how many samples of a part are there."""
        return int(np.isfinite(self.left[slice(max(part[0], 0), max(part[1], 0))]).sum())

    def fits(self, part: Part) -> bool:
        """Whether a part is in free vibration."""
        if self.valid(part) < _FEWEST_SAMPLES:
            return False
        off = self.fitted(part)[0]
        return bool(off @ off < _SLACK * chi2.isf(_ONCE, off.size - 2))


def flights_of(signals: Signals, system: System) -> Flights:
    """Return the flights in a part of a recording. Raises ContactError: none, or a beam that does not vibrate."""
    given = system.stiffness / system.beam_mass, system.damping / system.beam_mass
    if math.isnan(damped_frequency(*given)):
        raise ContactError("beam: given an overdamped one; allowed: one that vibrates freely between impacts")
    measured, valid = signals.response, np.isfinite(signals.excitation)
    if not valid.any() or np.isfinite(measured).sum() < 10 * _FEWEST_SAMPLES:
        raise ContactError(f"needed: {signals.names[0]} and {signals.names[1]}, sampled together")
    places = np.arange(measured.size)
    support = np.interp(places, places[valid], signals.excitation[valid])
    noise = 1.4826 * float(np.nanmedian(np.abs(np.diff(measured, 3)))) / math.sqrt(20.0)
    noise = max(noise, _LEAST_NOISE * float(np.nanstd(measured)))
    if noise == 0.0:
        raise ContactError(f"{signals.names[1]}: given one that does not move; needed: a run with impacts")
    beam = _Beam(*given, 0.0, 1.0 / signals.rate, support, measured, noise)
    beam = replace(beam, rest=float(np.nanmean(beam.left)))
    jumps = _jumps(beam)
    guard = beam.samples(_GUARD) + 1
    between = [(begin + guard, end - guard) for begin, end in pairwise((-guard, *jumps, measured.size + guard))]
    beam, root = _calibrated(beam, [part for part in between if beam.valid(part) >= 2 * _FEWEST_SAMPLES])
    after = [_longest(beam, part, at_end=False) for part in between]
    before = [_longest(beam, part, at_end=True) for part in between]
    known = [k for k in range(len(jumps)) if before[k] is not None and after[k + 1] is not None]
    pieces = [(left, right) for left, right in zip(before, after[1:], strict=False) if left and right]
    if not pieces:
        raise ContactError(f"given {len(jumps)} impacts, none between two parts in which the beam vibrates freely")
    crossings, errors = _crossings(beam, root, jumps[known], pieces)
    single = _single(beam, crossings, pieces) & (np.abs(crossings[0] - beam.step * jumps[known]) <= guard * beam.step)
    first = [
        i
        for i, (k, n) in enumerate(pairwise(known))
        if n == k + 1 and before[n] == after[n] == between[n] and single[i] and single[i + 1]
    ]
    number = np.array(first, dtype=np.intp)
    crossings[0] += signals.start
    both = np.concatenate([errors[:, :, number], errors[:, :, number + 1]], axis=1)
    return Flights(Impact(*crossings[:, number]), Impact(*crossings[:, number + 1]), number, both, len(jumps))


def _jumps(beam: _Beam) -> Indices:
    """Return where the beam's velocity jumps: the samples nearest to it."""
    half = max(_FEWEST_SAMPLES, beam.samples(_WINDOW))
    tau = beam.step * np.arange(-half, half + 1)
    free = beam.free(tau)[0]
    weights = np.linalg.pinv(np.array([*free, np.ones_like(tau), np.where(tau > 0.0, free[1], 0.0)]).T)[-1]
    valid = np.isfinite(beam.left)
    places = np.arange(valid.size)
    jump = np.abs(correlate(np.interp(places, places[valid], beam.left[valid]), weights, "same"))
    jump[:half] = jump[-half:] = 0.0
    least = max(_STANDS_OUT * beam.noise * float(np.linalg.norm(weights)), _SHARE * float(jump.max()))
    return np.asarray(find_peaks(jump, height=least, distance=half)[0])


def _calibrated(beam: _Beam, parts: list[Part]) -> tuple[_Beam, Array]:
    """Return the beam by the parts in free vibration, and the root (3, 3) of the covariance of its parameters."""
    if not parts:
        raise ContactError("no part of the recording without an impact is long enough to show the beam's own motion")

    def residual(moved: Array, parts: list[Part]) -> Array:
        other = _moved(beam, moved)
        return np.concatenate([moved[:2] / _KNOWN, *(other.fitted(part)[0] for part in parts)])

    bounds, scales = ([-0.1, -1.0, -np.inf], [0.1, 1.0, np.inf]), [1e-4, 1e-2, 1.0]
    solve = partial(least_squares, x_scale=scales, loss="cauchy", f_scale=3.0, bounds=bounds)
    moved, best = np.zeros(3), parts
    for _ in range(4):
        found = solve(residual, moved, args=(best,))
        moved = found.x
        square = np.array([np.mean(_moved(beam, moved).fitted(part)[0] ** 2) for part in parts])
        limit = max(_SLACK, 2.0 * float(np.quantile(square, 0.1)))
        best = [part for part, its in zip(parts, square, strict=True) if its <= limit]
    scale = _COLOURED * max(1.0, 2.0 * found.cost / found.fun.size)
    return _moved(beam, moved), np.linalg.cholesky(scale * np.linalg.inv(found.jac.T @ found.jac))


def _moved(beam: _Beam, moved: Array) -> _Beam:
    """Return the beam with other logarithms of stiffness and damping, and rest in standard deviations of the noise."""
    stiffness, damping = beam.stiffness * math.exp(moved[0]), beam.damping * math.exp(moved[1])
    return replace(beam, stiffness=stiffness, damping=damping, rest=beam.rest + beam.noise * float(moved[2]))


def _states(beam: _Beam, at: _Times, begins: tuple[Array, Array], starts: tuple[Array, Array]) -> Array:
    """Return the rows of `Impact` (5, m), near the times `at`, of pieces before and after that begin at times (m,)
    with the vibrations (m, 2)."""
    for _ in range(8):
        (before, slope), (after, other) = (
            np.einsum("ijm,mj->im", beam.free(at - begin), start) for begin, start in zip(begins, starts, strict=True)
        )
        at = at - (after - before) / (other - slope)
    speed = beam.explained(at, 1)
    braked = beam.stiffness * before + 0.5 * beam.damping * (slope + other)
    acceleration = beam.explained(at, 2) - braked
    return np.array([at, beam.explained(at) + before, speed + slope, speed + other, acceleration])


def _crossings(beam: _Beam, root: Array, jumps: Indices, pieces: list[tuple[Part, Part]]) -> tuple[Array, Array]:
    """Return impacts (5, m) between pairs of pieces, and what independent errors do to them (p, 5, m)."""
    parts = list(dict.fromkeys(part for pair in pieces for part in pair))
    sides = tuple(np.array([parts.index(pair[side]) for pair in pieces], dtype=np.intp) for side in (0, 1))
    begins = beam.step * np.array([part[0] for part in parts])

    def states(other: _Beam, shift: tuple[Array | float, Array | float] = (0.0, 0.0)) -> Array:
        starts = np.array([other.fitted(part)[1] for part in parts])
        before, after = (starts[side] + by for side, by in zip(sides, shift, strict=True))
        return _states(other, beam.step * jumps, (begins[sides[0]], begins[sides[1]]), (before, after))

    roots = np.array([beam.fitted(part)[2] for part in parts])
    impacts = states(beam)
    errors = np.zeros((2 * len(parts) + 3, 5, len(pieces)))
    each = np.arange(len(pieces))
    for column in range(2):
        errors[2 * sides[0] + column, :, each] += (states(beam, (roots[sides[0], :, column], 0.0)) - impacts).T
        errors[2 * sides[1] + column, :, each] += (states(beam, (0.0, roots[sides[1], :, column])) - impacts).T
    for column in range(3):
        errors[column - 3] = states(_moved(beam, root[:, column])) - impacts
    return impacts, errors


def _single(beam: _Beam, impacts: Array, pieces: list[tuple[Part, Part]]) -> NDArray[np.bool_]:
    """Return which impacts (m,) are one alone, by how the measured corner is rounded against those of the others.

    The area between it and the two pieces is half the jump times the square of the force's standard deviation in time.
    """
    square, error = np.zeros((2, len(pieces)))
    for i, (before, after) in enumerate(pieces):
        places, earlier = np.arange(before[1], after[0]), (np.arange(before[1], after[0]) * beam.step < impacts[0, i])
        off = beam.left[places]
        for part, chosen in ((before, earlier), (after, ~earlier)):
            off[chosen] -= beam.fitted(part)[1] @ beam.free(beam.step * (places[chosen] - part[0]))[0]
        jump = impacts[3, i] - impacts[2, i]
        square[i] = 2.0 * beam.step * np.nansum(off) / jump
        error[i] = 2.0 * beam.step * beam.noise * math.sqrt(places.size) / abs(jump)
    usual = max(float(np.quantile(square, 0.25)), 0.0)
    return np.asarray(np.abs(square) < _ROUNDER * usual + (0.5 * beam.step) ** 2 + _STANDS_OUT * error)


def _longest(beam: _Beam, part: Part, *, at_end: bool) -> Part | None:
    """Return the longest of the whole, half, quarter of a part, at its end or its start, that fits; None does."""
    begin, end = part
    while end - begin >= _FEWEST_SAMPLES:
        if beam.fits((begin, end)):
            return begin, end
        middle = (begin + end) // 2
        begin, end = (middle, end) if at_end else (begin, middle)
    return None
