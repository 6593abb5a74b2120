# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One channel of a recording on the time base of its stamps, and channels of several devices sampled anew together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from atpid_sim.results import Shown
from atpid_sim.system import Array

#: Stamps that are off start + index / rate by no more are of one clock with them [s].
_EXACT = 3e-9
#: Seconds whose stamps make a clock's course; periods of its changes that are followed; the first seconds count less;
#: those of which a device's node made a stamp, in a shorter record fewer [s].
_FEWEST, _SLOWEST, _SETTLED, _WINDOW = 5, 300.0, 30, 120
#: How far most stamps may leave their course, and the drift of a crystal: what goes beyond is a faulty clock [s, -].
_STEP, _MOST, _CRYSTAL = 5e-3, 0.8, 2e-4
#: Fits of the course, and medians of what is left from which a second counts half.
_TURNS, _WIDE = 6, 5.0
#: Samples of the slowest channel on both sides from which a value is interpolated, and how finely it is before.
_REACH, _FINE = 32, 4


@dataclass(frozen=True)
class StreamClock:
    """When the samples of a stream were taken, by their index: on the host's clock, which its stamps follow."""

    rate: float  # mean over the record [Hz]
    drift: float = 0.0  # by which the device's clock is slower than the host's [-]
    error: float = 0.0  # standard deviation of the times, but for the least delay of the transport [s]; NaN: unknown
    stated: float = math.nan  # rate that the messages state [Hz]; NaN: `rate`
    course: tuple[Array, Array] | None = None  # time by the stated rate after the first sample, and lateness (k,) [s]

    @property
    def late(self) -> float:
        """How much later than its stamp the first sample was taken [s]."""
        return 0.0 if self.course is None else float(np.interp(0.0, *self.course))

    def times(self, place: Array) -> Array:
        """Return when samples were taken, after the first one's stamp [s]; `place`: after the first, in samples."""
        if self.course is None:
            return np.asarray(place / self.rate)
        elapsed = np.asarray(place / self.stated)
        return elapsed + np.interp(elapsed, *self.course)

    def places(self, times: Array) -> Array:
        """Return the inverse of `times`."""
        found = np.asarray(times * self.rate)
        for _ in range(3 if self.course is not None else 0):
            found = found + (times - self.times(found)) * self.rate
        return found


def clock_of(index: NDArray[np.int64], stamp: NDArray[np.int64], rate: float) -> StreamClock:
    """Return the clock of samples with these indices and stamps (n,) [ns], `rate` as their messages state it [Hz].

    Stamps made while a stream runs use what was known by then; a smoothing spline through all of them, in which the
    first count less, is better. Stamps that no crystal explains are left out of account: the error is then NaN.
    """
    elapsed = (index - index[0]) / rate
    late = (stamp - stamp[0]) * 1e-9 - elapsed
    if np.ptp(late) <= _EXACT:
        return StreamClock(rate)
    from scipy.interpolate import make_smoothing_spline  # here, since stamps of one clock do not need it

    seconds = np.flatnonzero(np.diff(np.floor(elapsed), prepend=-1.0))
    at, middle = (np.add.reduceat(one, seconds) / np.diff(np.append(seconds, len(late))) for one in (elapsed, late))
    if len(at) < _FEWEST:
        return StreamClock(rate, error=float(np.ptp(late)))
    weight = np.minimum(1.0, (np.arange(1, len(at) + 1) / min(_SETTLED, len(at))) ** 2)
    course, trust = middle, weight
    for _ in range(_TURNS):  # what lies off the course counts less, as under a Cauchy distribution
        course = make_smoothing_spline(at, middle, trust, lam=(_SLOWEST / (2.0 * math.pi)) ** 4)(at)
        left = np.abs(middle - course)
        settled = float(np.median(left[weight >= 0.5]))
        trust = np.maximum(weight / (1.0 + (left / max(_WIDE * settled, _EXACT)) ** 2), 1e-9)
    drift = float((course[-1] - course[0]) / (at[-1] - at[0]))
    if abs(drift) > _CRYSTAL or np.quantile(left[weight >= 0.5], _MOST) > _STEP:
        return StreamClock(rate, error=math.nan)
    ends = np.array([elapsed[0] - 1.0, *at[1:-1], elapsed[-1] + 1.0])  # the spline's ends are straight
    slopes = np.diff(course[[0, 1, -2, -1]])[[0, 2]] / np.diff(at[[0, 1, -2, -1]])[[0, 2]]
    course[[0, -1]] += slopes * (ends[[0, -1]] - at[[0, -1]])
    error = settled / 0.6745 * math.sqrt(1.0 + _WINDOW / len(at))
    return StreamClock(rate / (1.0 + drift), drift, error, rate, (ends, course))


