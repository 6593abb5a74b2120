# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The modes of a recorded run by output error: the measured drive through several modes, laid through the beam.

Each mode is an oscillator of unit drive. How strongly it is driven, how it began and where it rests enter linearly and
are solved for (variable projection, Golub and Pereyra 1973), so that two numbers a mode are searched. Modes are added
one by one, each at the highest peak of what the others leave.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, decimate, lfilter, periodogram

from atpid_control.analysis.signals import Signals, runs
from atpid_control.analysis.spectra import averaged
from atpid_lab.beam.fit import LEAST, MOST, START, forced, free_columns
from atpid_lab.modes.structure import Mode, ModesError, Structure
from atpid_sim.modal import ModeSet, modes_of
from atpid_sim.system import Array

TAU = 2.0 * math.pi
#: Samples at most: of more every n-th is taken, after a low-pass; and the fewest a period of the fastest mode.
_MOST_SAMPLES, _A_PERIOD = 60_000, 5
#: Lines of the residual's spectrum that are averaged, of which the larger mean counts, since a resonance is narrow;
#: draws by which errors are carried through the grain's removal.
_LINES, _DRAWS = (5, 15), 400
#: Segments of the spectra in which peaks are looked for, and how far apart two modes are at least [-].
_SEGMENTS, _APART = 8, 0.05
#: A mode is determined where its frequency's standard deviation is below this share of it [-].
_KNOWN = 0.02
#: Share of the largest density from which a line is excited; coherence from which it may be a peak, whose resonance
#: leaks; coherence that noise never has, and share of the lines with it that a drive has [-].
_EXCITED, _COHERENT, _EXPLAINS, _EXPLAINED = 1e-3, 0.4, 0.85, 0.01


@dataclass(frozen=True)
class Fit:
    """Modes of a run, by rising frequency; their coefficients are of displacement by drive."""

    frequency: Array  # (k,) without damping [Hz]
    ratio: Array  # (k,) damping over critical [-]
    drive: Array  # (k,) of a support the part of its motion [-], of a force over the mode's mass [1/kg]; NaN: free
    covariance: Array  # (3 k, 3 k) of these one after the other; of a free motion (2 k, 2 k)
    residual: float  # root mean square of what is left [m]
    motion: float  # standard deviation of the beam [m]
    samples: int

    def deviations(self) -> Array:
        """Return the standard deviations (3, k) of frequency, ratio and drive."""
        found = np.full(3 * len(self.frequency), np.nan)
        found[: len(self.covariance)] = np.sqrt(np.diag(self.covariance))
        return found.reshape(3, -1)


