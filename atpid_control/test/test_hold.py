# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The dead band and hold: what moves the ceiling and, above all, what does not."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from atpid_control.identification import Estimate, Quality
from atpid_control.loop.controller import ProfileController, SelectingController
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import Hold, HoldError, HoldSettings
from atpid_control.loop.protocol import Controller, ControlSettings, LoopAnswer
from atpid_control.loop.step_back import StepBack
from atpid_control.selection.protocol import Excitation, Selection, SelectionError

SETTINGS: dict[str, Any] = {
    "dead_band": 0.01, "sigmas": 4.0, "steady_count": 4, "rising_count": 4, "falling_count": 2,
    "frequency": 5.49, "frequency_tolerance": 0.05,
}  # fmt: skip


def hold(**changes: Any) -> Hold:
    return Hold(HoldSettings(**(SETTINGS | changes)))


def steady(amplitude: float, std: float = 1e-6, frequency: float = 5.49) -> Estimate:
    return Estimate(quality=Quality.STEADY, amplitude=amplitude, amplitude_std=std, frequency=frequency)


def transient(amplitude: float) -> Estimate:
    return Estimate(quality=Quality.TRANSIENT, amplitude=amplitude, amplitude_std=1e-4, frequency=5.49)


def feed(machine: Hold, estimates: Sequence[Estimate]) -> list[float]:
    """Return the amplitudes acted on."""
    acted = []
    for estimate in estimates:
        verdict = machine.judge(estimate)
        if verdict.select:
            machine.acted(verdict.amplitude)
            acted.append(verdict.amplitude)
    return acted


def test_acts_once_on_a_steady_excitation_and_not_before_it_is_sure() -> None:
    machine = hold()
    assert feed(machine, [steady(0.015)] * 3) == []
    assert feed(machine, [steady(0.015)] * 100) == [0.015]
    assert machine.judge(steady(0.015)).reason == "inside dead band"


def test_noise_moves_nothing_in_ten_minutes() -> None:
    generator = np.random.default_rng(1)
    amplitudes = 0.015 * (1.0 + 0.002 * generator.standard_normal(12_000))
    machine = hold()
    assert len(feed(machine, [steady(a, 0.002 * 0.015) for a in amplitudes])) == 1


def test_a_change_must_stand_out_of_the_error_bar() -> None:
    machine = hold()
    feed(machine, [steady(0.015)] * 4)
    assert feed(machine, [steady(0.0155, std=2e-4)] * 50) == []
    assert feed(machine, [steady(0.0155, std=1e-5)] * 50) == [0.0155]


def test_a_single_rising_transient_is_not_chased_but_a_ramp_is_followed() -> None:
    machine = hold()
    feed(machine, [steady(0.015)] * 4)
    assert feed(machine, [transient(0.03), transient(0.02), transient(0.028), transient(0.021)] * 5) == []
    assert feed(machine, [transient(0.016 + 0.001 * k) for k in range(8)])


def test_differences_of_rounding_are_no_ramp_and_no_change() -> None:
    machine, noiseless = hold(), 1e-17
    feed(machine, [transient(0.00095), transient(0.00098)])
    assert feed(machine, [steady(0.001 * (1.0 + k * 2.0**-52), noiseless) for k in range(3)]) == []
    assert feed(machine, [steady(0.001, noiseless)]) == [0.001]
    for edge in (0.00101 * (1.0 - 2.0**-50), 0.00101 * (1.0 + 2.0**-50)):
        assert feed(machine, [steady(edge, noiseless)] * 8) == []


def test_the_ends_of_the_frequencies_belong_to_them_however_they_round() -> None:
    for ends in ({"reach": (5.0, 6.0)}, {"frequency": 5.5, "frequency_tolerance": 0.5 / 5.5}):
        for frequency in (5.0 * (1.0 - 1e-15), 6.0 * (1.0 + 1e-15)):
            assert hold(**ends).reason_to_reject(steady(0.015, frequency=frequency)) == ""
        assert hold(**ends).reason_to_reject(steady(0.015, frequency=4.99)) == "frequency off resonance"


