# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The four-parameter sine fit of IEEE 1057, with covariance, made to stand what real signals do.

Spikes are left out, offset drift, harmonics and mains hum join the model where they are significant, and a tone
that changes inside the window is distinguished from a steady one. Each decision compares the sums of squares of two
models (a likelihood ratio), so the plain four parameters are what remains for a tone in white noise.
"""

from dataclasses import dataclass

import numpy as np

from atpid_control.identification import columns as col
from atpid_control.identification.choice import HARMONICS_FROM, Flags, best_group, chosen_columns, without_spikes
from atpid_control.identification.choice import foreign_residual as foreign
from atpid_control.identification.covariance import CHANGE, FOREIGN, OK, RESULTS, USED, WIDENED, follow_drift, report
from atpid_control.identification.linear import compiled, least_squares
from atpid_sim.system import Array

#: Gauss-Newton steps; three do, from the seed.
_STEPS = 12
#: A step this small [rad over half the window] leaves the next one at rounding: convergence is quadratic.
_CONVERGED = 1e-6
#: Refits after spikes were found or a group joined, and how many of them may be for spikes.
_ROUNDS, _SPIKE_ROUNDS = 10, 6


@dataclass(frozen=True)
class SineFit:
    """A tone in a window: u = offset + amplitude sin(omega tau + phase) with tau = 0 at the window's end."""

    amplitude: float  # [m]
    amplitude_std: float  # [m]
    omega: float  # [rad/s]
    omega_std: float  # [rad/s]
    phase: float  # at the window's end [rad]
    phase_std: float  # [rad]
    offset: float  # [m]
    residual: float  # root mean square, degrees of freedom accounted for [m]
    harmonics: float  # [-]
    slope: float  # relative change of amplitude over half the window [-]
    slope_std: float  # [-]
    used: int
    change: float  # log-likelihood by which a changing tone describes the window better; 0: steady, or drifting slowly
    drift: float  # relative rate of a frequency that drifts slowly [1/s]; 0: steady
    widened: float  # largest factor by which noise that is not white lengthens an error bar [-]; 1: white
    foreign: float  # residual of what describes the window better than a tone, inf: nothing does [m]


#: Fields of a fit in the order the kernel writes them.
_VALUES, _REST = tuple(SineFit.__dataclass_fields__)[: USED - 1], tuple(SineFit.__dataclass_fields__)[USED:]


def fit_sine(
    tau: Array, signal: Array, omega: float, hum: float, threshold: float, slow: float = 0.0
) -> SineFit | None:
    """Fit a tone to `signal` (n,) [m] at `tau` (n,) [s], tau = 0 at the window's end, from the seed `omega` [rad/s].

    `hum` [rad/s] is the angular frequency of the mains, 0 for none; `threshold` is the log-likelihood from which a
    change is accepted; `slow` [1/s] is the relative rate up to which a drift of the frequency is none. No NaN may be
    among the samples. None is returned where no tone can be fitted.
    """
    if tau.size < 10:
        return None
    # one after the other from here: compiled as one they take a third longer to compile
    out, active = np.zeros(RESULTS), np.zeros(len(col.GROUPS), dtype=np.bool_)
    scale = 0.5 * float(tau[-1] - tau[0])
    centre = float(tau[0]) + scale
    columns, t, y, tone, best, out[CHANGE] = _model(tau - centre, signal, omega, hum, scale, -centre, threshold, active)
    if tone[0] == 0.0:
        return None
    report(out, columns, y, tone, scale, centre, active)
    short = tone[1] * scale < np.pi * HARMONICS_FROM
    if out[WIDENED] > 1.0 or active.any() or out[CHANGE] > 0.0 or short:
        out[FOREIGN] = min(out[FOREIGN], foreign(columns, t, y, tone, scale, active, out[CHANGE]))
    follow_drift(out, columns, t, y, tone, (hum, scale), active, (slow, threshold), best)
    if out[OK] == 0.0 or not np.all(np.isfinite(out[:FOREIGN])):
        return None
    values = {name: float(value) for name, value in zip(_VALUES, out[1:USED], strict=True)}
    rest = {name: float(value) for name, value in zip(_REST, out[CHANGE:], strict=True)}
    return SineFit(**values, used=int(out[USED]), **rest)


