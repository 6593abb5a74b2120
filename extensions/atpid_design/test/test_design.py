# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parts of a design: closed forms, published numbers, the structure of today, limits, bad input."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from commands_run import refusal
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import atpid_sim as ap
from atpid_design import problem as parts
from atpid_design.check import Check, interval_at, widened
from atpid_design.command import KICK, comes_back
from atpid_design.files import height_map, scene_mapping
from atpid_design.forces import contact_time, forces, law_force, sound_power
from atpid_design.grain_choice import Candidate, fractions, preferred
from atpid_design.limits import warnings_of
from atpid_design.make import Design, Landscape
from atpid_design.motor import motor, peak_pressure
from atpid_design.problem import NOMINAL, Deviation, Problem, Uncertainty, case, problem_of, scene_of
from atpid_design.tuned_mass import TunedBeam, compare, optimised
from atpid_design.worst_case import FrequencyPoint, Interval, Point, Structures, response_of
from atpid_sim.contact import tsuji
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.modal import bare_amplitude
from atpid_sim.outcome import NumericalFailure
from atpid_sim.robust import Response, adverse, corners, inside
from atpid_sim.scene import scene_from_mapping
from atpid_sim.system import System, reduced_mass

OPTIONS = ["--mass", "2", "--frequency", "15", "--damping", "0.02", "--amplitudes", "0.001:0.004"]


def pipe(**changes: object) -> Problem:
    """Return a structure of 2 kg at 15 Hz."""
    made = {"mass": 2.0, "frequency": 15.0, "damping": 0.02, "amplitudes": (0.001, 0.004), "young_modulus": 2.1e11}
    return problem_of(**(made | changes))


def floor(**changes: object) -> Problem:
    """Return a floor plate of 38 kg at 7.2 Hz."""
    return pipe(**({"mass": 38.0, "frequency": 7.2, "damping": 0.012, "amplitudes": (0.001, 0.002)} | changes))


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


def two_points(**changes: object) -> list[Point]:
    return [a_point(0.001, 0.12, **changes), a_point(0.002, 0.14, **changes)]


# closed forms and published numbers


@pytest.mark.parametrize("restitution", [0.02, 0.15, 0.6, 0.95])
@pytest.mark.parametrize("fraction", [0.01, 0.1, 0.5])
def test_the_contact_has_the_restitution_that_was_given(restitution: float, fraction: float) -> None:
    scene = scene_of(pipe(restitution=restitution, max_mass_fraction=0.6), fraction, 0.001, 0.2)
    found = restitution_of(contact_of(scene), 1.0, reduced_mass(system_of(scene)))
    assert found == pytest.approx(restitution, rel=1e-9)


def test_duration_and_pressure_of_a_hertzian_impact() -> None:
    # published: a sphere of 0.1 m, 7e10 Pa, 0.3, 2699 kg/m^3, on a rigid wall at 0.2 m/s: 731.66 us
    mass, radius = 2699.0 * 4.0 / 3.0 * math.pi * 0.1**3, 0.1
    stiffness = 4.0 / 3.0 * 7e10 / (1.0 - 0.3**2) * math.sqrt(radius)
    system = System(1e12 * mass, mass, 1.0, 0.0, 0.0, radius)
    assert contact_time(system, stiffness, 0.2) == pytest.approx(731.66e-6, rel=1e-4)
    # with 0.2, on a wall of the same: F = 3/2 p0 pi a^2 with a^2 = R times the depth
    force, modulus = 1e4, 7e10 / (2.0 * (1.0 - 0.2**2))
    depth = (force / (4.0 / 3.0 * modulus * math.sqrt(radius))) ** (2.0 / 3.0)
    expected = 1.5 * force / (math.pi * radius * depth)
    assert peak_pressure(floor(young_modulus=7e10), force, radius) == pytest.approx(expected, rel=1e-9)


def test_the_sampled_force_is_that_of_the_law() -> None:
    step, parameters, rate = 1e-7, np.array([4e7, 90.0]), 2.0 * math.pi * 2000.0
    time = np.arange(4000) * step
    overlap, velocity = 1e-3 * np.sin(rate * time), 1e-3 * rate * np.cos(rate * time)
    pairs = zip(overlap, velocity, strict=True)
    kernel = np.array([tsuji.force(x, v, 0.0, parameters) if x > 0.0 else 0.0 for x, v in pairs])
    np.testing.assert_allclose(law_force(overlap, step, parameters), np.maximum(kernel, 0.0), atol=1e-4 * kernel.max())