def test_a_falling_excitation_is_followed_at_once() -> None:
    machine = hold()
    feed(machine, [steady(0.04)] * 4)
    assert feed(machine, [transient(0.038), transient(0.036)]) == [0.036]


@pytest.mark.parametrize(
    ("estimate", "reason"),
    [
        (Estimate(quality=Quality.NONE, amplitude=math.nan, amplitude_std=math.nan, frequency=math.nan), "no estimate"),
        (Estimate(quality=Quality.POOR, amplitude=0.015, amplitude_std=1e-3, frequency=5.49), "poor estimate"),
        (
            Estimate(quality=Quality.STEADY, amplitude=math.nan, amplitude_std=1e-6, frequency=5.49),
            "estimate is not a number",
        ),
        (
            Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=math.inf, frequency=5.49),
            "estimate is not a number",
        ),
        (
            Estimate(quality=Quality.STEADY, amplitude=-0.015, amplitude_std=1e-6, frequency=5.49),
            "amplitude is not positive",
        ),
        (
            Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-6, frequency=6.0),
            "frequency off resonance",
        ),
    ],
)
def test_an_estimate_that_cannot_be_trusted_moves_nothing(estimate: Estimate, reason: str) -> None:
    machine = hold()
    feed(machine, [steady(0.015)] * 4)
    verdict = machine.judge(estimate)
    assert (verdict.select, verdict.reason) == (False, reason)
    assert machine.acted_amplitude == 0.015


def test_trouble_interrupts_what_was_nearly_sure() -> None:
    machine = hold()
    feed(machine, [steady(0.015)] * 3)
    machine.judge(Estimate(quality=Quality.POOR, amplitude=0.015, amplitude_std=1e-3, frequency=5.49))
    assert feed(machine, [steady(0.015)] * 3) == []


@pytest.mark.parametrize(
    "changes",
    [{"dead_band": -0.1}, {"dead_band": math.nan}, {"steady_count": 0}, {"rising_count": 1}, {"frequency": math.nan}],
)
def test_contradictory_settings_are_refused_in_one_line(changes: dict[str, float]) -> None:
    with pytest.raises(HoldError, match=r"given .*; allowed: "):
        hold(**changes)


class Linear:
    """Height 19 times the amplitude, up to 0.05 m."""

    method, simulates = "lookup", False

    def __init__(self) -> None:
        self.asked = 0

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        del margin, height
        amplitude = excitation.amplitude
        self.asked += 1
        if amplitude > 0.05:
            raise SelectionError(f"amplitude: given {amplitude:g} m; allowed: up to 0.05 m")
        return Selection(19.0 * amplitude, 5.0 * amplitude, 0.8, "lookup")


def controller(limits: tuple[float, float] = (0.017, 1.0), settle: int = 0) -> tuple[SelectingController, Linear]:
    selector = Linear()
    step_back, drift = StepBack(0.1, settle, 3, 0.15, 0.05), DriftSettings(0.15, 0.02, 1e4)
    control = ControlSettings(HoldSettings(**SETTINGS), step_back, drift, 0.0)
    return SelectingController(control, selector, limits), selector


def answers(machine: Controller, estimates: Sequence[Estimate]) -> list[LoopAnswer]:
    return [machine.answer(0.05 * k, estimate, 0.3) for k, estimate in enumerate(estimates)]


def test_each_estimate_is_answered_and_the_height_repeated() -> None:
    machine, selector = controller()
    commands = [answer.command for answer in answers(machine, [steady(0.015)] * 10)]
    assert len(commands) == 10
    assert all(math.isnan(command.height) for command in commands[:3])
    assert {command.height for command in commands[3:]} == {19.0 * 0.015}
    assert [command.sequence for command in commands] == [0] * 3 + [1] * 7
    assert selector.asked == 1


def test_an_excitation_out_of_the_map_is_refused_and_selected_for_once() -> None:
    machine, selector = controller()
    answers(machine, [steady(0.015)] * 4)
    given = answers(machine, [steady(0.08)] * 20)
    assert [answer.text for answer in given if answer.kind] == [
        "the ceiling stays: amplitude: given 0.08 m; allowed: up to 0.05 m"
    ]
    assert {answer.command.height for answer in given} == {19.0 * 0.015}
    assert selector.asked == 2