@compiled
def _model(
    every: Array, signal: Array, omega: float, hum: float, scale: float, end: float, threshold: float, active: Flags
) -> tuple[Array, Array, Array, Array, int, float]:
    """Return columns, instants `t` and signal `y` without spikes, tone, and which group changes it, by what likelihood.

    every: instants of the `signal` (n,) from its centre [s]; the steady groups that join are entered into `active`.
    """
    count = every.size
    keep, rejecting = np.ones(count, dtype=np.bool_), True
    columns, t, y = np.zeros((col.COUNT, count)), every, signal.copy()
    best, change = -1, 0.0
    for turn in range(_ROUNDS):
        tone = _converge(columns, t, y, omega, hum, scale, active)
        if tone[0] == 0.0:
            break
        omega = tone[1]
        if rejecting and turn < _SPIKE_ROUNDS:
            whole = columns if t.size == count else _steady_columns(every, tone, hum, scale)
            fresh, rejecting = without_spikes(whole, signal, tone, scale, active, keep)
            if not rejecting:
                fresh = np.ones(count, dtype=np.bool_)
            if not np.array_equal(fresh, keep):
                keep = fresh
                t, y = every[keep], signal[keep]
                columns = np.zeros((col.COUNT, t.size))
                continue
        best, gain = best_group(columns, t, y, tone, hum, scale, end, active)
        if best < 0 or (best >= col.STEADY_GROUPS and gain < threshold):
            break
        if best >= col.STEADY_GROUPS:
            change = gain
            break
        active[best] = True
        active[col.CURVED] = active[0] and omega * scale >= np.pi * HARMONICS_FROM
    return columns, t, y, tone, best, change


@compiled
def _steady_columns(t: Array, tone: Array, hum: float, scale: float) -> Array:
    """Return the columns (p, n) with those of a steady tone written."""
    columns = np.zeros((col.COUNT, t.size))
    col.write_constant(columns, t, hum, scale)
    col.write_tone(columns, t, tone[1], tone[2], tone[3], scale)
    col.write_harmonics(columns)
    return columns


@compiled
def _converge(columns: Array, t: Array, y: Array, omega: float, hum: float, scale: float, active: Flags) -> Array:
    """Gauss-Newton on the frequency, everything else solved for exactly; return ok, omega, then the coefficients."""
    chosen = chosen_columns(active)
    tone, solution = np.zeros(2 + col.COUNT), np.zeros(0)
    col.write_constant(columns, t, hum, scale)
    cosine, sine, first = 0.0, 0.0, True
    for _ in range(_STEPS):
        col.write_tone(columns, t, omega, cosine, sine, scale)
        if active[1]:
            col.write_harmonics(columns)
        used = chosen[chosen != col.PHASE_RATE] if first else chosen
        independent, solution, _ = least_squares(columns, used, y)
        if not independent:
            return tone
        cosine, sine = solution[0], solution[1]
        if first:
            first = False
            continue
        amplitude = np.hypot(cosine, sine)
        step = solution[3] / (max(amplitude, 1e-300) * scale)
        limit = 1.0 / scale
        omega += min(max(step, -limit), limit)
        if not (omega * scale > 0.5 and np.isfinite(omega)):
            return tone
        if abs(step) * scale < _CONVERGED:
            break
    tone[0], tone[1] = 1.0, omega
    for k in range(chosen.size):
        tone[2 + chosen[k]] = solution[k]
    tone[2 + col.PHASE_RATE] = 0.0
    return tone
