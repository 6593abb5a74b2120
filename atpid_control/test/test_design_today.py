# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A design against the structure of today: its closed form, the machine's frequency, the motor, invalid input."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_design import a_point

from atpid_control.design.beside_tuned_mass import compare
from atpid_control.design.check import Check
from atpid_control.design.files import height_map, scene_mapping
from atpid_control.design.forces import contact_time
from atpid_control.design.grain_choice import Candidate
from atpid_control.design.limits import warnings_of
from atpid_control.design.make import Design, Landscape
from atpid_control.design.motor import motor, peak_pressure
from atpid_control.design.page import page
from atpid_control.design.problem import (
    NOMINAL,
    Deviation,
    Problem,
    case,
    deviation,
    grain_mass,
    grain_radius,
    mapping_of,
    problem_of,
    resonance,
    scene_of,
)
from atpid_control.design.today import bare_range
from atpid_control.design.tuned_mass import TunedBeam, optimised
from atpid_control.design.worst_case import Point, Structures, response_of
from atpid_sim.modal import bare_amplitude
from atpid_sim.scene import scene_from_mapping
from atpid_sim.system import reduced_mass

FLOOR = {
    "mass": 38.0, "frequency": 7.2, "damping": 0.012, "amplitudes": (0.001, 0.002), "young_modulus": 2.1e11,
}  # fmt: skip


def floor(**changes: object) -> Problem:
    return problem_of(**(FLOOR | changes))


def two_points(**changes: object) -> list[Point]:
    return [a_point(0.001, 0.12, **changes), a_point(0.002, 0.14, **changes)]


def lines(problem: Problem, fraction: float = 0.15, **changes: object) -> list[str]:
    points = two_points(**changes)
    return warnings_of(problem, fraction, points, motor(problem, fraction, points), Check(32, 0, 0.0))


# the structure of today


@pytest.mark.parametrize("ratio", [0.5, 0.93, 1.0, 1.06, 1.7])
def test_the_amplitude_without_the_damper_is_that_of_an_integration(ratio: float) -> None:
    mass, own, zeta, support = 3.0, 2.0 * math.pi * 8.0, 0.03, 0.002
    stiffness, damping, omega = mass * own**2, 2.0 * zeta * mass * own, ratio * own

    def slope(t: float, y: np.ndarray) -> list[float]:
        u, rate = support * math.sin(omega * t), support * omega * math.cos(omega * t)
        return [y[1], (-stiffness * (y[0] - u) - damping * (y[1] - rate)) / mass]

    period = 2.0 * math.pi / omega
    end = 12.0 / (zeta * own) + period
    last = np.linspace(end - period, end, 721)
    y = solve_ivp(slope, (0.0, end), [0.0, 0.0], t_eval=last, rtol=1e-9, atol=1e-12).y
    found = bare_amplitude(mass, stiffness, damping, support, omega / (2.0 * math.pi))
    assert found == pytest.approx(0.5 * np.ptp(y[0]), rel=1e-4)


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


@given(st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8), st.sampled_from([None, (7.2, 7.2), (6.8, 7.6)]),
       st.floats(0.0, 1.0))  # fmt: skip
def test_no_structure_of_the_box_moves_beyond_the_range_without_the_damper(
    box: list[float], given_range: tuple[float, float] | None, share: float
) -> None:
    problem = floor(excitation_frequency=given_range)
    low, high = bare_range(problem, 0.15, 0.002)
    frequency = None if given_range is None else given_range[0] + share * (given_range[1] - given_range[0])
    found = case(problem, 0.15, deviation(problem, np.array(box)), frequency=frequency).bare(0.002)
    assert 0.999 * low <= found <= 1.001 * high


# the machine's frequency


def test_a_stated_frequency_stays_where_the_structure_moves() -> None:
    problem = floor(excitation_frequency=(7.0, 7.0))
    for off in (NOMINAL, Deviation(frequency=0.02, mass=0.02)):
        assert scene_of(problem, 0.15, 0.002, 0.2, off, 7.0).frequency_hz == pytest.approx(7.0)
    assert scene_of(problem, 0.15, 0.002, 0.2, Deviation(detuning=0.005), 7.0).frequency_hz == pytest.approx(7.035)
    assert mapping_of(problem, 0.15, 0.002)["excitation"]["frequency"] == "resonance"


def test_the_frequencies_of_a_range_hold_its_ends_and_lie_close() -> None:
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


# motor and contact


