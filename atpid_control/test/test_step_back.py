# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The step back: only when the height is to blame, never below the lowest, never back up while it is remembered."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.loop.hold import HoldError, StepBack, StepBackMonitor

SETTINGS = StepBack(settle_count=4, rumble_count=3)
LOWEST = 0.017
heights = st.floats(LOWEST, 2.0)
amplitudes = st.floats(1e-3, 0.1)


def retreat(**changes: float) -> StepBackMonitor:
    return StepBackMonitor(StepBack(**(vars(SETTINGS) | changes)), LOWEST)


def steps(machine: StepBackMonitor, swings: Sequence[float], expected: float = 0.1, standing: bool = True) -> list[int]:
    """Return at which of the estimates it is time for a step."""
    return [k for k, swing in enumerate(swings) if machine.watch(swing, expected, standing)]


@given(heights, amplitudes, st.integers(1, 200))
def test_every_step_goes_down_and_none_below_the_lowest(height: float, amplitude: float, count: int) -> None:
    machine = retreat()
    for _ in range(count):
        lower = machine.lower(height, amplitude)
        assert LOWEST <= lower <= height
        assert lower < height or height - LOWEST < 1e-12
        height = lower


@given(heights, amplitudes, st.integers(1, 10), st.floats(-0.049, 0.049))
def test_a_selection_for_nearly_the_same_amplitude_does_not_go_back_up(
    height: float, amplitude: float, count: int, change: float
) -> None:
    machine, lower = retreat(), height
    for _ in range(count):
        lower = machine.lower(lower, amplitude)
    assert machine.allowed(height, amplitude * (1.0 + change)) == pytest.approx(lower, rel=1e-9)


@given(heights, amplitudes, st.floats(0.06, 2.0))
def test_another_excitation_ends_it(height: float, amplitude: float, change: float) -> None:
    machine = retreat()
    machine.lower(height, amplitude)
    assert machine.allowed(height, amplitude * (1.0 + change)) == height
    assert machine.allowed(height, amplitude) == height


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), max_size=60))
def test_without_a_rumble_or_with_a_beam_as_expected_it_never_steps(estimates: list[tuple[float, bool]]) -> None:
    calm, shaken = retreat(), retreat()
    for swing, standing in estimates:
        assert not calm.watch(swing, 0.1, standing)
        shaken.on_event("calm")
        shaken.on_event("rumble")
        assert not shaken.watch(0.1149 * swing, 0.1, True)


def test_the_ceiling_has_to_stand_and_the_beam_to_have_settled() -> None:
    machine = retreat()
    machine.on_event("rumble")
    assert steps(machine, [0.15] * 50, standing=False) == []
    assert steps(machine, [0.15] * 7) == [6]  # 4 to settle, 3 that count


def test_while_it_fades_the_count_is_held() -> None:
    machine = retreat(settle_count=0, rumble_count=12)
    machine.on_event("rumble")
    swelling, fading = [0.15 + 0.01 * k for k in range(8)], [0.2 - 0.01 * k for k in range(5)]
    assert steps(machine, swelling) == []
    assert steps(machine, fading) == []
    assert steps(machine, [0.2] * 12)


def test_short_bursts_that_come_back_are_a_rumble() -> None:
    machine = retreat(rumble_count=50)
    steps(machine, [0.1] * 10)
    for burst in range(2):
        assert steps(machine, [0.15, 0.16]) == []
        machine.on_event("rumble")
        assert bool(steps(machine, [0.12, 0.1])) == (burst == 1)
        machine.on_event("calm")


@pytest.mark.parametrize(
    ("name", "value"),
    [("step_back", 0.0), ("step_back", 1.0), ("rumble_count", 0), ("settle_count", -1), ("step_back_excess", -0.1),
     ("step_back_memory", math.nan)],
)  # fmt: skip
def test_contradictory_settings_are_refused_in_one_line(name: str, value: float) -> None:
    with pytest.raises(HoldError, match=rf"^{name}: given .*; allowed: "):
        retreat(**{name: value})