@pytest.mark.parametrize("duration", [0.02, 1.0, 3.0, 30.0])
def test_the_sound_of_an_impact_is_that_of_the_dipole_solution_in_time(duration: float) -> None:
    # potential cos(theta) d/dr (f(t - r/c) / r) outside a sphere of unit radius, in a fluid of unit density and speed
    # of sound; the wall's velocity u gives f'' + 2 f' + 2 f = u, and the far field's pressure is cos(theta) f'' / r
    def rates(t: float, y: np.ndarray) -> list[float]:
        velocity = 0.5 - 0.5 * math.cos(math.pi * min(t / duration, 1.0))
        second = velocity - 2.0 * y[1] - 2.0 * y[0]
        return [y[1], second, second**2]

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
    mass, parameters = reduced_mass(one.damper.system), one.contact.parameters

    def relative(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -tsuji.force(max(y[0], 0.0), y[1], 0.0, parameters) / mass]

    single = solve_ivp(relative, (0.0, 2e-3), [0.0, found.speed], rtol=1e-9, atol=1e-12, max_step=2e-6)
    alone = law_force(np.interp(np.arange(0.0, 2e-3, 1e-6), single.t, single.y[0]), 1e-6, parameters)
    assert found.ceiling == pytest.approx(alone.max(), rel=0.01)
    # one impact a period, whose impulse is the change of momentum; the beam pushes for as long as it lasts
    assert found.rate == pytest.approx(one.damper.frequency, rel=0.01)
    assert found.impulse == pytest.approx(mass * 1.15 * found.speed, rel=0.05)


def test_the_box_is_a_fractional_factorial_design_of_resolution_four_and_random_points_inside() -> None:
    box = corners(8)
    assert box.shape == (16, len(Uncertainty.model_fields))
    assert np.array_equal(box.T @ box, 16.0 * np.eye(8))
    products = np.array([box[:, i] * box[:, k] for i in range(8) for k in range(i)])
    assert not (products @ box).any()
    points = inside(500, 8, 3)
    assert np.abs(points).max() <= 1.0
    assert np.array_equal(points, inside(500, 8, 3))
    assert np.abs(points.mean(axis=0)).max() < 0.1


@given(st.lists(st.floats(-1.0, 1.0).filter(lambda slope: abs(slope) > 1e-3), min_size=8, max_size=8))
def test_the_adverse_corner_of_a_linear_response_is_exact(slopes: list[float]) -> None:
    assert np.array_equal(adverse(corners(8), corners(8) @ np.array(slopes)), np.sign(slopes))


# a deviation is what it is called


def test_each_deviation_changes_its_own_quantity() -> None:
    assert (*Uncertainty.model_fields, "further") == Deviation._fields
    assert parts.deviation(pipe(), np.ones(8)) == Deviation(**Uncertainty().model_dump())
    problem, fraction = pipe(), 0.2
    exact = scene_of(problem, fraction, 0.002, 0.08)
    changed: Callable[..., Deviation] = NOMINAL._replace
    off = {name: scene_of(problem, fraction, 0.002, 0.08, changed(**{name: 0.01})) for name in Uncertainty.model_fields}
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
    scene, radius = scene_of(problem, 0.2, 0.002, 0.08), parts.grain_radius(problem, 0.2)
    natural = scene.natural_frequency_hz
    assert natural == pytest.approx(parts.resonance(problem, 0.2)) == pytest.approx(15.0 * math.sqrt(0.8))
    assert scene.grain_mass == pytest.approx(parts.grain_mass(problem, 0.2)) == pytest.approx(0.5)
    assert 2.0 * scene.total_mass / scene.beam.damping == pytest.approx(parts.time_constant(problem, 0.2))
    assert 0.98 * 7850.0 < scene.grain_mass / (4.0 / 3.0 * math.pi * radius**3) <= 7850.0
    assert parts.mapping_of(problem, 0.2, 0.002, NOMINAL)["excitation"]["frequency"] == "resonance"