def test_screw_gear_and_power() -> None:
    problem = floor(motor_speed=1500.0)
    made = motor(problem, 0.15, two_points(mean_force=30.0, height_error=0.0007, floor_force=900.0))
    turns = 1500.0 / 60.0
    assert made.gear >= 1.0
    assert made.gear * made.speed == pytest.approx(turns * made.lead)  # the ceiling has its speed at the motor's
    smaller = max((lead for lead in (1.5e-3, 2e-3, 3e-3, 4e-3, 5e-3) if lead < made.lead), default=0.0)
    assert smaller * turns < made.speed  # no smaller lead would do
    assert made.power == pytest.approx(30.0 * made.speed / 0.3)
    assert made.screw_torque * 2.0 * math.pi * 0.3 == pytest.approx(30.0 * made.lead)
    assert (made.height_error, made.floor_force) == (0.0007, 900.0)
    assert made.impacts_a_day == pytest.approx(13.0 * 86400.0)


def test_the_peak_pressure_is_that_of_a_hertzian_impact() -> None:
    # a sphere of 0.1 m, 7e10 Pa and 0.2 on a wall of the same: F = 3/2 p0 pi a^2 with a^2 = R times the depth
    problem, radius, force = floor(young_modulus=7e10), 0.1, 1e4
    modulus = 7e10 / (2.0 * (1.0 - 0.2**2))
    depth = (force / (4.0 / 3.0 * modulus * math.sqrt(radius))) ** (2.0 / 3.0)
    assert peak_pressure(problem, force, radius) == pytest.approx(1.5 * force / (math.pi * radius * depth), rel=1e-9)
    assert contact_time(case(problem, 0.15).damper.system, 1e9, 1.0) > 0.0


# a tuned mass


def test_in_a_band_the_tuned_mass_is_better_there_than_the_one_for_any_frequency() -> None:
    anywhere, band = optimised(0.1, 0.012), (0.97, 1.03)
    there = optimised(0.1, 0.012, band)
    assert TunedBeam(0.1, 0.012, there).peak(band) < 0.8 * TunedBeam(0.1, 0.012, anywhere).peak(band)
    dense = TunedBeam(0.1, 0.012, there).beam(np.linspace(*band, 2001))
    assert dense.max() == pytest.approx(TunedBeam(0.1, 0.012, there).peak(band), rel=1e-6)


def test_the_rows_beside_a_tuned_mass() -> None:
    problem = floor(gravity=0.0, excitation_frequency=(7.2, 7.2))
    points = two_points(frequency=7.2)
    made = compare(problem, 0.15, points)
    assert made.mass == pytest.approx(grain_mass(problem, 0.15))
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


# invalid input


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"young_modulus": 2.1e8},
            ["--young-modulus: 2.1e+08 Pa is the thesis's contact, not", "e = 0.15"],
        ),
        ({"young_modulus": 1e9}, ["--young-modulus: 1e+09 Pa is not that of steel", "forces about 8.4 times"]),
        ({"density": 1410.0}, ["--young-modulus: 2.1e+11 Pa is not that of pom"]),
        ({"yield_strength": 1e6}, ["contact: peak pressure", "1.6 MPa: walls and grain are dented"]),
        ({"motor_speed": 10.0}, ["motor: ", "needs a gear that makes it faster", "--motor-speed"]),
    ],
)
def test_what_does_not_fit_is_named(options: dict[str, object], words: list[str]) -> None:
    assert lines(floor()) == []
    found = lines(floor(**options))
    assert len(found) == 1
    assert all(word in found[0] for word in words), found


def test_density_and_modulus_of_one_material_are_not_named() -> None:
    for density, modulus in ((7850.0, 2.1e11), (1200.0, 2.1e8), (1400.0, 3e9), (2700.0, 7e10), (11340.0, 1.6e10)):
        assert lines(floor(density=density, young_modulus=modulus)) == []


def test_friction_on_a_side_wall_and_a_container_that_turns_are_named() -> None:
    # 1 mm of the support moves the closed damper by 13 mm at 13 Hz: 86.7 m/s^2
    assert lines(floor(gravity=0.0, side_friction=0.04)) == []
    (line,) = lines(floor(gravity=0.0))
    assert line.startswith("side wall: at ±1, ±2 mm friction decelerates the grain by up to 0.034 of")
    assert "--side-friction" in line
    assert lines(floor(slope=2.2)) == []
    (line,) = lines(floor(slope=4.0))
    assert line.startswith("slope: the closed damper would turn the container by 0.052 rad (limit 0.03)")


