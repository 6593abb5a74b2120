# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What docs/no_missed_impact.md rests on: jerk and snap bounds hold, and a safe step never passes a root."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.integrate import solve_ivp

from atpid_sim.engine.arc import arc_from, support_at
from atpid_sim.engine.beam import beam_at, bounded_at, snap_bounded_at
from atpid_sim.engine.modal_arc import modal_arc
from atpid_sim.engine.modal_room import keep, with_room
from atpid_sim.engine.safe_step import safe_step, safe_velocity_step
from atpid_sim.modal import ModeSet, modes_of
from atpid_sim.system import Array, System


def number(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers between the two, those below a billionth taken as zero: the motion has no finer scale."""
    return st.floats(low, high).map(lambda value: value if abs(value) > 1e-9 else 0.0)


def segment_of(a0: float, a1: float, omega: float, phase: float, c2: float = 0.0, c3: float = 0.0) -> Array:
    return np.array([0.0, 1.0, a0, a1, omega, phase, 0.002, -0.01, c2, c3, 0.1, 0.0])


SEGMENTS = st.builds(
    segment_of,
    st.floats(0.0, 0.1),
    st.floats(-0.05, 0.05),
    st.floats(1.0, 200.0),
    st.floats(0.0, 6.0),
    st.floats(-1.0, 1.0),
    st.floats(-5.0, 5.0),
)
BEAMS = st.tuples(st.floats(0.05, 2.0), st.floats(10.0, 2000.0), st.floats(0.0, 120.0))


@given(segment=SEGMENTS, beam=BEAMS, x=st.floats(-0.3, 0.3), v=st.floats(-8.0, 8.0), at=st.floats(0.0, 0.9))
@settings(max_examples=150, deadline=None)
def test_jerk_and_snap_never_exceed_their_bounds(
    segment: Array, beam: tuple[float, float, float], x: float, v: float, at: float
) -> None:
    mass, stiffness, damping = beam
    arc = arc_from(mass, System(mass, 0.0, stiffness, damping, 9.81, 0.0), segment, 0.0, x, v)
    _, _, a0, jerk_bound, _ = bounded_at(arc, at, 1.0)
    *_, jerk0, snap_bound = snap_bounded_at(arc, at, 1.0)
    times = np.linspace(at, 1.0, 400)
    acceleration = np.array([beam_at(arc, t)[2] for t in times])
    size = 1e-9 * (1.0 + np.abs(acceleration).max())
    # bounded derivatives: the change of a over any span stays within bound times span, and to second order with jerk0
    assert np.all(np.abs(np.diff(acceleration)) <= jerk_bound * np.diff(times) * (1 + 1e-6) + size)
    straight = a0 + jerk0 * (times - at)
    assert np.all(np.abs(acceleration - straight) <= 0.5 * snap_bound * (times - at) ** 2 * (1 + 1e-6) + size)


@pytest.mark.slow
@given(
    gap=number(0.0, 1.0),
    rate=number(-10.0, 10.0),
    acceleration=number(-500.0, 500.0),
    jerk=number(0.0, 1e5),
    longest=st.floats(1e-4, 1.0),
)
@settings(max_examples=500, deadline=None)
def test_a_safe_step_never_passes_a_root(
    gap: float, rate: float, acceleration: float, jerk: float, longest: float
) -> None:
    step = safe_step(gap, rate, acceleration, jerk, longest)
    assert 0.0 <= step <= longest
    s = np.linspace(0.0, step, 500)
    worst = gap + s * (rate + s * (0.5 * acceleration - s * jerk / 6.0))
    assert worst.min() >= -1e-9 * (gap + abs(rate) * step + abs(acceleration) * step**2 + jerk * step**3)


@given(margin=st.floats(1e-9, 10.0), acceleration=st.floats(-500.0, 500.0), jerk=st.floats(0.0, 1e5))
@settings(max_examples=200, deadline=None)
def test_a_safe_velocity_step_stays_below_its_limit(margin: float, acceleration: float, jerk: float) -> None:
    step = safe_velocity_step(margin, acceleration, jerk, 1.0)
    s = np.linspace(0.0, step, 200)
    assert (acceleration * s + 0.5 * jerk * s**2).max() <= margin * (1 + 1e-9) + 1e-13 * (abs(acceleration) + jerk)


@pytest.mark.parametrize("damping", [0.0, 0.56, 2.0 * math.sqrt(427.6 * 0.3258), 60.0])
def test_the_closed_form_solves_the_beam(damping: float) -> None:
    segment = segment_of(0.01, 0.02, 34.4, 0.3, 0.2, -0.4)
    arc = arc_from(0.3258, System(0.3258, 0.0, 427.6, damping, 9.81, 0.0), segment, 0.0, 0.02, -0.5)

    def slope(t: float, y: Array) -> list[float]:
        u, w = support_at(segment, t)
        return [y[1], (427.6 * (u - y[0]) + damping * (w - y[1])) / 0.3258 - 9.81]

    reference = solve_ivp(slope, (0.0, 1.0), [0.02, -0.5], method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True)
    for t in np.linspace(0.0, 1.0, 23):
        x, v, *_ = beam_at(arc, t)
        assert [x, v] == pytest.approx(list(reference.sol(t)), rel=1e-9, abs=1e-10)


def test_an_undamped_beam_at_resonance_grows_linearly() -> None:
    omega = math.sqrt(427.6 / 0.3258)
    arc = arc_from(
        0.3258,
        System(0.3258, 0.0, 427.6, 0.0, 0.0, 0.0),
        np.array([0, 2, 0.01, 0, omega, 0, 0, 0, 0, 0, 0.1, 0.0]),
        0.0,
        0.0,
        0.0,
    )
    for t in (0.1, 0.7, 1.9):
        expected = 0.5 * 0.01 * (math.sin(omega * t) - omega * t * math.cos(omega * t))
        assert beam_at(arc, t)[0] == pytest.approx(expected, rel=1e-5, abs=1e-8)


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _along(table: Any, system: Any, states: Any, segment: Any, begin: float, times: Any) -> Any:
    """Displacement and acceleration (times, 2) of several modes, their jerk's bound at `begin`, and the fast part."""
    own, owner = with_room(table, system)
    arc = modal_arc(own.modes, 0, states, segment, begin)
    x, v, a, bound, fast = bounded_at(arc, begin, times[-1])
    found = np.empty((times.size, 2))
    for k in range(times.size):
        found[k, 0], _v, found[k, 1], _u, _w = beam_at(arc, times[k])
    keep(owner)
    return found, (x, v, a, bound), (fast.x, fast.v, fast.a, fast.jerk, fast.size)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_several_modes_stay_within_their_bounds(seed: int) -> None:
    """The jerk's bound, and the motion that is slow with the fast free vibrations anywhere within their size."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    mass = 0.3 * 10.0 ** rng.uniform(-2, 2, count)
    natural = 30.0 * 10.0 ** rng.uniform(0, 2, count)
    natural[0] = 30.0
    stiffness = mass * natural**2
    damping = 2.0 * rng.choice([0.0, 0.02, 0.7, 3.0], count) * mass * natural
    factors = rng.uniform(-1.0, 1.0, count)
    free = ModeSet(mass, stiffness, damping, factors * stiffness, factors * damping, np.eye(count)[0] * 9.81)
    table = modes_of(free, 0.03, 9.81).table
    system = System(mass[0], 0.03, stiffness[0], damping[0], 9.81, 0.0085, table)
    segment = np.zeros(12)
    segment[1], segment[2:6] = 1.0, (0.01, 0.02 * rng.random(), rng.uniform(5.0, 60.0), rng.uniform(0.0, 6.0))
    segment[6:10] = 0.01 * rng.uniform(-1.0, 1.0, 4)
    states = np.column_stack((0.01 * rng.normal(size=count), rng.normal(size=count)))
    times = np.linspace(0.1, 0.3, 4001)
    found, (x, v, a, bound), (fast_x, fast_v, fast_a, fast_jerk, size) = _along(
        table, system, states, segment, 0.1, times
    )
    s = times - times[0]
    assert found[0] == pytest.approx((x, a))
    assert np.abs(np.diff(found[:, 1])).max() <= bound * s[1] * (1.0 + 1e-9)
    slow = x - fast_x + s * (v - fast_v + 0.5 * s * (a - fast_a))
    reach = (bound - fast_jerk) * s**3 / 6.0 + size
    assert (np.abs(found[:, 0] - slow) <= reach * (1.0 + 1e-9) + 1e-12).all()