def test_stated_frequencies_stay_where_the_structure_moves_and_those_of_a_range_lie_close() -> None:
    problem = floor(excitation_frequency=(7.0, 7.0))
    for off in (NOMINAL, Deviation(frequency=0.02, mass=0.02)):
        assert scene_of(problem, 0.15, 0.002, 0.2, off, 7.0).frequency_hz == pytest.approx(7.0)
    assert scene_of(problem, 0.15, 0.002, 0.2, Deviation(detuning=0.005), 7.0).frequency_hz == pytest.approx(7.035)
    assert floor().frequencies == [None]
    assert floor(excitation_frequency=(7.0, 7.0)).frequencies == [7.0]
    found = [f for f in floor(excitation_frequency=(6.8, 7.6)).frequencies if f is not None]
    assert (found[0], found[-1]) == (6.8, 7.6)
    assert all(1.0 < b / a < 1.04 for a, b in pairwise(found))
    assert len(floor(excitation_frequency=(4.0, 14.0)).frequencies) == 6


def test_the_structures_are_at_each_frequency_and_the_worst_is_where_the_given_one_moves_most() -> None:
    structures = Structures.of(floor(excitation_frequency=(6.8, 7.6)), 0.15)
    assert [row[0].damper.frequency for row in structures.at] == structures.problem.frequencies
    assert all(len(row) == 17 for row in structures.at)
    assert all(6.8 * 0.994 < one.damper.frequency < 7.6 * 1.006 for one in structures.random)
    height = structures.at[0][0].damper.diameter + 0.01
    responses = [response_of(one, 0.002, height) for one in structures.every]
    given_ones = [responses[17 * k].amplitude for k in range(len(structures.at))]
    assert structures.worst(responses) == int(np.argmax(given_ones))


# the structure of today


def test_the_numbers_of_a_floor_plate_by_hand() -> None:
    # today at 7.2 and 6.8 Hz and a support of 2 mm: 83.4 and 18.1 mm
    for frequency, millimetres in ((7.2, 83.4), (6.8, 18.1), (7.6, 17.1)):
        one = case(floor(), 0.15, frequency=frequency)
        assert 1e3 * one.bare(0.002) == pytest.approx(millimetres, abs=0.06)
        s = one.damper.system
        closed = bare_amplitude(s.beam_mass + s.grain_mass, s.stiffness, s.damping, 0.002, frequency)
        assert one.damper.closed_amplitude(0.002) == pytest.approx(closed, rel=1e-12)


def test_a_response_has_both_references() -> None:
    one = case(floor(gravity=0.0), 0.15, frequency=7.2)
    found = response_of(one, 0.002, one.damper.diameter + 0.5 * one.damper.ballistic_clearance(0.002))
    assert found.efficiency == pytest.approx(1.0 - found.amplitude / one.damper.closed_amplitude(0.002))
    assert found.reduction == pytest.approx(1.0 - found.amplitude / one.bare(0.002))
    assert found.reduction > found.efficiency + 0.3


def test_the_rows_beside_a_tuned_mass() -> None:
    band = (0.97, 1.03)
    anywhere, there = (TunedBeam(0.1, 0.012, optimised(0.1, 0.012, *bands)) for bands in ((), (band,)))
    assert there.peak(band) < 0.8 * anywhere.peak(band)
    assert there.beam(np.linspace(*band, 2001)).max() == pytest.approx(there.peak(band), rel=1e-6)
    problem = floor(gravity=0.0, excitation_frequency=(7.2, 7.2))
    made = compare(problem, 0.15, two_points(frequency=7.2))
    assert made.mass == pytest.approx(parts.grain_mass(problem, 0.15))
    least, _, largest = made.rows[:3]
    assert 1e3 * largest.bare == pytest.approx(83.4, abs=0.06)
    assert largest.tuned / least.tuned == pytest.approx(2.0)  # it is linear
    assert [row.frequency / 7.2 for row in made.rows[3:7]] == pytest.approx([0.9, 0.95, 1.05, 1.1])
    assert [row.frequency for row in made.rows[7:]] == pytest.approx([7.2] * 4)
    assert made.over_frequency[-1].frequency >= 7.2 * 1.1
    # another natural frequency: spring, damper and masses stay, so over the new one all are scaled
    row, factor = made.rows[7], 0.9
    own = TunedBeam(made.mass / 38.0, 0.012, optimised(made.mass / 38.0, 0.012, (0.975, 1.025)))
    assert made.frequency == pytest.approx(7.2 * own.tuning.frequency, rel=1e-4)
    detuned = own.tuning.__class__(own.tuning.frequency / factor, own.tuning.damping / factor)
    assert row.tuned == pytest.approx(0.002 * float(TunedBeam(made.mass / 38.0, 0.012, detuned).beam(1.0 / factor)))


# the motor


