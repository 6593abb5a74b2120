# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A harmonic run behind a path of the ceiling, in one kernel: settled, watched, and ended as soon as the answer is due.

The time to settle is passed in rounds of two periods, in which motions of period one and two repeat themselves. Once
the states at the ends of rounds draw together regularly, what is left of the way is known; a run that has settled
above a limit, or that grows again there, has exceeded it (docs/decisions/0014-maps-and-selection.md).
"""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.modes import distances
from atpid_sim.engine.row_loop import integrate
from atpid_sim.kernel import kernel

#: Periods of a round.
ROUND = 2.0
#: Verdicts of a run.
WATCHED, SETTLED, EXCEEDED = range(3)
#: Factor by which distances of rounds have to shrink at least to count as drawing together.
_SHRINKING = 0.95
#: Rounds from which on a run may have exceeded its limit.
_LEAST = 5
#: Growth of the amplitude, relative, from which on it is no transient that fades.
_GROWN = 1.05
#: Part of the way left, as extrapolated, that has to be left over the limit.
_DOUBT = 0.5
_STEPS = 5_000_000


class Drive(NamedTuple):
    """A harmonic motion of the support, or a force."""

    amplitude: float  # [m], or of a force [N]
    frequency: float  # [Hz]


class Schedule(NamedTuple):
    """How long a run is watched, and when it may end before."""

    settle: float  # from the end of the path to the window [periods]
    window: float  # [periods]
    close: float  # distance from the steady motion, relative, at which a run may end; 0: not before its end
    limit: float  # amplitude [m] above which a run need not be finished
    repeats: int  # periods after which a motion may repeat itself, at most; at least 2


@kernel
def _advance(run, table, drive, begin, end, y, n, sampling, out, observed):
    """Integrate one row from `begin` to `end` [s]; returns the outcome's value."""
    table[0, at.START], table[0, at.END] = begin, end
    table[0, at.A0], table[0, at.OMEGA] = drive.amplitude, 2.0 * math.pi * drive.frequency
    table[0, at.PHASE] = 2.0 * math.pi * ((begin * drive.frequency) % 1.0)
    window = (begin, end) if observed else (math.inf, math.inf)
    nothing = np.zeros((0, at.IMPACT_COLUMNS))
    return integrate(run, table, y, n, window, sampling, out, nothing, _STEPS)


@kernel
def _travel(run, table, drive, path, y, n, out):
    """Follow the path (k, 2) of the ceiling from the state's time on; returns the outcome's value."""
    for k in range(path.shape[0] - 1):
        begin, end = path[k, 0], path[k + 1, 0]
        table[0, at.HEIGHT] = path[k, 1]
        table[0, at.CEILING_VELOCITY] = (path[k + 1, 1] - path[k, 1]) / (end - begin)
        outcome = _advance(run, table, drive, begin, end, y, n, (0.0, 1.0), out, False)
        if outcome != 0:
            return outcome
    table[0, at.HEIGHT], table[0, at.CEILING_VELOCITY] = path[-1, 1], 0.0
    return 0


@kernel
def _judge(amplitudes, apart, k, schedule):
    """Verdict after round k, and the amplitude a run comes to [m]."""
    here = amplitudes[k]
    if k < 2:
        return WATCHED, here
    step, before = here - amplitudes[k - 1], amplitudes[k - 1] - amplitudes[k - 2]
    ratio = step / before if before != 0.0 else 0.0
    fading = 0.0 < ratio < _SHRINKING
    left = step * ratio / (1.0 - ratio) if fading else 0.0
    rate = max(apart[k] / max(apart[k - 1], 1e-300), apart[k - 1] / max(apart[k - 2], 1e-300))
    if k > 2 and rate < _SHRINKING and apart[k] * rate / (1.0 - rate) <= schedule.close:
        return SETTLED, here + left
    if k >= _LEAST and here > schedule.limit:
        if fading and here + left - _DOUBT * abs(left) > schedule.limit:
            return EXCEEDED, here + left
        if here > _GROWN * amplitudes[:k].min():
            return EXCEEDED, here
    return WATCHED, here


@kernel
def respond(run, drive, path, schedule, y, n):
    """Advance a state in place along a path (k, 2) of (t [s], h [m]) that begins at its time, and watch it there.

    run: as `integrate` takes it. Returns outcome's value, verdict,
    amplitude [m], and the largest change of the beam in the window between periods two apart [m], or as many up to
    `repeats` as make it least; of a run that ended before its window that is no more than what was left of its way.
    """
    table = np.zeros((1, at.DRIVE_COLUMNS))
    none = np.zeros((at.SAMPLE_ROWS, 0))
    outcome = _travel(run, table, drive, path, y, n, none)
    if outcome != 0:
        return outcome, WATCHED, 0.0, 0.0
    period, now = 1.0 / drive.frequency, path[-1, 0]
    stopping = schedule.close > 0.0 or schedule.limit < math.inf
    rounds = int(schedule.settle / ROUND) if stopping else 0
    amplitudes, apart = np.zeros(rounds), np.zeros(rounds)
    first = now + (schedule.settle - ROUND * rounds) * period
    if first > now:
        outcome = _advance(run, table, drive, now, first, y, n, (0.0, 1.0), none, False)
    for k in range(rounds):
        if outcome != 0:
            break
        was = y.copy()
        y[at.LOWEST], y[at.HIGHEST] = math.inf, -math.inf
        begin, end = first + k * ROUND * period, first + (k + 1) * ROUND * period
        outcome = _advance(run, table, drive, begin, end, y, n, (0.0, 1.0), none, True)
        amplitudes[k] = 0.5 * (y[at.HIGHEST] - y[at.LOWEST])
        pace = 2.0 * math.pi * drive.frequency
        moved, faster = distances(run[1].modes, y, was)
        moved += faster / pace
        apart[k] = moved / max(amplitudes[k], 1e-300)
        verdict, amplitude = _judge(amplitudes, apart, k, schedule)
        if outcome == 0 and verdict != WATCHED:
            return outcome, verdict, amplitude, apart[k] * amplitude if verdict == SETTLED else amplitude
    if outcome != 0:
        return outcome, WATCHED, 0.0, 0.0
    begin = first + rounds * ROUND * period
    strobe = np.zeros((at.SAMPLE_ROWS, int(schedule.window)))
    y[at.LOWEST], y[at.HIGHEST], n[at.SAMPLE] = math.inf, -math.inf, 0
    outcome = _advance(run, table, drive, begin, begin + schedule.window * period, y, n, (begin, period), strobe, True)
    least = math.inf
    for repeats in range(2, schedule.repeats + 1):
        change = 0.0
        for parity in range(repeats):
            beam = strobe[at.S_BEAM, parity::repeats]
            if beam.size:
                change = max(change, beam.max() - beam.min())
        least = min(least, change)
    return outcome, WATCHED, 0.5 * (y[at.HIGHEST] - y[at.LOWEST]), least
