# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant block by block and as a stream: refusals, ends, small moves, crushes; samples, stamps, noise, rates."""

import math
import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_refusals import refused

from atpid_sim.outcome import NumericalFailure
from atpid_sim.plant.plant import Plant, PlantBlock, PlantError
from atpid_sim.plant.stream import Stream, StreamBlock, StreamError, common_rate, stamp_ns
from atpid_sim.scene import Scene, scene_from_mapping, standard_bench
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
    with refused(PlantError, "simplified", "0.3 m", "0.017 m"):
        plant.advance(2000, RATE, 0.3, 0.3)
    for ceiling in ({"height": 0.3}, {"closed": CLOSED, "open": 0.2, "start": 1.0, "end": 2.0}):
        with refused(PlantError, "simplified"):
            Plant(scene(ceiling=ceiling), "simplified")
    with refused(PlantError, "'exact'", "auto", "simplified", "impact", "finite", "soft"):
        Plant(scene(), "exact")
    held = plant.advance(2000, RATE, 0.3, 0.0).beam
    exact = Plant(scene(), "soft").advance(4000, RATE, CLOSED, 0.0).beam
    assert np.concatenate([closed, held]) == pytest.approx(exact, abs=1e-3)


# where it ends
def test_no_sample_lies_beyond_the_end_of_the_drive() -> None:
    plant = Plant(scene())
    plant.advance(4990, RATE, CLOSED, 0.0)
    with refused(PlantError, "11", "4.99 s", "10"):
        plant.advance(11, RATE, CLOSED, 0.0)
    assert (plant.advance(10, RATE, CLOSED, 0.0).beam != 0.0).all()
    with refused(PlantError, "1", "0"):
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
    ("name", "values", "allowed"),
    [
        ("duration_ticks", (0, -5), "1"),
        ("rate", (0.0, -1000.0, math.nan, math.inf), "finite"),
        ("rate", (2000.0,), "1000 Hz"),
        ("target", (math.nan, math.inf, -math.inf, -0.1), "finite"),
        ("speed", (math.nan, math.inf, -0.3), "finite"),
    ],
)
def test_what_cannot_be_done_is_refused_and_changes_nothing(name: str, values: tuple[float, ...], allowed: str) -> None:
    usual: dict[str, Any] = {"duration_ticks": 50, "rate": RATE, "target": 0.2, "speed": 0.3}
    plant, other = standing(ticks=200), standing(ticks=200)
    for value in values:
        with refused(PlantError, name, f"{value:g}", allowed):
            plant.advance(**usual | {name: value})
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


@pytest.mark.parametrize("speed", [5e-324, 1e-300, 1e6, 1e300])
def test_a_ceiling_of_any_speed_opens(speed: float) -> None:
    plant = standing(CLOSED)
    plant.advance(50, RATE, 0.3, speed)
    assert plant.height == (0.3 if speed > 1.0 else CLOSED)


# failures
@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_a_ceiling_that_crushes_is_named_where_and_when_it_does(fidelity: str) -> None:
    plant = standing(0.1, ticks=50, fidelity=fidelity)
    with pytest.raises(NumericalFailure, match=r"closer.*diameter") as failure:
        plant.advance(1000, RATE, 0.0, 0.3)
    at, height = (float(text) for text in re.findall(r"at (\S+) s.*ceiling (\S+) m", str(failure.value))[0])
    assert at == pytest.approx(0.05 + (0.1 - CLOSED) / 0.3, abs=1e-3)
    assert height == pytest.approx(CLOSED, abs=0.3 * 1e-3)
    assert plant.time == pytest.approx(at, abs=1e-6)
    assert plant.height == pytest.approx(height, rel=1e-5)
    stopped = plant.time, plant.height
    for _ in range(2):  # it does not go on
        with refused(NumericalFailure, str(failure.value)):
            plant.advance(50, RATE, CLOSED, 0.0)
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


CONTROLLED = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}


class Ramp:
    """A plant whose every signal is its time, and that records what each advance is given."""

    def __init__(self) -> None:
        self.height, self.ticks = 0.017, 0
        self.advances: list[tuple[int, float, float, float]] = []

    def advance(self, duration_ticks: int, rate: float, target: float, speed: float) -> SimpleNamespace:
        time = (self.ticks + np.arange(duration_ticks)) / rate
        self.ticks += duration_ticks
        self.advances.append((duration_ticks, rate, target, speed))
        self.height = target if speed else self.height
        return SimpleNamespace(support=time, beam=-time, beam_acceleration=2.0 * time, ceiling=time, grain=time)