def test_speed_force_and_torque_of_the_motor() -> None:
    problem = pipe(lever=0.02)
    points = [a_point(a, 0.05 + 10.0 * a, ceiling_force=Interval(1.0, 1.0, 5e5 * a)) for a in (0.001, 0.002, 0.004)]
    made = motor(problem, 0.2, points)
    tau = 1.0 / (2.0 * math.pi * 15.0 * 0.02 * 0.8)  # 2 M / c
    assert made.time_constant == pytest.approx(tau)
    assert made.speed == pytest.approx((0.09 - 2.0 * parts.grain_radius(problem, 0.2)) / tau)  # from closed
    steep = [a_point(0.001, 0.05), a_point(0.002, 0.07), a_point(0.004, 0.08)]
    assert motor(problem, 0.2, steep).speed == pytest.approx(20.0 * 0.003 / tau)  # from 1 to 2 mm
    assert (made.force, made.torque) == pytest.approx((2000.0, 40.0))
    assert made.travel == pytest.approx(0.03)


def test_screw_gear_and_power() -> None:
    made = motor(floor(motor_speed=1500.0), 0.15, two_points(mean_force=30.0, height_error=0.0007, floor_force=900.0))
    turns = 1500.0 / 60.0
    assert made.gear >= 1.0
    assert made.gear * made.speed == pytest.approx(turns * made.lead)  # the ceiling has its speed at the motor's
    smaller = max((lead for lead in (1.5e-3, 2e-3, 3e-3, 4e-3, 5e-3) if lead < made.lead), default=0.0)
    assert smaller * turns < made.speed  # no smaller lead would do
    assert made.power == pytest.approx(30.0 * made.speed / 0.3)
    assert made.screw_torque * 2.0 * math.pi * 0.3 == pytest.approx(30.0 * made.lead)
    assert (made.height_error, made.floor_force) == (0.0007, 900.0)
    assert made.impacts_a_day == pytest.approx(13.0 * 86400.0)


# the choice of the grain


def grains(*lows: float) -> list[Candidate]:
    return [
        Candidate(fraction, fraction, 0.01, Interval(low + 0.1, low, low + 0.2), (0.1, 0.2), 1.0, "" if low else "soft")
        for fraction, low in zip(fractions(pipe()), lows, strict=False)
    ]


@pytest.mark.parametrize(
    ("target", "lows", "expected"),
    [
        # the smallest that keeps the target comes first and the best last
        (0.7, (0.5, 0.72, 0.69, 0.8, 0.75), [0.72, 0.75, 0.8]),
        (0.9, (0.5, 0.8, 0.7), [0.8]),
        # without a target the smallest that is nearly as good as the best
        (None, (0.5, 0.78, 0.80), [0.78]),
        (None, (0.0, 0.7), [0.7]),
    ],
)
def test_the_smallest_grain_that_is_good_enough_comes_first(
    target: float | None, lows: tuple[float, ...], expected: list[float]
) -> None:
    changes = {} if target is None else {"target_efficiency": target}
    assert [one.efficiency.low for one in preferred(pipe(**changes), grains(*lows))] == expected


def test_no_grain_at_all_is_a_numerical_failure_and_the_largest_fraction_is_the_one_allowed() -> None:
    with pytest.raises(NumericalFailure, match="--young-modulus"):
        preferred(pipe(), grains(0.0, 0.0))
    assert fractions(pipe(max_mass_fraction=0.12)) == [0.02, 0.03, 0.05, 0.07, 0.1, 0.12]


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


def lines(problem: Problem, fraction: float, points: list[Point], check: Check | None = None) -> list[str]:
    return warnings_of(problem, fraction, points, motor(problem, fraction, points), check or Check(32, 0, 0.0))


def of_pipe(**changes: Any) -> list[str]:
    return lines(pipe(), 0.2, [replace(a_point(0.001, 0.06), **changes), a_point(0.004, 0.08)])


def of_floor(fraction: float = 0.15, points: list[Point] | None = None, **changes: object) -> list[str]:
    return lines(floor(**changes), fraction, points or two_points())


def test_a_design_within_all_limits_has_no_warning() -> None:
    assert of_pipe() == of_floor() == []
    # density and modulus of one material
    for density, modulus in ((7850.0, 2.1e11), (1200.0, 2.1e8), (1400.0, 3e9), (2700.0, 7e10), (11340.0, 1.6e10)):
        assert of_floor(density=density, young_modulus=modulus) == []
    # 1 mm of the support moves the closed damper by 13 mm at 13 Hz: 86.7 m/s^2
    assert of_floor(gravity=0.0, side_friction=0.04) == of_floor(slope=2.2) == []


