# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream of blocks: whole samples, exact stamps, noise that repeats, sensors with rates of their own."""

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from atpid_sim.plant.stream import Stream, StreamBlock, StreamError, common_rate, stamp_ns
from atpid_sim.scene import standard_bench

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


def stream(plant: Ramp | None = None, **changes: Any) -> Stream:
    return Stream(standard_bench(**({"ceiling": CONTROLLED, "duration": 0.22} | changes)), plant or Ramp())


def blocks(source: Stream) -> Iterator[StreamBlock]:
    while not source.finished:
        yield source.advance(0.017, 0.0)


def test_blocks_follow_each_other_without_a_gap_and_the_last_is_shorter() -> None:
    source = stream()
    found = list(blocks(source))
    assert [block.first_index for block in found] == [0, 50, 100, 150, 200]
    assert [block.scans for block in found] == [50, 50, 50, 50, 20]
    assert source.finished
    readings = np.concatenate([block.readings[0].data for block in found])
    assert readings[:, 0] == pytest.approx(np.arange(220) / 1000.0)
    assert readings[:, 1] == pytest.approx(-np.arange(220) / 1000.0)


def test_there_is_no_block_after_the_last() -> None:
    source = stream()
    list(blocks(source))
    with pytest.raises(StreamError, match=r"run of 0\.22 s is over: its 5 blocks are computed"):
        source.advance(0.017, 0.0)


def test_a_faster_sensor_stops_where_the_scene_does() -> None:
    sensors = {"laser": {"rate": 1000.0}, "accelerometer": {"rate": 8000.0}}
    source = stream(sensors=sensors, duration=0.2206)
    readings = [block.readings for block in blocks(source)]
    assert sum(len(laser.data) for laser, _ in readings) == source.computed_scans == 221
    assert sum(len(second.data) for _, second in readings) == 1765  # the last at 0.2205 s


def test_a_second_sensor_has_its_own_rate_on_a_common_clock() -> None:
    sensors = {"laser": {"rate": 1000.0}, "accelerometer": {"rate": 1600.0}}
    source = stream(sensors=sensors)
    assert source.rate == 8000.0
    found = list(blocks(source))
    acceleration = np.concatenate([block.readings[1].data[:, 0] for block in found])
    assert acceleration == pytest.approx(2.0 * np.arange(len(acceleration)) / 1600.0)
    assert [block.readings[1].first_index for block in found] == [0, 80, 160, 240, 320]
    assert found[1].truth_series("beam") == pytest.approx(-np.arange(50, 100) / 1000.0)


def test_rates_without_a_common_clock_are_refused() -> None:
    assert common_rate([1000.0, 12_800.0]) == 64_000.0
    with pytest.raises(StreamError, match=r"given rates 1000, 1613\.1 Hz"):
        common_rate([1000.0, 1613.1])


def test_noise_repeats_with_the_seed_and_differs_between_channels_and_blocks() -> None:
    noisy: dict[str, Any] = {"sensors": {"laser": {"noise": 1e-3}}, "seed": 5}
    first, again = ([b.readings[0].data for b in blocks(stream(**noisy))] for _ in range(2))
    other = [b.readings[0].data for b in blocks(stream(**(noisy | {"seed": 6})))]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    noise = first[0] - np.stack([np.arange(50), -np.arange(50)], axis=1) / 1000.0
    assert not np.allclose(noise[:, 0], noise[:, 1])
    assert 0.5e-3 < noise.std() < 2e-3


def test_what_saturates_cannot_be_read() -> None:
    found = list(blocks(stream(sensors={"laser": {"saturation": [-0.1, 0.05]}})))
    readings = np.concatenate([block.readings[0].data for block in found])
    time = np.arange(220) / 1000.0
    assert np.array_equal(np.isnan(readings[:, 0]), time > 0.05)
    assert np.array_equal(np.isnan(readings[:, 1]), time > 0.1)


def test_a_controlled_ceiling_follows_its_target() -> None:
    plant = Ramp()
    stream(plant).advance(0.3, 0.25)
    assert plant.advances == [(50, 1000.0, 0.3, 0.25)]


def test_a_target_just_below_closed_is_closed_and_an_invalid_one_reaches_the_plant() -> None:
    plant = Ramp()
    source = stream(plant)
    for target in (0.0169, -math.inf, math.nan):
        source.advance(target, 0.25)
    given = [target for _, _, target, _ in plant.advances]
    assert given[:2] == [0.017, -math.inf]
    assert math.isnan(given[2])


def test_a_prescribed_ceiling_ignores_its_target() -> None:
    plant = Ramp()
    ceiling = {"closed": 0.017, "open": 0.117, "start": 0.05, "end": 0.15}
    list(blocks(stream(plant, ceiling=ceiling)))
    assert [round(height, 6) for _, _, height, _ in plant.advances] == [0.017, 0.067, 0.117, 0.117, 0.117]
    assert [round(speed, 6) for *_, speed in plant.advances] == [0.0, 1.0, 1.0, 0.0, 0.0]


def test_stamps_are_rounded_once_and_never_drift() -> None:
    assert stamp_ns(0, 0, 1000.0) == 0
    assert stamp_ns(5, 3_000_000_001, 1000.0) == 5 + 3_000_000_001_000_000
    assert stamp_ns(0, 3 * 10**12, 3.0) == 10**21