def fit_modes(signals: Signals, count: int, force: bool) -> Fit:
    """Return `count` modes of a record whose longest part without a gap is taken; its drive is a force, or a support.

    Raises ModesError.
    """
    known = np.isfinite(signals.excitation).any()
    drive = signals.excitation if known else np.zeros(len(signals.response))
    begin, end = max(runs(np.isfinite(drive + signals.response)), key=lambda part: part[1] - part[0], default=(0, 0))
    if end - begin < 100 * count:
        raise ModesError(f"the longest part without a gap has {end - begin} samples; needed: {100 * count}")
    every = max(1, -(-(end - begin) // _MOST_SAMPLES))
    drive, beam = drive[begin:end], signals.response[begin:end]
    if every > 1:
        drive, beam = (np.asarray(decimate(one, every, ftype="fir")) for one in (drive, beam))
    model = _Model(drive, beam, every / signals.rate, force)
    model.driven = model.driven and model.explains()
    logarithms = np.empty(0)
    for number in range(count):
        top = 1.0 / (_A_PERIOD * model.step)
        shown = model.drive if model.driven else None
        peak = _peak(model.residual(logarithms), shown, 1.0 / model.step, np.exp(logarithms[:number]) / TAU, top)
        added = [math.log(TAU * peak)], logarithms[number:], [math.log(START)]
        logarithms = np.concatenate([logarithms[:number], *added])
        low, high = (np.log([edge] * (number + 1)) for edge in (LEAST, MOST))
        paces = logarithms[: number + 1]
        bounds = np.concatenate([paces - 0.3, low]), np.concatenate([paces + 0.3, high])
        inside = np.clip(logarithms, bounds[0] + 1e-9, bounds[1] - 1e-9)
        logarithms = least_squares(model.residual, inside, bounds=bounds, x_scale=0.01, xtol=1e-9, ftol=1e-9).x
    found = model.fit(logarithms)
    doubtful = ~(found.deviations()[0] < _KNOWN * found.frequency) | ~(found.deviations()[1] < 0.5 * found.ratio)
    doubtful[1:] |= np.diff(np.log(found.frequency)) < 0.5 * _APART  # one mode taken for two
    if doubtful.any():
        where = ", ".join(f"{f:.4g}" for f in found.frequency[doubtful])
        raise ModesError(f"--modes: given {count}; the record does not determine those at {where} Hz; give fewer")
    return found


def _peak(left: Array, drive: Array | None, rate: float, known: Array, top: float) -> float:
    """Return the frequency [Hz] of the highest peak of a residual, away from the modes known [Hz] and below `top` [Hz].

    Of its response to the drive where both are coherent, without a drive (None) of its density; over the level around.
    """
    if drive is None:
        frequency, density = periodogram(left - left.mean(), rate)
        height = density / _level(density)
    else:
        frequency, response, coherence = _response(drive, left, rate)
        height, excited = np.zeros(len(response)), response > 0.0
        height[excited] = response[excited] / _level(response[excited])
        height[coherence < _COHERENT] = 0.0
    height[(frequency < 2.0 * frequency[1]) | (frequency > top)] = 0.0
    for one in known:
        height[np.abs(frequency - one) < max(_APART * one, 3.0 * frequency[1])] = 0.0
    if not height.any():
        raise ModesError(f"the record shows {len(known)} modes; give fewer --modes, or a longer part")
    return float(frequency[int(np.argmax(height))])


def _level(values: Array) -> Array:
    """Return the median of the lines around each of (k,)."""
    return np.asarray(np.maximum(median_filter(values, max(9, len(values) // _SEGMENTS)), 1e-300))


def _response(drive: Array, beam: Array, rate: float) -> tuple[Array, Array, Array]:
    """Return frequencies (k,) [Hz], |H1| and coherence [-], both 0 where nothing excites."""
    found = averaged(drive, beam, rate, rate / (len(beam) // _SEGMENTS))
    excited = found.first > _EXCITED * found.first.max()
    own, cross = np.maximum(found.first, 1e-300), np.abs(found.cross)
    coherence = cross**2 / np.maximum(own * found.second, 1e-300)
    return found.frequency, np.where(excited, cross / own, 0.0), np.where(excited, coherence, 0.0)


class _Model:
    """The projected residual as a function of the logarithms of pace [rad/s] and damping ratio of each mode."""

    def __init__(self, drive: Array, beam: Array, step: float, force: bool) -> None:
        self.drive, self.beam, self.step, self.force = drive, beam, step, force
        self.driven = bool(np.ptp(drive) > 0.0)

    def explains(self) -> bool:
        """Whether the drive is more than its sensor's noise: the beam is coherent with it."""
        coherence = _response(self.drive, self.beam, 1.0 / self.step)[2]
        return bool(np.count_nonzero(coherence > _EXPLAINS) > _EXPLAINED * np.count_nonzero(coherence))

    def _parts(self, logarithms: Array) -> tuple[Array, Array]:
        """Return the columns (k, n) of the drive, and (2 k + 1, n) of the beginning and the rest."""
        count = len(logarithms) // 2
        paces, ratios = np.exp(logarithms[:count]), np.exp(logarithms[count:])
        driven, free = [], [np.ones((1, len(self.beam)))]
        for pace, ratio in zip(paces, ratios, strict=True):
            stiffness, damping = pace * pace, 2.0 * ratio * pace
            free.append(free_columns(len(self.beam), self.step, stiffness, damping)[:2])
            if not self.driven:
                continue
            if self.force:
                top, bottom, _ = cont2discrete(([1.0], [1.0, damping, stiffness]), self.step, "foh")
                driven.append(lfilter(top.ravel(), bottom, self.drive - self.drive[0]))
            else:
                driven.append(forced(self.drive, self.step, stiffness, damping))
        return np.reshape(driven, (len(driven), len(self.beam))), np.vstack(free)

    def residual(self, logarithms: Array) -> Array:
        """Return measured minus best modelled motion (n,) [m]."""
        columns = np.vstack(self._parts(logarithms))
        return np.asarray(self.beam - self._values(columns) @ columns)

    def _values(self, columns: Array) -> Array:
        """Return the coefficients of columns (p, n) by their normal equations, which is fast for long records."""
        gram = columns @ columns.T
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        values = np.linalg.lstsq(gram * np.outer(scale, scale), scale * (columns @ self.beam), rcond=1e-13)[0]
        return np.asarray(scale * values)

    def fit(self, logarithms: Array) -> Fit:
        """Return the modes at the searched numbers, with their covariance for a residual of any colour."""
        count = len(logarithms) // 2
        driven, free = self._parts(logarithms)
        columns = np.vstack([driven, free]).T
        values = self._values(columns.T)
        left = self.beam - columns @ values
        slopes = []
        for place in range(2 * count):
            shifted = [np.array(logarithms), np.array(logarithms)]
            for one, sign in zip(shifted, (1.0, -1.0), strict=True):
                one[place] += sign * 1e-6
            ahead, behind = (np.vstack(self._parts(one)).T @ values for one in shifted)
            slopes.append((ahead - behind) / 2e-6)
        full = np.column_stack([*slopes, columns])
        covariance = _sandwich(full / np.sqrt(np.sum(full**2, axis=0)), left)
        size = np.sqrt(np.sum(full**2, axis=0))
        covariance = covariance / np.outer(size, size)
        frequency, ratio = np.exp(logarithms[:count]) / TAU, np.exp(logarithms[count:])
        drive = values[:count] if self.driven else np.full(count, np.nan)
        kept = (3 if self.driven else 2) * count
        by = np.concatenate([frequency, ratio, np.ones(count)])[:kept]
        order = np.argsort(frequency)
        places = np.concatenate([order + shift * count for shift in range(kept // count)])
        covariance = (covariance[:kept, :kept] * np.outer(by, by))[np.ix_(places, places)]
        residual, motion = float(np.sqrt(np.mean(left**2))), float(np.std(self.beam))
        return Fit(frequency[order], ratio[order], drive[order], covariance, residual, motion, len(left))


def _sandwich(jacobian: Array, left: Array) -> Array:
    """Return the parameters' covariance where the residual (n,) has its own spectrum, jacobian (n, p).

    Ordinary least squares of a coloured residual: the residual's periodogram, averaged over neighbouring lines, is
    taken as its spectrum: what the sensors of the drive add is resonant.
    """
    samples, parameters = jacobian.shape
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    slopes = np.fft.rfft(jacobian, axis=0)
    density = np.abs(np.fft.rfft(left)) ** 2 / (samples - parameters)
    power = np.max([uniform_filter1d(density, lines, mode="nearest") for lines in _LINES], axis=0)
    twice = np.full(len(power), 2.0)
    twice[0] = 1.0
    middle = (np.conj(slopes).T @ (slopes * (power * twice)[:, None])).real / samples
    return np.asarray(inverse @ middle @ inverse)


def structure_of(fit: Fit, masses: Array | None, grain: float, force: bool) -> tuple[Structure, Array]:
    """Return the modes as a scene has them, without a grain [kg] that the closed damper held.

    Beside them the standard deviations (k, 4) of frequency, ratio, mass and drive factor. masses: of the modes as
    recorded (k,) [kg]; None: those that a force at the container shows. Raises ModesError.
    """
    count = len(fit.frequency)
    means = np.concatenate([fit.frequency, fit.ratio, fit.drive])
    draws = np.random.default_rng(0).multivariate_normal(means, fit.covariance, _DRAWS, method="svd")
    nominal = _without(fit, means, masses, grain, force)
    if masses is None:
        draws = draws[(draws[:, 2 * count :] > 0.0).all(axis=1)]
    spread = np.std([_without(fit, one, masses, grain, force) for one in draws], axis=0)
    modes = tuple(
        Mode(float(f), float(m), float(z), math.nan if force else float(by), float(by) if force else 1.0, math.nan)
        for f, z, m, by in nominal
    )
    notes = ("compliance: of these modes alone",)
    return Structure(modes, sum(1.0 / mode.stiffness for mode in modes), notes), spread


def _without(fit: Fit, values: Array, masses: Array | None, grain: float, force: bool) -> Array:
    """Return frequency, ratio, mass and drive (k, 4) of values (3 k,), without the grain [kg]. Raises ModesError."""
    frequency, ratio, drive = values.reshape(3, -1)
    if masses is None and not (drive > 0.0).all():
        worst = float(fit.frequency[int(np.argmin(drive))])
        raise ModesError(
            f"--masses: given none; the mode at {worst:.4g} Hz answers a force at the container backwards: the force "
            "acts elsewhere; give the modes' masses"
        )
    mass = np.asarray(1.0 / drive) if masses is None else masses
    pace = TAU * frequency
    stiffness, damping = mass * pace**2, 2.0 * ratio * mass * pace
    direct = drive * mass if force else drive * stiffness
    nothing = np.zeros(len(mass))
    if grain > 0.0:
        heavy = ModeSet(mass, stiffness, damping, direct, nothing, nothing)
        if not np.sum(1.0 / mass) * grain < 1.0:
            allowed = f"below {1.0 / np.sum(1.0 / mass):.4g} kg, what an impulse at the container meets"
            raise ModesError(f"--grain-mass: given {grain:g} kg; allowed: {allowed} in the recorded modes")
        mass, stiffness, damping, direct, *_ = modes_of(heavy, -grain, 0.0).joined
    pace = np.sqrt(stiffness / mass)
    factor = direct if force else direct / stiffness
    rows = np.column_stack([pace / TAU, 0.5 * damping / (mass * pace), mass, factor])
    return np.asarray(rows[np.argsort(pace)])