@dataclass(frozen=True, repr=False)
class Signal(Shown):
    """One channel, evenly sampled: index by index from its first sample on."""

    name: str
    time0: float  # time of the first sample, after the run's first [s]
    start_ns: int  # its stamp
    rate: float  # [Hz], by the host's clock where the stamps follow it
    values: Array  # (n,) NaN where a sample was lost or is invalid
    unit: str
    origin: str  # `laser`, `accelerometer`: a sensor; `truth`: the simulated plant; `table`: a .csv
    topic: str = ""
    lost: int = 0  # samples, by index
    others: tuple[str, ...] = ()  # streams that have the channel too and are not used, a line each
    skew: float = 0.0  # delay of its sampling instants after `time` [s]
    clock: StreamClock = field(default_factory=lambda: StreamClock(1.0), repr=False)
    clock_error: float = 0.0  # standard deviation of its times against those it was joined with [s]

    @property
    def time(self) -> Array:
        """Times of the samples (n,) after the run's first [s]."""
        return self.time0 + np.arange(len(self.values)) / self.rate


@dataclass(frozen=True, repr=False)
class RecordedMotion(Shown):
    """Displacements sampled together."""

    origin: str
    rate: float  # [Hz]
    time: Array  # (n,) after the run's first sample [s]
    support: Array  # (n,) [m], of a force that drives instead [N]; NaN where not measured, or lost
    beam: Array  # (n,) [m]
    grain: Array  # (n,) [m]; NaN where unknown
    ceiling: Array  # (n,) height [m]; NaN where unknown


def joined(signals: Sequence[Signal]) -> tuple[Signal, ...]:
    """Return channels of several streams at the instants of the slowest one; skews are taken off.

    Good up to 0.4 of its rate; NaN where one has no sample within 32 of the slowest one's.
    """
    slowest = min(signals, key=lambda one: one.rate)
    start, count = slowest.time0 - slowest.clock.late, len(slowest.values)
    times = start + slowest.clock.times(np.arange(float(count))) + slowest.skew
    made = []
    for one in signals:
        values = one.values
        if one.topic != slowest.topic or one.skew != slowest.skew:
            places = one.clock.places(times - one.skew - (one.time0 - one.clock.late))
            values = interpolated(values, places, one.rate / slowest.rate)
        apart = 0.0 if one.topic == slowest.topic else math.hypot(one.clock.error, slowest.clock.error)
        origin = slowest.origin if one is slowest else f"{one.origin} at the instants of {slowest.origin}"
        own = replace(slowest, name=one.name, unit=one.unit, lost=one.lost, others=one.others)
        made.append(replace(own, values=values, origin=origin, clock_error=apart))
    return tuple(made)


def interpolated(values: Array, places: Array, ratio: float) -> Array:
    """Return a signal (n,) at `places` (m,) between its samples, band-limited; NaN near what is missing.

    ratio: its rate over that of the places. What lies below 0.43 of the lower rate stays, what lies above 0.53 goes.
    """
    from scipy.ndimage import map_coordinates, uniform_filter1d  # here, since channels of one device do not need it
    from scipy.signal import firwin, resample_poly

    step = Fraction(_FINE / ratio).limit_denominator(64)
    up, down = step.numerator, step.denominator
    slower = max(1.0, ratio)
    reach = round(_REACH * up * slower)
    shape = firwin(2 * reach + 1, 0.96 / (up * slower), window=("kaiser", 9.0))
    missing = ~np.isfinite(values)
    mean = float(np.mean(values[~missing])) if not missing.all() else 0.0
    fine = resample_poly(np.where(missing, 0.0, values - mean), up, down, window=shape)
    made = map_coordinates(fine, [places * (up / down)], order=5, mode="nearest") + mean
    width = 2 * math.ceil(reach / up) + 1
    spoiled = uniform_filter1d(missing.astype(np.float64), width, mode="constant", cval=1.0) > 0.5 / width
    near = np.clip(np.rint(places), 0, len(values) - 1).astype(np.intp)
    outside = (places < 0.0) | (places > len(values) - 1)
    return np.asarray(np.where(outside | spoiled[near], np.nan, made))