@pytest.mark.parametrize(
    ("changes", "patterns"),
    [
        ({"overlap": 0.2}, [r"^contact: .*0\.20 .* 1\.2e\+12 Pa"]),  # 2.1e11 * 2^2.5
        ({"acceleration": 0.8}, [r"^gravity: .*±1 mm .* below ±?[\d.]+ mm"]),
        ({"rate": 0.0}, [r"^gravity: .*±1 mm .* 9 g"]),
        ({"regular": False}, ["^irregular .*±1 mm"]),
        ({"efficiency": Interval(0.8, 0.6, 0.9)}, ["^sensitive: .* 15 .*±1 mm"]),
        (
            {"over_frequency": [FrequencyPoint(13.0, 0.005, 0.004, -0.2)], "reduction": Interval(-0.2, -0.3, 0.1)},
            [r"^reduction .* 13 Hz .*±1 mm.*--excitation-frequency"],
        ),
        ({"reduction": Interval(0.2, -0.1, 0.3)}, ["^reduction .*±1 mm.* -10 %"]),
        ({"height": 1.4, "best_height": 3.0}, ["^container: .*1400 mm.*--max-mass-fraction", "^container: .*±1 mm"]),
    ],
)
def test_each_limit_is_one_line(changes: dict[str, object], patterns: list[str]) -> None:
    found = of_pipe(**changes)
    assert [pattern for pattern in patterns if not any(re.search(pattern, line) for line in found)] == []


def test_a_target_that_no_grain_keeps_is_named() -> None:
    points = [a_point(0.001, 0.06), a_point(0.004, 0.08)]
    target, check = lines(pipe(target_reduction=0.95), 0.2, points, Check(32, 3, 0.01))[:2]
    assert re.match("--target-reduction: 95 % .*45 %", target)
    assert re.match("check: 3 of 32 ", check)


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ({"young_modulus": 2.1e8}, r"^--young-modulus: 2\.1e\+08 Pa .*e = 0\.15"),
        ({"young_modulus": 1e9}, r"^--young-modulus: 1e\+09 Pa .*steel.* 8\.4 times"),
        ({"density": 1410.0}, r"^--young-modulus: 2\.1e\+11 Pa .*pom"),
        ({"yield_strength": 1e6}, r"^contact: .* 1\.6 MPa"),
        ({"motor_speed": 10.0}, r"^motor: .*10 1/min.*--motor-speed"),
        ({"gravity": 0.0}, r"^side wall: .*±1, ±2 mm .*0\.034 .*--side-friction"),
        ({"slope": 4.0}, r"^slope: .*0\.052 rad.*0\.03"),
        # 79 mm at 29.4 Hz: 275 g
        (
            {"points": two_points(closed_amplitude=0.079, frequency=29.4)},
            "^structure: .*±2 mm .*±79 mm .*275 g .*15 m/s.*--amplitudes",
        ),
        ({"fraction": 0.4, "max_mass_fraction": 0.5}, "^grain: .*67 % .*--max-mass-fraction"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], pattern: str) -> None:
    (line,) = of_floor(**changes)
    assert re.search(pattern, line)


# after a kick


def designed(*points: tuple[float, float]) -> Design:
    """Return what is read of a design with these amplitudes and heights."""
    problem = problem_of(mass=2.0, frequency=15.0, damping=0.02, amplitudes=(0.001, 0.003))
    made = [SimpleNamespace(amplitude=amplitude, height=height, frequency=12.55) for amplitude, height in points]
    return cast(Design, SimpleNamespace(problem=problem, mass_fraction=0.3, points=made))


def test_the_least_share_of_kicks_that_come_back_is_stated_and_motions_that_are_not_steady_are_named() -> None:
    # support and height [m]: the grain held; a motion beside another one; an irregular one
    held, bistable, irregular = (1e-3, 0.0594), (1e-3, 0.08), (3e-3, 0.1094)
    found = ap.kicked(scene_of(designed().problem, 0.3, *bistable, frequency=12.55), KICK)
    assert 0.9 < found.share < 1.0
    numbers = [f"{100 * value:.1f}" for value in (found.share, found.low, found.high)]
    assert re.findall(r"[\d.]+", comes_back(designed(held, bistable)))[:5] == [*numbers, "0.1", "1"]
    assert re.findall(r"[\d.]+", comes_back(designed(held)))[:6] == ["100.0", "96.1", "100.0", "0.1", "1", "95"]
    assert re.findall(r"\d+ of \d+", comes_back(designed(irregular))) == ["1 of 1"]
    assert re.findall(r"\d+ of \d+", comes_back(designed(held, irregular))) == ["1 of 2"]


