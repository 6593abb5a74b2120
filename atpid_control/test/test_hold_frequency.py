# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The hold of methods that select at any frequency: what moves the ceiling when the frequency does."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from atpid_control.identification import Estimate, Quality
from atpid_control.loop.controller import SelectingController
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import UNSETTLED, UNSETTLED_COUNT, Hold, HoldSettings
from atpid_control.loop.protocol import ControlSettings
from atpid_control.loop.step_back import StepBack
from atpid_control.selection.protocol import Excitation, Selection

SETTINGS: dict[str, Any] = {
    "dead_band": 0.01, "sigmas": 4.0, "steady_count": 4, "rising_count": 4, "falling_count": 2,
    "frequency": 5.49, "frequency_tolerance": 0.05,
}  # fmt: skip
STEP_BACK, DRIFT = StepBack(0.1, 4, 3, 0.15, 0.05), DriftSettings(0.15, 0.02, 1e4)


def hold(**changes: Any) -> Hold:
    return Hold(HoldSettings(**(SETTINGS | changes)))


def steady(amplitude: float, frequency: float = 5.49) -> Estimate:
    return Estimate(quality=Quality.STEADY, amplitude=amplitude, amplitude_std=1e-6, frequency=frequency)


ANYWHERE: dict[str, Any] = {"reach": (2.7, 11.0), "frequency_band": 0.0025}


def test_off_resonance_is_refused_only_where_the_method_does_not_reach() -> None:
    assert hold().judge(steady(0.015, frequency=6.5)).refused
    machine = hold(**ANYWHERE)
    assert not machine.judge(steady(0.015, frequency=6.5)).refused
    assert machine.judge(steady(0.015, frequency=12.0)).refused


def test_another_frequency_is_selected_for_though_the_amplitude_is_the_same() -> None:
    machine = hold(**ANYWHERE)
    for frequency, expected in ((5.49, True), (5.50, False), (5.55, True), (5.54, False), (5.30, True)):
        verdicts = []
        for _ in range(6):
            verdicts.append(machine.judge(steady(0.015, frequency=frequency)))
            if verdicts[-1].select:
                machine.acted(verdicts[-1].amplitude, verdicts[-1].frequency)
        assert any(verdict.select for verdict in verdicts) == expected, frequency
        chosen = [verdict.frequency for verdict in verdicts if verdict.select]
        assert chosen == [frequency] * expected


def test_a_frequency_inside_its_noise_moves_nothing() -> None:
    machine = hold(**ANYWHERE)
    machine.acted(0.015, 5.49)
    noisy = Estimate(
        quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.52, frequency_std=0.01,
    )  # fmt: skip
    assert not any(machine.judge(noisy).select for _ in range(20))


def test_a_drifting_frequency_is_followed_in_steps_of_its_band() -> None:
    machine, frequencies = hold(**ANYWHERE), []
    for k in range(200):  # 10 s at 1 % a second
        verdict = machine.judge(steady(0.015, frequency=5.3 * (1.0 + 0.0005 * k)))
        if verdict.select:
            machine.acted(verdict.amplitude, verdict.frequency)
            frequencies.append(verdict.frequency)
    steps = np.diff(frequencies) / frequencies[:-1]
    assert 20 <= len(frequencies) <= 42
    assert steps.min() > 0.0025 * 0.99
    assert steps.max() < 0.006


def test_a_frequency_without_a_height_is_not_tried_again() -> None:
    machine = hold(**ANYWHERE)
    for _ in range(3):
        machine.judge(steady(0.015))
    verdict = machine.judge(steady(0.015))
    machine.failed(verdict.amplitude, verdict.frequency)
    assert all(not machine.judge(steady(0.015)).select for _ in range(20))
    assert any(machine.judge(steady(0.015, frequency=5.6)).select for _ in range(6))


@pytest.mark.parametrize("seconds", [0.1, 0.9])
def test_a_height_that_comes_late_is_taken_for_a_frequency_that_drifts(seconds: float) -> None:
    machine = hold(**ANYWHERE)
    now = steady(0.015, frequency=5.49 * (1.0 + 0.01 * seconds))
    assert machine.agrees(0.015, now, 5.49)
    assert not machine.agrees(0.015, steady(0.015, frequency=5.6), 5.49)


def test_a_frequency_that_is_not_followed_is_reported_once_until_it_is_steady() -> None:
    """5 % a second: each estimate is a band away from the last."""
    settings = ControlSettings(HoldSettings(**(SETTINGS | ANYWHERE)), STEP_BACK, DRIFT, 0.0)
    controller = SelectingController(settings, OfNoUse(), (0.017, 1.0))
    drifting = 5.49 * (1.0 + 0.05 * 0.05 * np.arange(100))
    events, commands = [], []
    for k, frequency in enumerate([*[5.49] * 10, *drifting.tolist(), *[drifting[-1]] * 10]):
        quality = Quality.TRANSIENT if 10 <= k < 110 else Quality.STEADY
        answer = controller.answer(0.05 * k, replace(steady(0.015, frequency), quality=quality), math.nan)
        commands.append(answer.command)
        if answer.kind:
            events.append((k, answer.kind, answer.text))
    ((first, kind, text),) = events
    assert (kind, text) == ("refused", f"the ceiling stays: {UNSETTLED}")
    assert 10 + UNSETTLED_COUNT <= first <= 12 + UNSETTLED_COUNT  # inside the dead band at first
    assert commands[first].reason == UNSETTLED
    assert commands[-1].sequence == commands[first].sequence + 1
    assert commands[-1].reason == "inside dead band"


class OfNoUse:
    """A method for which the damper is of no use below 5 Hz."""

    method, simulates, frequencies = "no_use", False, (2.7, 11.0)

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        del margin, height
        amplitude, frequency = excitation.amplitude, excitation.frequency
        if frequency >= 5.0:
            return Selection(20.0 * amplitude, 0.05, 0.8, self.method)
        return Selection(0.017, 0.02, 0.0, self.method, no_use=f"the damper is of no use at {frequency:g} Hz")


def test_where_the_damper_is_of_no_use_it_is_closed_and_that_is_reported_once() -> None:
    settings = ControlSettings(HoldSettings(**(SETTINGS | ANYWHERE)), STEP_BACK, DRIFT, 0.0)
    controller = SelectingController(settings, OfNoUse(), (0.017, 1.0))
    events, heights, reasons = [], [], []
    for k, frequency in enumerate([5.49] * 10 + [4.5] * 10 + [4.4] * 10 + [5.2] * 10 + [4.5] * 10):
        answer = controller.answer(0.05 * k, steady(0.015, frequency=frequency), math.nan)
        heights.append(answer.command.height)
        reasons.append(answer.command.reason)
        if answer.kind:
            events.append((answer.kind, answer.severity))
    assert heights[9] == heights[39] == pytest.approx(0.3)
    assert heights[19] == heights[29] == heights[49] == 0.017
    assert events == [("no_use", 0)] * 2
    assert any("of no use at 4.4 Hz" in reason for reason in reasons)
    assert answer.command.predicted_amplitude == 0.02
