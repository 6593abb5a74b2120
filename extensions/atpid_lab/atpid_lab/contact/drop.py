# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ball that bounces on a fixed wall: its impacts from a table or a recorded pulse train, restitution and modulus.

A flight of time T begins and ends with g T / 2, so the restitution of the impact between two flights is the ratio of
their times. Air and rotation are left out: a dense ball that falls straight.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from atpid_control.analysis.signals import runs
from atpid_control.runs.signal import Signal
from atpid_lab.contact.estimate import FEWEST, ContactError, ContactEstimate, mean, pulse, stiffness
from atpid_sim.scene.series import read_columns
from atpid_sim.system import Array

#: Columns of a table of impacts; all but the first may be missing.
IMPACT, DURATION, DROP = "impact_time", "duration", "drop"
#: A contact of a pulse train stands out of the noise by so many standard deviations, of the largest by this share.
_STANDS_OUT, _SHARE = 6.0, 0.03
#: Samples a contact must have for its width to be measured.
_FEWEST_SAMPLES = 8


class Impacts(NamedTuple):
    """Impacts of one drop, or of several one after the other."""

    time: Array  # (n,) [s]
    drop: Array  # (n,) number of the drop
    duration: Array | None = None  # (n,) [s]
    width: Array | None = None  # (n,) [s] in place of the duration: standard deviation of the time, weighted by force


@dataclass(frozen=True)
class ContactFit:
    """What impacts determine, with 95 % intervals."""

    restitution: ContactEstimate
    speeds: tuple[float, float]  # of approach, lowest and highest [m/s]
    contact_time: ContactEstimate | None = None  # at the speed below [s]
    at_speed: float = math.nan  # geometric mean [m/s]
    modulus: ContactEstimate | None = None  # effective: 1/E = (1 - nu^2)/E of grain and of wall [Pa]
    damping_ratio: float = math.nan  # beta of Tsuji's law against a fixed wall
    missing: tuple[str, ...] = ()  # what is not determined, and why, a line each


def read_impacts(path: Path) -> Impacts:
    """Return the impacts of a table. Raises SceneError: no such table; ContactError: times that do not rise."""
    columns = read_columns(path, (IMPACT,), (DURATION, DROP))
    time, drop = columns[IMPACT], columns.get(DROP, np.zeros(len(columns[IMPACT])))
    duration = columns.get(DURATION)
    wrong = (drop[1:] == drop[:-1]) & ~(np.diff(time) > 0.0)
    if not np.all(np.isfinite(time)) or np.any(wrong):
        row = int(np.argmax(np.concatenate(([False], wrong)) | ~np.isfinite(time))) + 1
        raise ContactError(f"{path}: impact {row}: given {time[row - 1]:g} s; allowed: times that rise in each drop")
    if duration is not None and not np.all(duration > 0.0):
        row = int(np.argmax(~(duration > 0.0))) + 1
        raise ContactError(f"{path}: impact {row}: given a duration of {duration[row - 1]:g} s; allowed: above 0")
    return Impacts(time, drop, duration)


def impacts_of(signal: Signal) -> Impacts:
    """Return the impacts of a force or acceleration, each a pulse on a baseline. Raises ContactError: none, or cut."""
    values = signal.values - np.nanmedian(signal.values)
    values = values * np.sign(values[np.nanargmax(np.abs(values))])
    noise = 1.4826 * float(np.nanmedian(np.abs(values)))
    found = list(runs(values > max(_STANDS_OUT * noise, _SHARE * float(np.nanmax(values)))))
    joined: list[tuple[int, int]] = []
    for begin, end in found:
        if joined and begin - joined[-1][1] < joined[-1][1] - joined[-1][0]:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((begin, end))
    longest = max((end - begin for begin, end in joined), default=0)
    if longest < _FEWEST_SAMPLES:
        raise ContactError(
            f"{signal.name}: contacts of at most {longest} samples at {signal.rate:g} Hz; needed: "
            f"{_FEWEST_SAMPLES}; sample faster, or give a table of {IMPACT} (and {DURATION})"
        )
    shapes = [_shape(signal, values, begin, end) for begin, end in joined if end - begin >= _FEWEST_SAMPLES]
    time, width = np.array(shapes).T
    return Impacts(time, np.zeros(len(time)), width=width)


