# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant block by block: what it refuses, where it ends, moves too small for the clock, a ceiling that crushes."""

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.plant.plant import Plant, PlantBlock, PlantError
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.simulate import simulate

CLOSED, RATE = 0.017, 1000.0
SCENE: dict[str, Any] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"amplitude": 0.01, "frequency": "resonance"},
    "ceiling": {"closed": CLOSED, "range": [CLOSED, 1.0], "speed": 0.3, "controller": "lookup"},
    "gravity": 9.81,
    "duration": 5.0,
    "tolerance": 1e-6,
}
INSTANT = {"law": "impact", "restitution": 0.5}


def scene(**changes: Any) -> Scene:
    return scene_from_mapping(SCENE | changes)


def standing(height: float = 0.3, ticks: int = 2000, fidelity: str = "auto") -> Plant:
    plant = Plant(scene(ceiling={"height": height}), fidelity)
    plant.advance(ticks, RATE, height, 0.0)
    return plant


def energy_gap(block: PlantBlock) -> float:
    return block.stored_energy - (block.input_energy - block.beam_loss - block.contact_loss + block.ceiling_work)


def test_blocks_of_any_length_make_the_same_motion() -> None:
    whole = Plant(scene()).advance(2000, RATE, 0.2, 0.3).beam
    plant = Plant(scene())
    parts = np.concatenate([plant.advance(n, RATE, 0.2, 0.3).beam for n in (1, 49, 750, 1200)])
    assert plant.height == 0.2
    assert parts == pytest.approx(whole, abs=1e-6)


# fidelity levels


def test_a_simplified_plant_refuses_an_open_ceiling() -> None:
    plant = Plant(scene(), "simplified")
    closed = plant.advance(2000, RATE, CLOSED, 0.3).beam
    with pytest.raises(PlantError, match=r"^fidelity simplified: given a ceiling at 0\.3 m; allowed: .*\(0\.017 m\)"):
        plant.advance(2000, RATE, 0.3, 0.3)
    held = plant.advance(2000, RATE, 0.3, 0.0).beam
    exact = Plant(scene(), "soft").advance(4000, RATE, CLOSED, 0.0).beam
    assert np.concatenate([closed, held]) == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize("ceiling", [{"height": 0.3}, {"closed": CLOSED, "open": 0.2, "start": 1.0, "end": 2.0}])
def test_a_simplified_plant_refuses_a_scene_that_is_not_closed(ceiling: dict[str, float]) -> None:
    with pytest.raises(PlantError, match="fidelity simplified"):
        Plant(scene(ceiling=ceiling), "simplified")


def test_the_default_fidelity_follows_any_ceiling_with_any_law() -> None:
    for contact in (SCENE["contact"], INSTANT):
        plant = Plant(scene(contact=contact))
        assert plant.advance(2000, RATE, 0.1, 0.3).impacts > 3
        assert plant.height == 0.1


def test_an_unknown_fidelity_is_refused() -> None:
    with pytest.raises(PlantError, match="fidelity 'exact': allowed are auto, simplified, impact, finite, soft"):
        Plant(scene(), "exact")


# where it ends


def test_no_sample_lies_beyond_the_end_of_the_drive() -> None:
    plant = Plant(scene())
    with pytest.raises(PlantError, match=r"given 5001 at 0 s; allowed: at most 5000, the scene's drive ends at 5 s"):
        plant.advance(5001, RATE, CLOSED, 0.0)
    plant.advance(4990, RATE, CLOSED, 0.0)
    with pytest.raises(PlantError, match=r"given 11 at 4\.99 s; allowed: at most 10"):
        plant.advance(11, RATE, CLOSED, 0.0)
    assert (plant.advance(10, RATE, CLOSED, 0.0).beam != 0.0).all()
    with pytest.raises(PlantError, match="at most 0"):
        plant.advance(1, RATE, CLOSED, 0.0)


@pytest.mark.parametrize("duration", [0.1, 0.1004, 0.1005, 0.1006, 0.10075])
@pytest.mark.parametrize("excitation", [SCENE["excitation"], {"free": {"deflection": 0.1}}])
def test_a_stream_of_any_duration_has_no_sample_beyond_the_end(duration: float, excitation: dict[str, Any]) -> None:
    sensors = {"laser": {"rate": 1000.0}, "accelerometer": {"rate": 8000.0}}
    given = scene(duration=duration, excitation=excitation, sensors=sensors)
    source = Stream(given, Plant(given))
    found = []
    while not source.finished:
        found.append(source.advance(CLOSED, 0.0))
    time = np.concatenate([block.truth.time for block in found])
    assert time[-1] < duration
    assert (np.concatenate([block.truth.beam for block in found]) != 0.0).all()
    assert sum(block.scans for block in found) == source.computed_scans == round(duration * 1000.0)