# the page and the scene


@cache
def a_design(given_range: tuple[float, float] | None) -> Design:
    problem = floor(excitation_frequency=given_range)
    fraction, points = 0.15, two_points(frequency=7.2, acceleration=math.inf)
    mass, radius = parts.grain_mass(problem, fraction), parts.grain_radius(problem, fraction)
    efficiency, reduction = points[0].efficiency, points[0].reduction
    trade = Candidate(fraction, mass, radius, efficiency, (0.12, 0.14), 100.0, reduction=reduction)
    curve = np.linspace(0.5, 0.2, 5)
    return Design(
        problem=problem, candidates=[trade], mass_fraction=fraction, grain_mass=mass, radius=radius,
        resonance=parts.resonance(problem, fraction), points=points, beyond=[],
        motor=motor(problem, fraction, points), check=Check(32, 0, 0.0),
        landscape=Landscape(0.001, np.linspace(0.1, 0.2, 5), curve, np.tile(curve[:, None], 16)),
        tuned_mass=compare(problem, fraction, points), warnings=lines(problem, fraction, two_points()), wall_s=1.0,
    )  # fmt: skip


@pytest.mark.parametrize(("given_range", "written"), [(None, "resonance"), ((7.2, 7.2), 7.2), ((6.8, 7.6), "drifts")])
def test_the_scene_has_the_stands_noise_and_the_machines_frequency(given_range: Any, written: object) -> None:
    made = a_design(given_range)
    mapping = scene_mapping(made)
    assert mapping["sensors"]["laser"]["noise"] == 2e-5
    shown = [[0.0, 6.8], [mapping["duration"], 7.6]] if written == "drifts" else written
    assert mapping["excitation"]["frequency"] == shown
    assert mapping["container"] == {"side_friction": 0.3, "slope": 0.0}
    plain = made.to_json()
    assert plain["reduction"] == {"low": 0.45, "high": 0.55}
    assert plain["points"][0]["beam_acceleration"]["high"] == pytest.approx((2.0 * math.pi * 7.2) ** 2 * 0.0025)
    assert plain["bare_resonance_amplitude"] == pytest.approx(0.002 * math.hypot(1.0, 0.024) / 0.024)
    del mapping["ceiling"]["map"]
    mapping["ceiling"] |= {"controller": "direct"}
    assert height_map(made, scene_from_mapping(mapping, source="design")).heights.shape == (1, 2)


# bad input


#: For each option the values that are refused, and what is allowed.
BAD = {
    "--mass": {"-2.0": "1e-06 to 1e+06", "0,45": "0.45"},
    "--damping": {"0.8": "0.0005 to 0.2", "0.8%": "0.01"},
    "--amplitudes": {"1:4": "LO:HI", "0,001:0,004": "point", "0.004:0.001": "LO:HI", "0.004": "LO:HI"},
    "--frequency": {"31Hz": "unit", "nan": "number"},
    "--excitation-frequency": {"fast": "HZ or LO:HI", "28,5": "point", "16:14": "HZ, or LO:HI", "40": "HZ, or LO:HI"},
    "--target-reduction": {"80.0": "0.01 to 0.99"},
    "--uncertainty": {"weight=0.1": "NAME=VALUE", "mass=0,05": "NAME=VALUE", "mass=much": "NAME=VALUE"},
    "--uncertainty mass": {"0.9": "0 to 0.5"},
}


@pytest.mark.parametrize("option", BAD)
def test_bad_input_is_one_line(option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for value, allowed in BAD[option].items():
        words = ["--uncertainty", "mass=0.9"] if option == "--uncertainty mass" else [option, value]
        line = refusal(capsys, "design", *OPTIONS, "--out", tmp_path / "out", *words)
        assert line.startswith(f"error: {option}: given {value}; allowed: ")
        assert allowed in line
    assert not (tmp_path / "out").exists()


def test_a_grain_too_soft_for_all_amplitudes_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soft = ["--young-modulus", "1e3", "--max-mass-fraction", "0.02", "--out", tmp_path]
    assert "--young-modulus" in refusal(capsys, "design", *OPTIONS, *soft, status=3)
    assert list(tmp_path.iterdir()) == []
