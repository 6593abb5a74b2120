# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded acceleration as displacement, integrated twice above a corner frequency, with the drift that is left."""

import math
from dataclasses import replace

import numpy as np
from scipy.signal import periodogram
from scipy.signal.windows import tukey

from atpid_control.analysis.signals import AnalysisError, Signals, runs
from atpid_sim.system import Array

#: Unit of what is integrated, and of the result.
ACCELERATION, DISPLACEMENT = "m/s^2", "m"
#: Periods of the corner that are left out at both ends, and share of the motion up to which drift is accepted [-].
_ENDS, _DRIFT = 2.0, 0.2


def displacement_of(acceleration: Array, rate: float, corner: float) -> tuple[Array, float]:
    """Return the displacement (n,) of an acceleration (n,), NaN where it is not known, and its drift [m].

    Nothing is left below `corner` [Hz], all from twice that on, without a shift; between both the share rises evenly.
    The drift is the root mean square of what is below twice the corner: an excitation should be above, so that the
    sensor's noise is most of it. Raises AnalysisError: too short, or more drift than a fifth of the motion.
    """
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
        raise AnalysisError(f"--integrate {corner:g}: no part without a gap has {3.0 * _ENDS / corner:.3g} s; give a "
                            "longer part, or a higher corner")  # fmt: skip
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
        if units[place] == ACCELERATION:
            columns[place], drift = displacement_of(columns[place], signals.rate, corner)
            units[place] = DISPLACEMENT
            lines.append(f"{name}: integrated twice above {corner:g} Hz, whole from {2.0 * corner:g} Hz on; drift "
                         f"{drift:.2g} m root mean square")  # fmt: skip
    if not lines:
        raise AnalysisError(f"--integrate: given channels in {' and '.join(units)}; allowed: one in {ACCELERATION}")
    return replace(signals, excitation=columns[0], response=columns[1], units=(units[0], units[1])), lines