def ramp_stream(plant: Ramp | None = None, **changes: Any) -> Stream:
    return Stream(standard_bench(**({"ceiling": CONTROLLED, "duration": 0.22} | changes)), plant or Ramp())


def blocks(source: Stream) -> Iterator[StreamBlock]:
    while not source.finished:
        yield source.advance(0.017, 0.0)


def test_blocks_follow_each_other_without_a_gap_and_the_last_is_shorter() -> None:
    source = ramp_stream()
    found = list(blocks(source))
    assert [block.first_index for block in found] == [0, 50, 100, 150, 200]
    assert [block.scans for block in found] == [50, 50, 50, 50, 20]
    assert source.finished
    readings = np.concatenate([block.readings[0].data for block in found])
    assert readings[:, 0] == pytest.approx(np.arange(220) / 1000.0)
    assert readings[:, 1] == pytest.approx(-np.arange(220) / 1000.0)
    with refused(StreamError, "0.22 s", "5"):
        source.advance(0.017, 0.0)


def test_a_second_sensor_has_its_own_rate_on_a_common_clock() -> None:
    sensors = {"laser": {"rate": 1000.0}, "accelerometer": {"rate": 1600.0}}
    source = ramp_stream(sensors=sensors)
    assert source.rate == 8000.0
    found = list(blocks(source))
    acceleration = np.concatenate([block.readings[1].data[:, 0] for block in found])
    assert acceleration == pytest.approx(2.0 * np.arange(len(acceleration)) / 1600.0)
    assert [block.readings[1].first_index for block in found] == [0, 80, 160, 240, 320]
    assert found[1].truth_series("beam") == pytest.approx(-np.arange(50, 100) / 1000.0)


def test_rates_without_a_common_clock_are_refused() -> None:
    assert common_rate([1000.0, 12_800.0]) == 64_000.0
    with refused(StreamError, "1000", "1613.1"):
        common_rate([1000.0, 1613.1])


def test_noise_repeats_with_the_seed_and_differs_between_channels_and_blocks() -> None:
    noisy: dict[str, Any] = {"sensors": {"laser": {"noise": 1e-3}}, "seed": 5}
    first, again = ([b.readings[0].data for b in blocks(ramp_stream(**noisy))] for _ in range(2))
    other = [b.readings[0].data for b in blocks(ramp_stream(**(noisy | {"seed": 6})))]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    noise = first[0] - np.stack([np.arange(50), -np.arange(50)], axis=1) / 1000.0
    assert not np.allclose(noise[:, 0], noise[:, 1])
    assert 0.5e-3 < noise.std() < 2e-3


def test_what_saturates_cannot_be_read() -> None:
    found = list(blocks(ramp_stream(sensors={"laser": {"saturation": [-0.1, 0.05]}})))
    readings = np.concatenate([block.readings[0].data for block in found])
    time = np.arange(220) / 1000.0
    assert np.array_equal(np.isnan(readings[:, 0]), time > 0.05)
    assert np.array_equal(np.isnan(readings[:, 1]), time > 0.1)


def test_a_target_just_below_closed_is_closed_and_an_invalid_one_reaches_the_plant() -> None:
    plant = Ramp()
    source = ramp_stream(plant)
    for target in (0.3, 0.0169, -math.inf, math.nan):
        source.advance(target, 0.25)
    assert plant.advances[0] == (50, 1000.0, 0.3, 0.25)
    given = [target for _, _, target, _ in plant.advances]
    assert given[1:3] == [0.017, -math.inf]
    assert math.isnan(given[3])


def test_a_prescribed_ceiling_ignores_its_target() -> None:
    plant = Ramp()
    ceiling = {"closed": 0.017, "open": 0.117, "start": 0.05, "end": 0.15}
    list(blocks(ramp_stream(plant, ceiling=ceiling)))
    assert [round(height, 6) for _, _, height, _ in plant.advances] == [0.017, 0.067, 0.117, 0.117, 0.117]
    assert [round(speed, 6) for *_, speed in plant.advances] == [0.0, 1.0, 1.0, 0.0, 0.0]


def test_stamps_are_rounded_once_and_never_drift() -> None:
    assert stamp_ns(0, 0, 1000.0) == 0
    assert stamp_ns(5, 3_000_000_001, 1000.0) == 5 + 3_000_000_001_000_000
    assert stamp_ns(0, 3 * 10**12, 3.0) == 10**21
