# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frequency and damping of a free decay with error bars, and the decrements from peak to peak (thesis, Eq. 2.1)."""

import math
from dataclasses import dataclass

import numpy as np

from atpid_control.analysis.signals import AnalysisError, runs
from atpid_sim.simulation.quantities import decrements
from atpid_sim.system import Array

#: The support is at rest within this share of the beam's reach [-].
_STILL = 0.01
#: Periods that a decay needs, and those below which its error bars are doubted.
_FEWEST, _FEW = 2.0, 4.0
#: Residual, over the first amplitude, above which a decay is not exponential [-].
_EXPONENTIAL = 0.02
#: Damping of the large and of the small swings, which the amplitude's fall to a third parts: difference from which it
#: depends on the amplitude, in standard deviations and relative [-].
_LARGE, _SIGMAS, _DEPENDS = math.log(3.0), 3.0, 0.03
#: Share of the amplitude from which a part begins at a peak [-].
_AT_PEAK = 0.98


@dataclass(frozen=True)
class Decay:
    """A decaying oscillation fitted by offset + amplitude exp(-zeta omega_0 t) cos(omega_d t + phase)."""

    begin: float  # of the part fitted [s]
    end: float  # [s]
    frequency: float  # damped natural frequency [Hz]
    frequency_std: float  # [Hz]
    damping_ratio: float  # zeta [-]
    damping_ratio_std: float  # [-]
    amplitude: float  # at the begin [m]
    residual: float  # root mean square [m]
    ratios: Array  # (k,) of successive upper peaks [-]
    doubts: tuple[str, ...]

    @property
    def log_decrement(self) -> float:
        """Logarithm of the ratio of successive peaks [-]."""
        return 2.0 * math.pi * self.damping_ratio / math.sqrt(1.0 - self.damping_ratio**2)

    @property
    def log_decrement_std(self) -> float:
        """Its standard deviation [-]."""
        return float(2.0 * math.pi * self.damping_ratio_std / (1.0 - self.damping_ratio**2) ** 1.5)