def test_a_refusal_is_reported_again_after_a_good_estimate() -> None:
    machine, _ = controller()
    poor = Estimate(quality=Quality.POOR, amplitude=0.015, amplitude_std=1e-3, frequency=5.49)
    said = [answer.kind == "refused" for answer in answers(machine, [poor, poor, steady(0.015), poor, poor])]
    assert said == [True, False, False, True, False]


def test_heights_stay_in_the_ceilings_range() -> None:
    machine, _ = controller(limits=(0.017, 0.2))
    command = answers(machine, [steady(0.015)] * 4)[-1].command
    assert command.height == 0.2
    assert "range" in command.reason
    assert math.isnan(command.predicted_amplitude)


def stepped(
    machine: Controller, count: int, height: float, swing: Callable[[int], float] = lambda _: 0.12
) -> list[float]:
    """Return the heights after each of `count` steady estimates with the ceiling at `height`, the beam at swing(k)."""
    estimates = [
        Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49, beam_amplitude=swing(k))
        for k in range(count)
    ]
    return [machine.answer(1.0, estimate, height).command.height for estimate in estimates]


def test_in_a_rumble_the_ceiling_steps_back_when_it_stands_and_again_while_it_lasts() -> None:
    machine, _ = controller()
    high = answers(machine, [steady(0.015)] * 4)[-1].command.height
    machine.on_event("rumble")
    assert stepped(machine, 10, height=0.1) == [high] * 10  # on its way
    lower = high - 0.1 * (high - 0.017)
    assert stepped(machine, 3, height=high) == pytest.approx([high, high, lower])
    assert stepped(machine, 3, height=lower)[-1] == pytest.approx(lower - 0.1 * (lower - 0.017))
    machine.on_event("calm")
    stays = machine.answer(1.0, steady(0.015), lower).command.height
    assert stepped(machine, 10, height=stays) == [stays] * 10


@pytest.mark.parametrize("swing", [lambda _: 0.08, lambda k: 0.2 * 0.99**k], ids=["as predicted", "dying out"])
def test_a_decaying_or_predicted_amplitude_moves_nothing(swing: Callable[[int], float]) -> None:
    machine, _ = controller()
    high = answers(machine, [steady(0.015)] * 4)[-1].command.height
    stepped(machine, 8, high, swing)
    machine.on_event("rumble")
    assert stepped(machine, 30, high, lambda k: swing(k + 8)) == [high] * 30


def test_the_beam_may_settle_before_it_counts() -> None:
    machine, _ = controller(settle=5)
    high = answers(machine, [steady(0.015)] * 4)[-1].command.height
    machine.on_event("rumble")
    assert stepped(machine, 8, high)[-2] == high
    assert stepped(machine, 1, high)[-1] < high


def test_a_step_back_is_reported_with_the_new_height() -> None:
    machine, _ = controller()
    high = answers(machine, [steady(0.015)] * 4)[-1].command.height
    machine.on_event("rumble")
    said = [
        machine.answer(
            1.0,
            Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49, beam_amplitude=0.12),
            high,
        )
        for _ in range(3)
    ][-1]
    assert (said.kind, said.value) == ("step_back", said.command.height)
    assert said.command.sequence == 2


@pytest.mark.parametrize(("share", "count"), [(0.0, 3), (1.0, 3), (math.nan, 3), (0.1, 0)])
def test_a_step_back_that_cannot_be_is_refused(share: float, count: int) -> None:
    with pytest.raises(HoldError, match=r"given .*; allowed: "):
        StepBack(share, 0, count, 0.15, 0.05)


def test_a_prescribed_ceiling_follows_its_profile_by_the_stamps_alone() -> None:
    machine = ProfileController(((6.0, 0.017), (7.0, 0.2)))
    heights = [machine.answer(t, steady(0.01), math.nan).command.height for t in (0.0, 6.5, 9.0)]
    assert heights == pytest.approx([0.017, 0.1085, 0.2])