def _shape(signal: Signal, values: Array, begin: int, end: int) -> tuple[float, float]:
    """Return the centre and the standard deviation in time of a pulse [s]; half its length beside it belongs to it."""
    aside = (end - begin) // 2
    first, last = max(begin - aside, 0), min(end + aside, len(values))
    time, weight = signal.time[first:last], values[first:last]
    if not np.all(np.isfinite(weight)):
        raise ContactError(f"{signal.name}: samples are lost in the contact at {time[0]:g} s; choose a part without it")
    centre = float(time @ weight / weight.sum())
    return centre, math.sqrt(max(float((time - centre) ** 2 @ weight / weight.sum()), 0.0))


def fit_drop(impacts: Impacts, gravity: float, mass: float | None = None, radius: float | None = None) -> ContactFit:
    """Return what a drop test determines; without mass [kg] and radius [m] of the ball no modulus.

    Raises ContactError: too few impacts.
    """
    drops = [np.flatnonzero(impacts.drop == drop) for drop in dict.fromkeys(impacts.drop)]
    drops = [places for places in drops if len(places) >= 3]
    if sum(len(places) - 2 for places in drops) < FEWEST:
        raise ContactError(
            f"given {len(impacts.time)} impacts in {len(set(impacts.drop))} drop(s); needed: at least {FEWEST} that "
            "have a flight before and after them: one drop of 5 impacts, or several"
        )
    ratios, timing, speeds, touched = [], [], [], []
    for places in drops:
        flights = np.diff(impacts.time[places])
        if impacts.duration is not None:
            flights = flights - impacts.duration[places[:-1]]
        if not np.all(flights > 0.0):
            raise ContactError("duration: given contacts longer than the time to the next impact; allowed: shorter")
        for number, (before, after) in enumerate(pairwise(flights)):
            ratios.append(math.log(after / before))
            row = np.zeros(len(impacts.time))
            row[places[number : number + 3]] = 1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after
            timing.append(row)
            speeds.append(0.5 * gravity * before)
            touched.append(places[number + 1])
    restitution = mean(np.array(ratios), np.array(timing)).through(np.exp)
    beta = 0.5 * math.sqrt(5.0) * pulse(restitution.value).damping_ratio
    at_speed = float(np.exp(np.log(speeds).mean()))
    fit = ContactFit(restitution, (min(speeds), max(speeds)), at_speed=at_speed, damping_ratio=beta)
    measured, kind = (impacts.duration, "duration") if impacts.width is None else (impacts.width, "width")
    if measured is None:
        return replace(fit, missing=(f"contact time and modulus: no column {DURATION}",))
    time = mean(np.log(measured[touched]) + 0.2 * np.log(np.array(speeds) / at_speed)).through(np.exp)
    return with_modulus(fit, time, kind, mass, radius)


def with_modulus(
    fit: ContactFit, time: ContactEstimate, kind: str, mass: float | None, radius: float | None
) -> ContactFit:
    """Add contact time and modulus by the `duration`, `width` or `centre` of a pulse [s] at the fit's speed.

    mass: that the relative motion feels [kg]; radius of the ball [m].
    """
    # a stiffer damper shortens a contact: the restitution's own error is part of the modulus's
    e = fit.restitution
    ends = [pulse(min(max(one, 1e-3), 1.0)) for one in (e.value, e.low, e.high)]
    scaled = [getattr(end, kind) for end in ends]
    factor = ends[0].duration / scaled[0]
    time = ContactEstimate(time.value * factor, time.low * factor, time.high * factor, time.number)
    fit = replace(fit, contact_time=time)
    if mass is None or radius is None:
        return replace(fit, missing=("modulus: needs the ball's --mass and --radius",))
    moduli = [stiffness(mass, fit.at_speed, time.value, one * factor) * 0.75 / math.sqrt(radius) for one in scaled]
    spread = max(abs(math.log(one / moduli[0])) for one in moduli)
    low, high = (math.hypot(2.5 * math.log(end / time.value), spread) for end in (time.high, time.low))
    modulus = ContactEstimate(moduli[0], moduli[0] * math.exp(-low), moduli[0] * math.exp(high), time.number)
    return replace(fit, modulus=modulus)