def find_decay(support: Array, beam: Array, rate: float) -> tuple[int, int] | None:
    """Return (begin, end) of the longest part in which the support (n,) is at rest and the beam (n,) decays.

    Begins at the beam's largest displacement there; None where there is none.
    """
    reach = float(np.nanmax(np.abs(beam - np.nanmedian(beam)))) if np.isfinite(beam).any() else 0.0
    if not reach > 0.0:
        return None
    known = np.isfinite(support)
    rest = float(np.median(support[known])) if known.any() else 0.0
    still = np.isfinite(beam) & (~known | (np.abs(support - rest) <= _STILL * reach))
    begin, end = max(runs(still), key=lambda part: part[1] - part[0], default=(0, 0))
    if end - begin < 16:
        return None
    part = beam[begin:end]
    moved = np.abs(part - np.median(part[len(part) // 2 :]))
    first = int(np.argmax(moved))
    # a beam that moves as much at the end as at the begin is held up by something else than its inertia
    if len(part) - first < 16 or float(moved[-(len(part) - first) // 8 :].max()) > 0.5 * float(moved[first]):
        return None
    return (begin + first, end) if float(moved[first]) > 0.1 * reach and rate > 0.0 else None


def free_decay(beam: Array, rate: float, start: float = 0.0) -> Decay:
    """Return the fit of a free decay (n,) [m], which begins at `start` [s]. Raises AnalysisError: too short.

    Error bars are standard deviations from the fit's covariance, for a residual with its own correlation.
    """
    if len(beam) < 16 or not np.isfinite(beam).all():
        raise AnalysisError("a decay needs 16 samples without a gap; choose the part with --from and --to")
    from scipy.optimize import curve_fit  # here, since a report without a decay does not need it, and it loads slowly

    time = np.arange(len(beam)) / rate
    guess = _guess(beam, rate)
    periods = guess[1] * time[-1] / (2.0 * math.pi)
    if periods < _FEWEST:
        needed = f"needed: {_FEWEST:g}; choose a part with --from, --to"
        raise AnalysisError(f"the decay lasts {periods:.2g} periods; {needed}")
    try:
        found, covariance = curve_fit(_model, time, beam, guess, maxfev=5000)
    except RuntimeError:
        raise AnalysisError("no decaying oscillation fits this part; choose the decay with --from and --to") from None
    rest = beam - _model(time, *found)
    sigma, omega, amplitude = float(found[0]), abs(float(found[1])), math.hypot(found[2], found[3])
    widening, residual = _correlation(rest), float(np.sqrt(np.mean(rest**2)))
    sigma_std, omega_std = (widening * math.sqrt(max(0.0, covariance[i, i])) for i in (0, 1))
    natural = math.hypot(sigma, omega)
    damping_std = math.hypot(omega**2 * sigma_std, sigma * omega * omega_std) / natural**3
    span, tone = (start, start + float(time[-1])), (omega / (2.0 * math.pi), omega_std / (2.0 * math.pi))
    ratios = _ratios_of(beam - float(found[4]), amplitude)
    doubts = (*_doubts(periods, sigma, sigma_std, residual, amplitude), *_not_viscous(time, beam, found))
    return Decay(*span, *tone, sigma / natural, damping_std, amplitude, residual, ratios, doubts)


def _ratios_of(moved: Array, amplitude: float) -> Array:
    """Return the ratios of successive upper peaks (k,) [-] of a displacement from rest (n,) [m].

    Without the swings that the part cuts: the last, and the first where its peak, `amplitude` [m] in the fit, is before
    the part.
    """
    down = np.flatnonzero((moved[:-1] > 0.0) & (moved[1:] <= 0.0)) + 1
    if not len(down):
        return np.array([])
    first = int(down[0])
    cut = moved[0] > 0.0 and moved[0] >= moved[:first].max() and moved[0] < _AT_PEAK * amplitude
    return decrements(moved[first if cut else 0 : int(down[-1])])


def _model(time: Array, sigma: float, omega: float, cosine: float, sine: float, offset: float) -> Array:
    fall = np.exp(-np.clip(sigma * time, -50.0, 700.0))
    return np.asarray(offset + fall * (cosine * np.cos(omega * time) + sine * np.sin(omega * time)))


def _guess(beam: Array, rate: float) -> tuple[float, float, float, float, float]:
    """Return decay rate [1/s], frequency [rad/s], amplitudes of cosine and sine, offset [m] to begin with."""
    offset = float(beam[len(beam) // 2 :].mean())
    moved = beam - offset
    crossings = np.flatnonzero((moved[:-1] <= 0.0) & (moved[1:] > 0.0))
    large = crossings[: max(2, int(np.count_nonzero(np.abs(moved[crossings + 1]) > 0.0)))][:6]
    if len(large) < 2:
        raise AnalysisError("the decay has no two periods; choose the part with --from and --to")
    omega = 2.0 * math.pi * rate * (len(large) - 1) / float(large[-1] - large[0])
    ratios = decrements(moved)
    sigma = math.log(float(np.median(ratios))) * omega / (2.0 * math.pi) if len(ratios) else 0.02 * omega
    return max(sigma, 1e-3 * omega), omega, float(moved[0]), 0.0, offset


def _correlation(rest: Array) -> float:
    """Return the factor by which a residual's correlation widens error bars, from that of neighbouring samples."""
    power = float(np.dot(rest, rest))
    near = float(np.dot(rest[1:], rest[:-1])) / power if power > 0.0 else 0.0
    return math.sqrt((1.0 + max(0.0, near)) / (1.0 - min(max(0.0, near), 0.999)))


def _not_viscous(time: Array, beam: Array, found: Array) -> list[str]:
    """Return that large and small swings of a decay (n,) [m] are damped differently, as by friction, where they are.

    `found`: the fit of the whole.
    """
    from scipy.optimize import curve_fit

    sigma, omega, cosine, sine, offset = (float(value) for value in found)
    at = int(np.searchsorted(time, min(0.5 * time[-1], _LARGE / sigma if sigma > 0.0 else math.inf)))
    ratios = []
    for part in (slice(0, at), slice(at, len(time))):
        own, turn = time[part] - time[part.start], omega * time[part.start]
        if own[-1:].sum() * omega < _FEWEST * 2.0 * math.pi:
            return []
        fall = math.exp(-sigma * time[part.start])
        along = fall * (cosine * math.cos(turn) + sine * math.sin(turn))
        start = sigma, omega, along, fall * (sine * math.cos(turn) - cosine * math.sin(turn)), offset
        try:
            fitted, covariance = curve_fit(_model, own, beam[part], start, maxfev=2000)
        except RuntimeError:  # a part that is all noise says nothing
            return []
        error = _correlation(beam[part] - _model(own, *fitted)) * math.sqrt(max(0.0, covariance[0, 0]))
        ratios.append((float(fitted[0] / omega), error / omega))
    (large, first), (small, second) = ratios
    if not abs(small - large) > max(_SIGMAS * math.hypot(first, second), _DEPENDS * abs(large)):
        return []
    swings = f"{large:.3g} of the large swings, {small:.3g} of the small ones, as by friction"
    return [f"damping depends on the amplitude: {swings}; the error bar holds for a constant one"]


def _doubts(periods: float, sigma: float, sigma_std: float, residual: float, amplitude: float) -> list[str]:
    lines = []
    if periods < _FEW:
        lines.append(f"the decay is short: {periods:.2g} periods; from {_FEW:g} on its error bars can be trusted")
    if residual > _EXPONENTIAL * amplitude:
        what = f"the residual is {100.0 * residual / amplitude:.2g} % of the amplitude, so damping depends on amplitude"
        lines.append(f"not an exponential decay: {what}; see the ratios of successive peaks")
    if not sigma > 2.0 * sigma_std:
        lines.append("the damping is not above twice its standard deviation")
    return lines
