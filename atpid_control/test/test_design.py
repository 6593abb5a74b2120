# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parts of a design: closed forms, published numbers, rules, bad input."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_control.cli import main
from atpid_control.design.check import Check, interval_at, widened
from atpid_control.design.forces import contact_time, forces, law_force, sound_power
from atpid_control.design.grain_choice import Candidate, fractions, preferred
from atpid_control.design.limits import warnings_of
from atpid_control.design.motor import motor
from atpid_control.design.problem import (
    NOMINAL,
    Deviation,
    Problem,
    Uncertainty,
    case,
    deviation,
    grain_mass,
    grain_radius,
    mapping_of,
    problem_of,
    resonance,
    scene_of,
    time_constant,
)
from atpid_control.design.worst_case import FrequencyPoint, Interval, Point
from atpid_sim.contact import tsuji
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.outcome import NumericalFailure
from atpid_sim.robust import Response, adverse, corners, inside
from atpid_sim.system import System, reduced_mass

PIPE = {
    "mass": 2.0, "frequency": 15.0, "damping": 0.02, "amplitudes": (0.001, 0.004), "young_modulus": 2.1e11,
}  # fmt: skip
OPTIONS = ["--mass", "2", "--frequency", "15", "--damping", "0.02", "--amplitudes", "0.001:0.004"]


def pipe(**changes: object) -> Problem:
    return problem_of(**(PIPE | changes))


def a_point(amplitude: float, height: float, **changes: object) -> Point:
    """Return a point whose other numbers are unremarkable."""
    made = Point(
        amplitude=amplitude, height=height, clearance=height - 0.05, frequency=13.0,
        over_frequency=[FrequencyPoint(13.0, 0.002, 0.004, 0.5)], efficiency=Interval(0.85, 0.80, 0.90),
        reduction=Interval(0.5, 0.45, 0.55), beam_amplitude=Interval(0.002, 0.0018, 0.0025),
        bare_amplitude=Interval(0.004, 0.0038, 0.0042), closed_amplitude=0.013, best_height=height,
        best_efficiency=0.87, regular=True, numerical_error=1e-6, ceiling_force=Interval(100.0, 80.0, 120.0),
        floor_force=150.0, overlap=0.02, speed=1.0, impulse=0.5, rate=13.0, mean_force=6.0, sound_power=2e-9,
        acceleration=9.0, height_error=0.001, structures=70,
    )  # fmt: skip
    return replace(made, **changes)  # type: ignore[arg-type]


# closed forms and published numbers


@pytest.mark.parametrize("restitution", [0.02, 0.15, 0.6, 0.95])
@pytest.mark.parametrize("fraction", [0.01, 0.1, 0.5])
def test_the_contact_has_the_restitution_that_was_given(restitution: float, fraction: float) -> None:
    scene = scene_of(pipe(restitution=restitution, max_mass_fraction=0.6), fraction, 0.001, 0.2)
    system = system_of(scene)
    assert restitution_of(contact_of(scene), 1.0, reduced_mass(system)) == pytest.approx(restitution, rel=1e-9)


def test_the_duration_of_a_hertzian_impact_is_the_published_one() -> None:
    # a sphere of 0.1 m, 7e10 Pa, 0.3, 2699 kg/m^3, on a rigid wall at 0.2 m/s: 731.66 us
    mass = 2699.0 * 4.0 / 3.0 * math.pi * 0.1**3
    stiffness = 4.0 / 3.0 * 7e10 / (1.0 - 0.3**2) * math.sqrt(0.1)
    system = System(1e12 * mass, mass, 1.0, 0.0, 0.0, 0.1)
    assert contact_time(system, stiffness, 0.2) == pytest.approx(731.66e-6, rel=1e-4)


