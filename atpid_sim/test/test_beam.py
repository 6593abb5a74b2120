# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The beam's closed form where it is hardest: at and near resonance, undamped, very strongly damped, in long rows."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from atpid_sim.engine import columns
from atpid_sim.engine.arc import arc_from
from atpid_sim.engine.beam import beam_at, bounded_at, snap_bounded_at
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.integration import Integration, Observation, drive_table
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.system import Array, System

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
MASS, STIFFNESS, GRAVITY = 0.3258, 427.6, 9.81
NATURAL = math.sqrt(STIFFNESS / MASS)
RAMP = [[0.0, 0.0], [0.5, 0.05], [1.0, 0.001]]

#: Anything from nothing to one, by orders of magnitude.
SHARES = st.one_of(st.just(0.0), st.floats(-16.0, 0.0).map(lambda power: 10.0**power))


def tone_row(detuning: float, radians: float, a0: float, a1: float) -> Array:
    """Row of a tone whose amplitude goes from a0 to a1 within so many radians of it."""
    omega = NATURAL * (1.0 + detuning)
    length = radians / omega
    return np.array([0.0, length, a0, (a1 - a0) / length, omega, 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0])


def beam_exactly(row: Array, damping: float, start: float, x: float, v: float, ahead: float) -> tuple[float, float]:
    """Displacement and velocity `ahead` seconds later: beam, tone and ramp as one autonomous system's exponential."""
    omega = float(row[4])
    a0, a1 = float(row[2] + row[3] * start), float(row[3]) / omega  # a1 and all rates per radian of the tone
    spring, loss = STIFFNESS / (MASS * omega**2), damping / (MASS * omega)
    system = np.zeros((7, 7))  # x, v, sin, cos, t sin, t cos, 1
    system[0, 1] = 1.0
    system[1, :2] = -spring, -loss
    system[1, 2:] = spring * a0 + loss * a1, loss * a0, spring * a1, loss * a1, -GRAVITY / omega**2
    system[2, 3] = system[4, 5] = system[4, 2] = system[5, 3] = 1.0
    system[3, 2] = system[5, 4] = -1.0
    angle = omega * start + row[5]
    first = np.array([x, v / omega, math.sin(angle), math.cos(angle), 0.0, 0.0, 1.0])
    last = expm(system * (omega * ahead)) @ first
    return float(last[0]), float(last[1]) * omega


@pytest.mark.slow
@given(
    detuning=SHARES,
    damping_ratio=SHARES,
    radians=st.floats(0.0, 3.5).map(lambda power: 10.0**power),
    ends=st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.1)),
    begin=st.floats(0.0, 0.9),
)
@settings(max_examples=300, deadline=None)
def test_the_motion_is_right_at_every_detuning_and_damping(
    detuning: float, damping_ratio: float, radians: float, ends: tuple[float, float], begin: float
) -> None:
    row = tone_row(detuning, radians, *ends)
    damping = 2.0 * damping_ratio * math.sqrt(STIFFNESS * MASS)
    start = begin * row[1]
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, damping, GRAVITY, 0.0), row, start, -0.007, 0.1)
    size = 0.007
    for share in (0.01, 0.1, 0.5, 1.0):
        x, v = beam_exactly(row, damping, start, -0.007, 0.1, share * (row[1] - start))
        size = max(size, abs(x), abs(v) / NATURAL)
        got = beam_at(arc, start + share * (row[1] - start))
        assert abs(got[0] - x) < 1e-9 * size
        assert abs(got[1] - v) < 1e-9 * size * row[4]


@given(
    detuning=st.one_of(SHARES, st.floats(-0.03, 0.03)),
    damping_ratio=st.floats(0.0, 0.02),
    radians=st.floats(1.0, 300.0),
    ends=st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.1)),
    begin=st.floats(0.0, 0.9),
    at=st.floats(0.0, 0.95),
)
@settings(max_examples=200, deadline=None)
def test_jerk_and_snap_keep_to_their_bounds_near_resonance(
    detuning: float, damping_ratio: float, radians: float, ends: tuple[float, float], begin: float, at: float
) -> None:
    row = tone_row(detuning, radians, *ends)
    damping = 2.0 * damping_ratio * math.sqrt(STIFFNESS * MASS)
    start, until = begin * row[1], float(row[1])
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, damping, GRAVITY, 0.0), row, start, 0.02, -0.5)
    tau = start + at * (until - start)
    _, _, _, jerk_bound, _ = bounded_at(arc, tau, until)
    *_, jerk, snap_bound = snap_bounded_at(arc, tau, until)
    assert abs(jerk) <= jerk_bound * (1.0 + 1e-9)
    times = np.linspace(tau, until, 300)
    jerks = np.array([snap_bounded_at(arc, t, until)[3] for t in times])
    accelerations = np.array([beam_at(arc, t)[2] for t in times])
    rounding = 1e-9 * (1.0 + np.abs(jerks).max())
    assert np.all(np.abs(jerks) <= jerk_bound + rounding)
    assert np.all(np.abs(np.diff(jerks)) <= snap_bound * np.diff(times) + rounding)
    assert np.all(np.abs(np.diff(accelerations)) <= jerk_bound * np.diff(times) + rounding)