# what is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration_ticks": 0}, r"^duration_ticks: given 0; allowed: 1 or more"),
        ({"duration_ticks": -5}, r"^duration_ticks: given -5"),
        ({"rate": 0.0}, r"^rate: given 0 Hz; allowed: finite and above 0$"),
        ({"rate": -1000.0}, r"^rate: given -1000 Hz"),
        ({"rate": math.nan}, r"^rate: given nan Hz"),
        ({"rate": math.inf}, r"^rate: given inf Hz"),
        ({"rate": 2000.0}, r"^rate: given 2000 Hz; allowed: that of the first advance, 1000 Hz$"),
        ({"target": math.nan}, r"^target: given nan m; allowed: finite and not negative$"),
        ({"target": math.inf}, r"^target: given inf m"),
        ({"target": -math.inf}, r"^target: given -inf m"),
        ({"target": -0.1}, r"^target: given -0\.1 m"),
        ({"speed": math.nan}, r"^speed: given nan m/s; allowed: finite and not negative$"),
        ({"speed": math.inf}, r"^speed: given inf m/s"),
        ({"speed": -0.3}, r"^speed: given -0\.3 m/s"),
    ],
)
def test_what_a_plant_cannot_do_is_refused_and_changes_nothing(changes: dict[str, float], message: str) -> None:
    usual: dict[str, Any] = {"duration_ticks": 50, "rate": RATE, "target": 0.2, "speed": 0.3}
    plant, other = standing(ticks=200), standing(ticks=200)
    with pytest.raises(PlantError, match=message):
        plant.advance(**usual | changes)
    assert np.array_equal(plant.advance(**usual).beam, other.advance(**usual).beam)


# small moves


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
@given(digits=st.sampled_from([1, 2, 10, 1e3, 1e5, 1e8]), speed=st.sampled_from([1e-6, 0.3, 10.0]), up=st.booleans())
def test_a_move_of_a_few_digits_is_made(fidelity: str, digits: float, speed: float, up: bool) -> None:
    plant = standing(0.1, fidelity=fidelity)
    target = 0.1 + (1.0 if up else -1.0) * digits * math.ulp(0.1)
    block = plant.advance(50, RATE, target, speed)
    assert plant.height == target, "all of these are reached in 50 ms"
    assert abs(energy_gap(block)) < 1e-5 * block.input_energy


def test_a_move_by_the_next_number_is_made() -> None:
    plant = standing(0.3)
    above = math.nextafter(0.3, 1.0)
    assert plant.advance(50, RATE, above, 0.3).outcome is Outcome.DONE
    assert plant.height == above


@pytest.mark.parametrize("speed", [5e-324, 1e-300, 1e6, 1e300])
def test_a_ceiling_of_any_speed_opens(speed: float) -> None:
    plant = standing(CLOSED)
    plant.advance(50, RATE, 0.3, speed)
    assert plant.height == (0.3 if speed > 1.0 else CLOSED)


# failures


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_a_ceiling_that_crushes_is_named_where_and_when_it_does(fidelity: str) -> None:
    plant = standing(0.1, ticks=50, fidelity=fidelity)
    with pytest.raises(NumericalFailure, match="came closer than the grain's diameter") as failure:
        plant.advance(1000, RATE, 0.0, 0.3)
    at, height = (float(text) for text in re.findall(r"at (\S+) s.*ceiling (\S+) m", str(failure.value))[0])
    assert at == pytest.approx(0.05 + (0.1 - CLOSED) / 0.3, abs=1e-3)
    assert height == pytest.approx(CLOSED, abs=0.3 * 1e-3)
    assert plant.time == pytest.approx(at, abs=1e-6)
    assert plant.height == pytest.approx(height, rel=1e-5)


def test_the_message_of_a_failure_gives_the_ceiling_at_that_moment() -> None:
    plant = standing(0.3)
    with pytest.raises(NumericalFailure, match="deeper into a wall") as failure:
        plant.advance(50, RATE, CLOSED, 1000.0)
    at, height = (float(text) for text in re.findall(r"at (\S+) s.*ceiling (\S+) m", str(failure.value))[0])
    assert height == pytest.approx(0.3 - 1000.0 * (at - 2.0), abs=1000.0 * 1e-6)


def test_after_a_failure_the_plant_does_not_go_on() -> None:
    plant = standing(0.3)
    with pytest.raises(NumericalFailure) as first:
        plant.advance(50, RATE, CLOSED, 1000.0)
    stopped = plant.time, plant.height
    for _ in range(2):
        with pytest.raises(NumericalFailure) as again:
            plant.advance(50, RATE, CLOSED, 0.0)
        assert str(again.value) == f"the plant cannot go on, make a new one: {first.value}"
    assert (plant.time, plant.height) == stopped


@pytest.mark.parametrize(("tolerance", "fidelity"), [(1e-6, "soft"), (1e-2, "impact")])
def test_tolerance_and_auto_mean_what_they_mean_in_simulate(tolerance: float, fidelity: str) -> None:
    opened = scene(ceiling={"height": 0.2}, tolerance=tolerance)
    plant, result = Plant(opened), simulate(opened, check=False)
    assert plant.integration.fidelity == result.fidelity == fidelity
    assert plant.integration.rtol == result.rtol == pytest.approx(0.3 * tolerance)


def test_auto_allows_for_a_ceiling_that_opens() -> None:
    closed = scene(ceiling={"height": CLOSED}, tolerance=1e-1)
    assert simulate(closed, check=False).fidelity == "simplified"
    plant = Plant(closed)
    plant.advance(100, RATE, 0.2, 0.3)
    assert plant.integration.fidelity == "impact"
    assert plant.height > CLOSED