def test_the_sampled_force_is_that_of_the_law() -> None:
    step, parameters = 1e-7, np.array([4e7, 90.0])
    time = np.arange(4000) * step
    overlap = 1e-3 * np.sin(2.0 * math.pi * 2000.0 * time)
    velocity = 1e-3 * 2.0 * math.pi * 2000.0 * np.cos(2.0 * math.pi * 2000.0 * time)
    kernel = [
        max(0.0, tsuji.force(x, v, 0.0, parameters)) if x > 0.0 else 0.0 for x, v in zip(overlap, velocity, strict=True)
    ]
    assert law_force(overlap, step, parameters) == pytest.approx(np.array(kernel), abs=1e-4 * max(kernel))


@pytest.mark.parametrize("duration", [0.02, 1.0, 3.0, 30.0])
def test_the_sound_of_an_impact_is_that_of_the_dipole_solution_in_time(duration: float) -> None:
    # potential cos(theta) d/dr (f(t - r/c) / r) outside a sphere of unit radius, in a fluid of unit density and speed
    # of sound; the wall's velocity u gives f'' + 2 f' + 2 f = u, and the far field's pressure is cos(theta) f'' / r
    def velocity(t: float) -> float:
        return 0.5 - 0.5 * math.cos(math.pi * min(t / duration, 1.0))

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], velocity(t) - 2.0 * y[1] - 2.0 * y[0], (velocity(t) - 2.0 * y[1] - 2.0 * y[0]) ** 2]

    solved = solve_ivp(rates, (0.0, duration + 20.0), [0.0] * 3, rtol=1e-9, atol=1e-14, max_step=duration / 20.0)
    energy = 4.0 / 3.0 * math.pi * solved.y[2, -1]

    radius, step = 0.025, duration / 100.0
    pulse = np.zeros(2 * int((duration + 40.0) / step))
    pulse[:100] = 0.5 * math.pi / duration * np.sin(np.pi * np.arange(100) / 100.0)
    pulse -= np.roll(pulse, len(pulse) // 2)  # to a velocity and back
    density, sound = 1.204, 343.2
    once = sound_power(pulse * sound / radius, step * radius / sound, radius) * len(pulse) / 2 * step * radius / sound
    assert once / (density * radius**3) == pytest.approx(energy, rel=3e-3)
    taylor = math.pi / 3.0  # the entrained fluid's 1/2 (1/2 V) at a velocity of one
    assert energy == pytest.approx(taylor, rel=0.02) if duration < 0.1 else energy < taylor
    assert duration < 10.0 or energy == pytest.approx(taylor * math.pi**4 / 8.0 / duration**3, rel=0.05)


def test_the_largest_force_is_that_of_one_impact_at_the_closing_speed() -> None:
    one = case(pipe(gravity=0.0), 0.1)
    found = forces(one, 0.002, one.damper.diameter + 0.036)
    stiffness, damping = one.contact.parameters[:2]
    mass = reduced_mass(one.damper.system)

    def relative(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -tsuji.force(max(y[0], 0.0), y[1], 0.0, np.array([stiffness, damping])) / mass]

    single = solve_ivp(relative, (0.0, 2e-3), [0.0, found.speed], rtol=1e-9, atol=1e-12, max_step=2e-6)
    alone = law_force(np.interp(np.arange(0.0, 2e-3, 1e-6), single.t, single.y[0]), 1e-6, one.contact.parameters)
    assert found.ceiling == pytest.approx(alone.max(), rel=0.01)
    # one impact a period, whose impulse is the change of momentum; the beam pushes for as long as it lasts
    assert found.rate == pytest.approx(one.damper.frequency, rel=0.01)
    assert found.impulse == pytest.approx(mass * 1.15 * found.speed, rel=0.05)


def test_corners_are_a_fractional_factorial_design_of_resolution_four() -> None:
    box = corners(8)
    assert box.shape == (16, len(Uncertainty.model_fields))
    assert np.array_equal(box.T @ box, 16.0 * np.eye(8))
    products = np.array([box[:, i] * box[:, k] for i in range(8) for k in range(i)])
    assert not (products @ box).any()


@given(st.lists(st.floats(-1.0, 1.0).filter(lambda slope: abs(slope) > 1e-3), min_size=8, max_size=8))
def test_the_adverse_corner_of_a_linear_response_is_exact(slopes: list[float]) -> None:
    assert np.array_equal(adverse(corners(8), corners(8) @ np.array(slopes)), np.sign(slopes))


def test_speed_force_and_torque_of_the_motor() -> None:
    problem = pipe(lever=0.02)
    points = [a_point(a, 0.05 + 10.0 * a, ceiling_force=Interval(1.0, 1.0, 5e5 * a)) for a in (0.001, 0.002, 0.004)]
    made = motor(problem, 0.2, points)
    tau = 1.0 / (2.0 * math.pi * 15.0 * 0.02 * 0.8)  # 2 M / c
    assert made.time_constant == pytest.approx(tau)
    assert made.speed == pytest.approx((0.09 - 2.0 * grain_radius(problem, 0.2)) / tau)  # from closed
    steep = [a_point(0.001, 0.05), a_point(0.002, 0.07), a_point(0.004, 0.08)]
    assert motor(problem, 0.2, steep).speed == pytest.approx(20.0 * 0.003 / tau)  # from 1 to 2 mm
    assert (made.force, made.torque) == pytest.approx((2000.0, 40.0))
    assert made.travel == pytest.approx(0.03)


# a deviation is what it is called


def test_uncertainties_and_deviations_have_the_same_names() -> None:
    assert (*Uncertainty.model_fields, "further") == Deviation._fields
    assert deviation(pipe(), np.ones(8)) == Deviation(**Uncertainty().model_dump())


def test_each_deviation_changes_its_own_quantity() -> None:
    problem, fraction = pipe(), 0.2
    exact = scene_of(problem, fraction, 0.002, 0.08)
    changed: Callable[..., Deviation] = NOMINAL._replace
    off = {name: scene_of(problem, fraction, 0.002, 0.08, changed(**{name: 0.01}))
           for name in Uncertainty.model_fields}  # fmt: skip
    assert off["mass"].beam.mass == pytest.approx(2.02)
    assert off["mass"].grain_mass == pytest.approx(exact.grain_mass)
    assert off["frequency"].natural_frequency_hz == pytest.approx(1.01 * exact.natural_frequency_hz)
    assert off["frequency"].frequency_hz == pytest.approx(off["frequency"].natural_frequency_hz)
    assert off["damping"].beam.damping == pytest.approx(1.01 * exact.beam.damping)
    assert restitution_of(contact_of(off["restitution"]), 1.0, reduced_mass(system_of(exact))) == pytest.approx(0.1515)
    assert contact_of(off["young_modulus"]).parameters[0] == pytest.approx(1.01 * contact_of(exact).parameters[0])
    assert off["detuning"].frequency_hz == pytest.approx(1.01 * exact.natural_frequency_hz)
    assert off["amplitude"].to_mapping()["excitation"]["amplitude"] == pytest.approx(0.00202)
    assert off["height"].ceiling.heights[0][1] == pytest.approx(0.09)


def test_the_scene_is_that_of_the_options() -> None:
    problem = pipe()
    scene = scene_of(problem, 0.2, 0.002, 0.08)
    assert scene.natural_frequency_hz == pytest.approx(resonance(problem, 0.2)) == pytest.approx(15.0 * math.sqrt(0.8))
    assert scene.grain_mass == pytest.approx(grain_mass(problem, 0.2)) == pytest.approx(0.5)
    assert 2.0 * scene.total_mass / scene.beam.damping == pytest.approx(time_constant(problem, 0.2))
    volume = 4.0 / 3.0 * math.pi * grain_radius(problem, 0.2) ** 3
    assert 0.98 * 7850.0 < scene.grain_mass / volume <= 7850.0
    assert mapping_of(problem, 0.2, 0.002, NOMINAL)["excitation"]["frequency"] == "resonance"


def test_random_structures_lie_in_the_box_and_are_the_same_again() -> None:
    box = inside(500, 8, 3)
    assert np.abs(box).max() <= 1.0
    assert np.array_equal(box, inside(500, 8, 3))
    assert np.abs(box.mean(axis=0)).max() < 0.1


# the choice of the grain


def grains(*lows: float) -> list[Candidate]:
    masses = fractions(pipe())
    return [Candidate(f, f, 0.01, Interval(low + 0.1, low, low + 0.2), (0.1, 0.2), 1.0, "" if low else "too soft")
            for f, low in zip(masses, lows, strict=False)]  # fmt: skip


def test_the_smallest_grain_that_keeps_the_target_comes_first_and_the_best_last() -> None:
    found = preferred(pipe(target_efficiency=0.7), grains(0.5, 0.72, 0.69, 0.8, 0.75))
    assert [one.efficiency.low for one in found] == [0.72, 0.75, 0.8]
    assert [one.efficiency.low for one in preferred(pipe(target_efficiency=0.9), grains(0.5, 0.8, 0.7))] == [0.8]


def test_without_a_target_the_smallest_that_is_nearly_as_good_as_the_best() -> None:
    assert [one.efficiency.low for one in preferred(pipe(), grains(0.5, 0.78, 0.80))] == [0.78]
    assert [one.efficiency.low for one in preferred(pipe(), grains(0.0, 0.7))] == [0.7]
    with pytest.raises(NumericalFailure, match="--young-modulus"):
        preferred(pipe(), grains(0.0, 0.0))


def test_fractions_end_with_the_largest_allowed() -> None:
    assert fractions(pipe(max_mass_fraction=0.12)) == [0.02, 0.03, 0.05, 0.07, 0.1, 0.12]


# the check between the amplitudes


def test_an_answer_outside_widens_both_neighbours() -> None:
    points = [a_point(0.001, 0.06), a_point(0.004, 0.08, beam_amplitude=Interval(0.008, 0.0072, 0.01))]
    # amplitudes within those of the points, 1.8 to 2.5 of the support's 1 mm, but for the first; all reduced by half
    answers = [Response(x, e, True, 2.0 * x) for x, e in ((0.006, 0.77), (0.004, 0.85), (0.0038, 0.91))]
    wide, found = widened(points, [answers])
    assert (found.structures, found.outside) == (3, 2)
    assert found.excess == pytest.approx(0.03)
    assert interval_at(wide, 0.002) == pytest.approx((0.85, 0.77, 0.91))
    assert [one.beam_amplitude.high for one in wide] == pytest.approx([0.003, 0.012])
    assert [one.beam_amplitude.low for one in wide] == pytest.approx([0.0018, 0.0072])
    assert interval_at(wide, 0.002, "beam_amplitude") == pytest.approx((0.004, 0.0036, 0.006))


# limits


def test_a_design_within_all_limits_has_no_warning() -> None:
    points = [a_point(0.001, 0.06), a_point(0.004, 0.08)]
    assert warnings_of(pipe(), 0.2, points, motor(pipe(), 0.2, points), Check(32, 0, 0.0)) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"overlap": 0.2}, ["contact: ", "0.20 of its radius", "1.2e+12 Pa"]),  # 2.1e11 * 2^2.5
        ({"acceleration": 0.8}, ["gravity: up to ±1 mm", "does nothing below"]),
        ({"rate": 0.0}, ["does not reach the ceiling"]),
        ({"regular": False}, ["irregular motion", "±1 mm"]),
        ({"efficiency": Interval(0.8, 0.6, 0.9)}, ["sensitive", "15 points"]),
        (
            {"over_frequency": [FrequencyPoint(13.0, 0.005, 0.004, -0.2)], "reduction": Interval(-0.2, -0.3, 0.1)},
            ["reduction below 0: the damper makes it worse at 13 Hz and ±1 mm", "--excitation-frequency"],
        ),
        ({"reduction": Interval(0.2, -0.1, 0.3)}, ["reduction below 0 in some of the cases at ±1 mm, down to -10 %"]),
        ({"height": 1.4, "best_height": 3.0}, ["container: the ceiling reaches 1400 mm", "--max-mass-fraction"]),
    ],
)
def test_each_limit_is_one_line(changes: dict[str, object], words: list[str]) -> None:
    points = [replace(a_point(0.001, 0.06), **changes), a_point(0.004, 0.08)]  # type: ignore[arg-type]
    lines = warnings_of(pipe(), 0.2, points, motor(pipe(), 0.2, points), Check(32, 0, 0.0))
    assert all(any(word in line for line in lines) for word in words), lines


