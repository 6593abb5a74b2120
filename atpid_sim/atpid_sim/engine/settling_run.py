# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A transient under a harmonic drive, followed in one kernel until passages of a section draw together regularly."""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.row_loop import IN_CONTACT as GROUNDED
from atpid_sim.engine.row_loop import integrate, pass_sections
from atpid_sim.engine.sections import enter_section, leave_section
from atpid_sim.kernel import kernel

#: How a transient ends: it draws together, it does not, or there is no free flight to take a section in.
REGULAR, IRREGULAR, IN_CONTACT = range(3)
#: Samples of the period in which the longest free flight is looked for, and impacts logged in it.
_SAMPLES, _LOG = 128, 200
#: How many distances in a row have to shrink, and by which factor at least.
_SHRUNK, _SHRINKING = 3, 0.98
#: Distance of two passages, relative to the motion's size, below which a fixed point is looked for.
_NEAR = 0.03
#: Distance of successive passages over the one still to go, up to which they belong to one of period one.
_ALIKE = 2.5


@kernel
def _middle_of_longest_flight(samples, clearance):
    """Sample in the middle of the longest free flight of a period, taken as a ring; -1 without any.

    samples (SAMPLE_ROWS, n); clearance: of the grain between floor and ceiling [m].
    """
    count = samples.shape[1]
    longest, middle, length = 0, -1, 0
    for k in range(2 * count):  # twice around, so that no flight is cut
        gap = samples[at.S_GRAIN, k % count] - samples[at.S_BEAM, k % count]
        length = length + 1 if 0.0 < gap < clearance else 0
        if longest < length <= count:
            longest, middle = length, (k - length // 2) % count
    return middle


@kernel
def _rate(distances, count):
    """Largest factor between the last `_SHRUNK` + 1 of `count` distances; infinity where there are fewer."""
    if count <= _SHRUNK:
        return math.inf
    largest = 0.0
    for k in range(count - _SHRUNK, count):
        if distances[k - 1] > 0.0:
            largest = max(largest, distances[k] / distances[k - 1])
    return largest


@kernel
def _apart(one, other, scale):
    """Largest distance of two section states (n,) over the motion's size (n,)."""
    distance = 0.0
    for k in range(scale.shape[0]):
        distance = max(distance, abs(one[k] - other[k]) / scale[k])
    return distance


@kernel
def _to_section(run, table, y, n, budget):
    """Advance a state, at the table's begin, by a period and on to the middle of that period's longest free flight.

    There the table begins from then on. Returns how far the section lies behind the period, as a share of one, negative
    where there is none, and the beam's amplitude in it [m].
    """
    nothing, unsampled = np.zeros((0, at.IMPACT_COLUMNS)), np.zeros((at.SAMPLE_ROWS, 0))
    samples, impacts = np.zeros((at.SAMPLE_ROWS, _SAMPLES)), np.zeros((_LOG, at.IMPACT_COLUMNS))
    period = table[0, at.END]
    window, sampling = (0.0, period), (0.0, period / _SAMPLES)
    y[at.TIME], y[at.LOWEST], y[at.HIGHEST], n[at.SAMPLE], n[at.IMPACTS] = 0.0, math.inf, -math.inf, 0, 0
    outcome = integrate(run, table, y, n, window, sampling, samples, impacts, budget)
    for k in range(n[at.IMPACTS]):  # a contact may lie between samples
        between = int(impacts[k, at.E_TIME] / period * _SAMPLES) % _SAMPLES
        samples[at.S_GRAIN, between] = samples[at.S_BEAM, between]
    amplitude = 0.5 * (y[at.HIGHEST] - y[at.LOWEST])
    middle = _middle_of_longest_flight(samples, table[0, at.HEIGHT] - 2.0 * run[1].radius)
    if outcome != 0 or middle < 0:
        return -1.0, amplitude
    share = middle / _SAMPLES
    if middle > 0:
        table[0, at.END], y[at.TIME], window = share * period, 0.0, (math.inf, math.inf)
        outcome = integrate(run, table, y, n, window, sampling, unsampled, nothing, budget)
    table[0, at.END] = period
    table[0, at.PHASE] += table[0, at.OMEGA] * share * period
    return (share if outcome == 0 and n[at.MODE] == at.FREE else -1.0), amplitude


@kernel
def _draw_together(run, table, sections, begin, scale, budget, passages):
    """Pass a section from the state begin (1, n) on until the passages draw together regularly.

    scale (n,): size of the motion. passages (most, n) gets them. Returns how it ends, IN_CONTACT where a
    passage is no free flight, how many there are, after how many of them the motion repeats itself, and its distance
    from there at the rate of contraction, relative.
    """
    most = passages.shape[0]
    one, two = np.empty(most), np.empty(most)  # distances of passages one and two periods apart
    for k in range(most):
        last = begin if k == 0 else passages[k - 1 : k]
        done, ended = pass_sections(run, table, sections, last, passages[k : k + 1], budget)
        if done == 0:
            return (IN_CONTACT if ended == GROUNDED else IRREGULAR), k, 1, math.inf
        one[k] = _apart(passages[k], last[0], scale)
        if k > 0:
            two[k - 1] = _apart(passages[k], begin[0] if k == 1 else passages[k - 2], scale)
        for periods in range(1, 3):
            distances, count = (one, k + 1) if periods == 1 else (two, k)
            rate = _rate(distances, count)
            if rate <= _SHRINKING and distances[count - 1] <= _NEAR:
                left = distances[count - 1] / (1.0 - rate)
                # a motion of period one draws together at every second passage as well, and there more evenly
                repeats = 1 if one[k] <= _ALIKE * left else periods
                return REGULAR, k + 1, repeats, left
    return IRREGULAR, most, 1, math.inf


@kernel
def settle(run, rows, table, y, n, sections, sizes, least_size, budget, passages):
    """Follow a motion from state y, n, changed in place, until its passages of a section draw together regularly.

    run: as `integrate` takes it; rows: drive table up to constant conditions; table (1, DRIVE_COLUMNS): the period
    after it, from time zero on, changed to begin at the section; sections: how section states lie in y; sizes (n,): of
    a motion of unit amplitude; least_size: of a motion [m]; budget: steps of each run. passages (most, n) gets them.
    Returns the outcome's value of `rows`, how it ends, periods behind `rows`, the beam's amplitude [m], and the rest as
    `_draw_together`. Where a section turns out to lie in a contact another one is taken.
    """
    nothing, unsampled = np.zeros((0, at.IMPACT_COLUMNS)), np.zeros((at.SAMPLE_ROWS, 0))
    outcome = integrate(run, rows, y, n, (math.inf, math.inf), (0.0, 1.0), unsampled, nothing, budget)
    passed, amplitude, begin = 0.0, 0.0, np.empty((1, sizes.size))
    while outcome == 0:
        share, amplitude = _to_section(run, table, y, n, budget)
        if share < 0.0:  # where it has flown before, the motion is irregular
            return outcome, IRREGULAR if passed > 0.0 else IN_CONTACT, passed, amplitude, 0, 1, math.inf
        passed += 1.0 + share
        leave_section(sections, y, begin[0])
        scale = sizes * max(amplitude, least_size)
        left_over = passages[: max(0, passages.shape[0] - int(passed))]
        ending, count, periods, left = _draw_together(run, table, sections, begin, scale, budget, left_over)
        passed += count
        if ending != IN_CONTACT:
            return outcome, ending, passed, amplitude, count, periods, left
        if count > 0:
            begin[0] = passages[count - 1]
        enter_section(run[1].modes, sections, begin[0], y)
        n[at.MODE] = at.FREE
    return outcome, IRREGULAR, passed, amplitude, 0, 1, math.inf