def test_motions_and_grains_that_cannot_be() -> None:
    # 79 mm at 29.4 Hz: 275 g
    (line,) = lines(floor(), closed_amplitude=0.079, frequency=29.4)
    assert line.startswith("structure: a support of ±2 mm would move it by ±79 mm undamped, 275 g and 15 m/s")
    assert "--amplitudes in metres" in line
    (line,) = lines(floor(max_mass_fraction=0.5), fraction=0.4)
    assert line.startswith("grain: it weighs 67 % of the structure")


# the page and the scene


@cache
def a_design(given_range: tuple[float, float] | None, gravity: float = 9.81) -> Design:
    problem = floor(excitation_frequency=given_range, gravity=gravity)
    fraction, points = 0.15, two_points(frequency=7.2, acceleration=math.inf)
    grain = grain_mass(problem, fraction), grain_radius(problem, fraction)
    trade = Candidate(fraction, *grain, points[0].efficiency, (0.12, 0.14), 100.0, reduction=points[0].reduction)
    curve = np.linspace(0.5, 0.2, 5)
    return Design(
        problem=problem, candidates=[trade], mass_fraction=fraction, grain_mass=grain[0],
        radius=grain[1], resonance=resonance(problem, fraction), points=points, beyond=[],
        motor=motor(problem, fraction, points), check=Check(32, 0, 0.0),
        landscape=Landscape(0.001, np.linspace(0.1, 0.2, 5), curve, np.tile(curve[:, None], 16)),
        tuned_mass=compare(problem, fraction, points), warnings=lines(problem), wall_s=1.0,
    )  # fmt: skip


def test_numbers_of_today_stand_wherever_the_efficiency_does() -> None:
    made = a_design((7.2, 7.2))
    plain = made.to_json()
    assert plain["reduction"] == {"low": 0.45, "high": 0.55}
    assert set(plain["points"][0]["bare_amplitude"]) == set(plain["points"][0]["reduction"]) == {
        "expected", "low", "high",
    }  # fmt: skip
    assert plain["points"][0]["beam_acceleration"]["high"] == pytest.approx((2.0 * math.pi * 7.2) ** 2 * 0.0025)
    assert plain["points"][0]["over_frequency"] == [
        {"frequency": 13.0, "amplitude": 0.002, "bare": 0.004, "reduction": 0.5}
    ]
    assert plain["tuned_mass"]["rows"][2]["bare"] == pytest.approx(0.0834, abs=1e-4)
    assert plain["bare_resonance_amplitude"] == pytest.approx(0.002 * math.hypot(1.0, 0.024) / 0.024)


@pytest.mark.slow
def test_the_page_of_a_horizontal_structure() -> None:
    made = a_design((7.2, 7.2), 0.0)
    text = page(made)
    assert ">inf" not in text
    assert "<th></th>" not in text
    assert text.count('class="scroll" role="region" tabindex="0" aria-label=') == text.count('class="scroll"') == 3
    for words in (
        "The grain moves the resonance from 7.20 to 6.64 Hz", "7/5 of its inertia", "Beside a tuned mass",
        "Reduction", "force on the floor", "held at rest", "costs two points of reduction", "<svg",
        f"grain of {2e3 * made.radius:.1f} mm diameter", "140.0 mm, highest", "impacts",
    ):  # fmt: skip
        assert words.lower() in text.lower(), words
    table = text[text.index(">structure [mm]") :]
    assert table.index("reduction [%]") < table.index("efficiency [%]")


@pytest.mark.parametrize(("given_range", "written"), [(None, "resonance"), ((7.2, 7.2), 7.2), ((6.8, 7.6), "drifts")])
def test_the_scene_has_the_stands_noise_and_the_machines_frequency(
    given_range: tuple[float, float] | None, written: object
) -> None:
    made = a_design(given_range)
    mapping = scene_mapping(made)
    assert mapping["sensors"]["laser"]["noise"] == 2e-5
    shown = [[0.0, 6.8], [mapping["duration"], 7.6]] if written == "drifts" else written
    assert mapping["excitation"]["frequency"] == shown
    assert mapping["container"] == {"side_friction": 0.3, "slope": 0.0}
    del mapping["ceiling"]["map"]
    mapping["ceiling"] |= {"controller": "direct"}
    scene = scene_from_mapping(mapping, source="design")
    assert height_map(made, scene).heights.shape == (1, 2)
    assert reduced_mass(case(made.problem, 0.15).damper.system) > 0.0