def test_a_target_that_no_grain_keeps_is_named() -> None:
    points = [a_point(0.001, 0.06), a_point(0.004, 0.08)]
    problem = pipe(target_reduction=0.95)
    lines = warnings_of(problem, 0.2, points, motor(problem, 0.2, points), Check(32, 3, 0.01))
    assert "--target-reduction: 95 % is not kept" in lines[0]
    assert "3 of 32 structures" in lines[1]


# bad input


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (["--mass", "-2"], "--mass: given -2.0; allowed: from 1e-06 to 1e+06"),
        (["--damping", "0.8"], "--damping: given 0.8; allowed: from 0.0005 to 0.2 (a ratio: 0.8 % is 0.008)"),
        (["--mass", "0,45"], "--mass: given 0,45; allowed: a number with a decimal point: 0.45"),
        (["--amplitudes", "1:4"], "--amplitudes: given 1:4; allowed: LO:HI, two rising amplitudes in metres, "),
        (["--amplitudes", "0,001:0,004"], "--amplitudes: given 0,001:0,004; allowed: a number with a decimal point"),
        (["--lever", "10.5"], "--lever: given 10.5; allowed: from 1e-06 to 10 (in metres: 10 mm is 0.01)"),
        (["--frequency", "31Hz"], "--frequency: given 31Hz; allowed: a number, without the unit; "),
        (["--damping", "0.8%"], "--damping: given 0.8%; allowed: a number, as a share: 1 % is 0.01; "),
        (["--excitation-frequency", "fast"], "--excitation-frequency: given fast; allowed: HZ or LO:HI, such as 29.4"),
        (["--excitation-frequency", "28,5"], "--excitation-frequency: given 28,5; allowed: a number with a decimal po"),
        (["--excitation-frequency", "16:14"], "--excitation-frequency: given 16:14; allowed: HZ, or LO:HI with LO"),
        (["--excitation-frequency", "40"], "--excitation-frequency: given 40; allowed: HZ, or LO:HI with LO below HI,"),
        (["--amplitudes", "0.004:0.001"], "--amplitudes: given 0.004:0.001; allowed: LO:HI, two rising"),
        (["--amplitudes", "0.004"], "--amplitudes: given 0.004; allowed: LO:HI, two rising"),
        (["--frequency", "nan"], "--frequency: given nan; allowed: a number; "),
        (["--target-reduction", "80"], "--target-reduction: given 80.0; allowed: from 0.01 to 0.99 (a share: 80 %"),
        (["--max-mass-fraction", "0.9"], "--max-mass-fraction: given 0.9; allowed: from 0.01 to 0.6"),
        (["--uncertainty", "weight=0.1"], "--uncertainty: given weight=0.1; allowed: NAME=VALUE"),
        (["--uncertainty", "mass=0,05"], "--uncertainty: given mass=0,05; allowed: NAME=VALUE with a decimal point"),
        (["--uncertainty", "mass=much"], "--uncertainty: given mass=much; allowed: NAME=VALUE"),
        (["--uncertainty", "mass=0.9"], "--uncertainty mass: given 0.9; allowed: from 0 to 0.5 (a share"),
    ],
)
def test_bad_input_is_one_line(given: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", *OPTIONS, "--out", str(tmp_path / "out"), *given]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"error: {line}")
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_grain_too_soft_for_every_amplitude_is_a_numerical_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soft = ["--young-modulus", "1e3", "--max-mass-fraction", "0.02", "--out", str(tmp_path)]
    assert main(["design", *OPTIONS, *soft]) == 3
    assert "give a stiffer grain (--young-modulus)" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
