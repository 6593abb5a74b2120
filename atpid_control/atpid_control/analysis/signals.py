# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two signals sampled together, NaN where a sample was lost, their parts without a gap, and their integrals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_control.runs.run import BEAM, Run
from atpid_sim.system import Array


class AnalysisError(InputError):
    """Signals that cannot be analysed as asked: what was given, what is needed, what to do."""


@dataclass(frozen=True)
class Signals:
    """What excites and what answers (n,), NaN where a sample was lost or is invalid."""

    rate: float  # [Hz]
    excitation: Array  # (n,) the support's displacement or the force, unless chosen otherwise
    response: Array  # (n,) the beam's
    units: tuple[str, str] = ("m", "m")
    names: tuple[str, str] = ("support_displacement", "beam_displacement")
    start: float = 0.0  # time of the first sample [s]
    origin: str = ""  # what measured them, such as `laser`; empty: not from a recording
    start_ns: int = 0  # stamp of the first sample
    delay: float = 0.0  # by which each sample of the response was taken after that of the excitation [s]
    clock_error: float = 0.0  # its standard deviation, of two devices, but for the least delays [s]; NaN: unknown

    @property
    def duration(self) -> float:
        """Length, gaps included [s]."""
        return len(self.response) / self.rate

    @property
    def time(self) -> Array:
        """Times of the samples (n,) [s]."""
        return self.start + np.arange(len(self.response)) / self.rate

    @property
    def invalid(self) -> int:
        """Samples of which one of the two is missing."""
        return int(np.count_nonzero(~np.isfinite(self.excitation + self.response)))

    def between(self, begin: float, end: float) -> Signals:
        """Return the part from `begin` to `end` [s]. Raises AnalysisError: no such part."""
        first = math.ceil((max(begin, self.start) - self.start) * self.rate - 1e-6)
        last = len(self.response) if math.isinf(end) else math.floor((end - self.start) * self.rate + 1e-6) + 1
        if not first < min(last, len(self.response)):
            until = self.start + self.duration
            allowed = f"rising times from {self.start:g} to {until:g} s"
            raise AnalysisError(f"--from {begin:g} --to {end:g}: allowed: {allowed}")
        excitation, response = self.excitation[first:last], self.response[first:last]
        return replace(self, excitation=excitation, response=response, start=self.start + first / self.rate)


def signals_of(run: Run, given: str = "", measured: str = BEAM, *, both: bool = True) -> tuple[Signals, list[str]]:
    """Return what sensors measured in a run, at the same instants, and what is missing, a line each.

    given: empty: what drives the structure. Raises BagError: no samples of `measured`, or where it has to be `both` of
    `given`; else NaN stands in its place.
    """
    given = given or run.drive.channel
    excitation, response = run.signals(given, measured) if both else run.driven(given, measured)
    units = excitation.unit, response.unit
    error = math.hypot(excitation.clock_error, response.clock_error)
    delay, values, names = response.skew - excitation.skew, (excitation.values, response.values), (given, measured)
    own = Signals(
        response.rate, *values, units, names, response.time0, response.origin, response.start_ns, delay, error
    )
    return own, [*run.missing, *response.others]


def runs(valid: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of the parts of booleans (n,) that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(valid, dtype=np.int8), [0]))))
    yield from ((int(begin), int(end)) for begin, end in edges.reshape(-1, 2))


#: Unit of what is integrated, and of the result.
_ACCELERATION, _DISPLACEMENT = "m/s^2", "m"
#: Periods of the corner that are left out at both ends, and share of the motion up to which drift is accepted [-].
_ENDS, _DRIFT = 2.0, 0.2


def displacement_of(acceleration: Array, rate: float, corner: float) -> tuple[Array, float]:
    """Return the displacement (n,) of an acceleration (n,), NaN where it is not known, and its drift [m].

    Nothing is left below `corner` [Hz], all from twice that on, without a shift; between both the share rises evenly.
    The drift is the root mean square of what is below twice the corner: an excitation should be above, so that the
    sensor's noise is most of it. Raises AnalysisError: too short, or more drift than a fifth of the motion.
    """
    from scipy.signal import periodogram  # here, since only accelerations need it, and it loads slowly
    from scipy.signal.windows import tukey

    found, drift, power, total = np.full(len(acceleration), np.nan), 0.0, 0.0, 0
    ends = math.ceil(_ENDS / corner * rate)
    for begin, end in runs(np.isfinite(acceleration)):
        if end - begin <= 3 * ends:
            continue
        part = acceleration[begin:end] - acceleration[begin:end].mean()
        part *= tukey(len(part), 2.0 * ends / len(part))  # an edge would be motion at any frequency
        frequency = np.fft.rfftfreq(len(part), 1.0 / rate)
        share = np.sin(0.5 * math.pi * np.clip(frequency / corner - 1.0, 0.0, 1.0)) ** 2
        lines = -share * np.fft.rfft(part) / (2.0 * math.pi * np.maximum(frequency, corner)) ** 2
        inside = slice(begin + ends, end - ends)
        found[inside] = np.fft.irfft(lines, len(part))[ends : len(part) - ends]
        lines, density = periodogram(found[inside], rate, "hann")
        used = end - begin - 2 * ends
        drift += used * float(density[lines < 2.0 * corner].sum() * lines[1])
        power, total = power + used * float(density.sum() * lines[1]), total + used
    if not total:
        what = f"no part without a gap has {3.0 * _ENDS / corner:.3g} s; give a longer part, or a higher corner"
        raise AnalysisError(f"--integrate {corner:g}: {what}")
    if drift > _DRIFT**2 * power:
        raise AnalysisError(
            f"--integrate {corner:g}: {math.sqrt(drift / max(power, 1e-300)):.0%} of the displacement is below "
            f"{2.0 * corner:g} Hz; allowed: {_DRIFT:.0%}; the excitation is too low in frequency for the noise, or the "
            "corner for it: give a higher one, at most half the lowest frequency of interest, or a laser's channel"
        )
    return found, math.sqrt(drift / total)


def integrated(signals: Signals, corner: float) -> tuple[Signals, list[str]]:
    """Return signals with their accelerations as displacements, and the drift of each, a line. Raises AnalysisError."""
    columns, units, lines = [signals.excitation, signals.response], list(signals.units), []
    for place, name in enumerate(signals.names):
        if units[place] == _ACCELERATION:
            columns[place], drift = displacement_of(columns[place], signals.rate, corner)
            units[place] = _DISPLACEMENT
            above = f"above {corner:g} Hz, whole from {2.0 * corner:g} Hz on"
            lines.append(f"{name}: integrated twice {above}; drift {drift:.2g} m root mean square")
    if not lines:
        raise AnalysisError(f"--integrate: given channels in {' and '.join(units)}; allowed: one in {_ACCELERATION}")
    return replace(signals, excitation=columns[0], response=columns[1], units=(units[0], units[1])), lines