def test_the_jerk_is_the_rate_of_the_acceleration_at_resonance() -> None:
    row = tone_row(1e-9, 60.0, 0.01, 0.05)
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, 1e-3, GRAVITY, 0.0), row, 0.2, 0.02, -0.5)
    h = 1e-5
    assert arc.resonant
    for tau in (0.3, 0.9, 1.5):
        slope = (beam_at(arc, tau + h)[2] - beam_at(arc, tau - h)[2]) / (2.0 * h)
        assert snap_bounded_at(arc, tau, float(row[1]))[3] == pytest.approx(slope, rel=1e-6)


def test_the_thesis_s_beam_is_nowhere_near_that_branch() -> None:
    for detuning in np.linspace(-0.1, 0.1, 101):
        assert not arc_from(
            MASS, System(MASS, 0.0, STIFFNESS, 0.56, GRAVITY, 0.0), tone_row(detuning, 50.0, 0.0, 0.01), 0.0, 0.0, 0.0
        ).resonant


def test_an_undamped_beam_at_resonance_grows_linearly_to_the_last_digits() -> None:
    row = tone_row(0.0, 3000.0, 0.01, 0.01)
    row[5] = 0.0
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, 0.0, 0.0, 0.0), row, 0.0, 0.0, 0.0)
    for t in (0.1, 1.9, 40.0, 80.0):
        expected = 0.005 * (math.sin(NATURAL * t) - NATURAL * t * math.cos(NATURAL * t))
        assert beam_at(arc, t)[0] == pytest.approx(expected, abs=1e-11 * NATURAL * t)


@pytest.mark.parametrize("damping", [30.0, 1e4, 1e8])
def test_a_strongly_damped_beam_returns_to_rest(damping: float) -> None:
    still = np.array([0.0, 1e3, *[0.0] * 10])
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, damping, 0.0, 0.0), still, 0.0, 0.1, 0.0)
    decay = 0.5 * damping / MASS
    quick = decay + math.sqrt(decay**2 - NATURAL**2)
    slow = NATURAL**2 / quick
    for t in (1.0, 10.0, 100.0):
        x, v, a, *_ = beam_at(arc, t)
        assert x == pytest.approx(0.1 * quick / (quick - slow) * math.exp(-slow * t), rel=1e-12)
        assert v == pytest.approx(-slow * x, rel=1e-12)
        assert a == pytest.approx(slow**2 * x, abs=1e-12 * STIFFNESS * x / MASS)


def beam(damping: float) -> dict[str, float]:
    return {"mass": MASS, "stiffness": STIFFNESS, "damping": damping}


def ramped(damping: float, frequency: Any, height: float, duration: float) -> Scene:
    return STANDARD.with_(
        beam=beam(damping),
        excitation={"amplitude": RAMP, "frequency": frequency},
        ceiling={"height": height},
        duration=duration,
        steady_window=[0.75 * duration, duration],
    )


@pytest.mark.parametrize("damping", [0.0, 1e-12, 1e-7])
def test_every_fidelity_integrates_an_undamped_beam_at_resonance(damping: float) -> None:
    scene = ramped(damping, NATURAL / (2.0 * math.pi), 0.5, 2.0)
    soft = simulate(scene, "soft", 1e-8, check=False)
    assert soft.amplitude == pytest.approx(0.0785433765, rel=1e-5)  # LSODA, undamped
    assert abs(soft.energy_residual) < 1e-6
    assert simulate(scene, "impact", check=False).amplitude == pytest.approx(soft.amplitude, rel=0.03)
    closed = simulate(ramped(damping, "resonance", 0.017, 4.0), "simplified", check=False)
    assert closed.amplitude == pytest.approx(0.4848831217, rel=1e-6)
    assert abs(closed.energy_residual) < 1e-9


@pytest.mark.parametrize("damping", [0.0, 0.56, 24.0, 1e3, 4e5])
@pytest.mark.parametrize("height", [0.017, 0.2, 5.0])
def test_the_ledger_of_one_mass_closes(damping: float, height: float) -> None:
    scene = STANDARD.with_(beam=beam(damping), ceiling={"height": height}, duration=4.0, steady_window=[3.0, 4.0])
    assert abs(simulate(scene, "simplified", check=False).energy_residual) < 1e-8


@pytest.mark.parametrize("damping", [0.56, 24.0, 4e5])
def test_a_slow_drive_and_a_strong_damper_cost_nothing(damping: float) -> None:
    slow = {"amplitude": 0.01, "frequency": 0.01}
    scene = STANDARD.with_(
        beam=beam(damping), excitation=slow, ceiling={"height": 0.017}, duration=2e6, steady_window=[2e6 - 200.0, 2e6]
    )
    result = simulate(scene, "simplified", check=False)
    assert result.steps < 10_000  # in 20 000 periods of the drive and ten million of the beam
    assert result.amplitude == pytest.approx(0.01, rel=1e-5)
    assert abs(result.energy_residual) < 1e-6


def test_a_beam_alone_does_not_move_the_grain() -> None:
    table = drive_table(STANDARD)
    integration = Integration(STANDARD, "simplified")
    state = integration.initial_state()
    begun = state.grain
    integration.advance(state, table, Observation((0.0, 1.0)))
    assert (state.grain, state.grain_velocity, state.mode) == (begun, 0.0, columns.FREE)
    assert set(trajectory(STANDARD, 10.0, "simplified").grain) == {begun}
