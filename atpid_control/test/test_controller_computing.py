# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From estimates to commands: the range, refusals, steps back out of a rumble, and heights that take time."""

import math
import os
import re
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_hold import ANYWHERE, INSIDE, SETTINGS, Twin, steady

from atpid_common.vocabulary import Severity
from atpid_control.identification import Quality
from atpid_control.loop.controller import ControlSettings, ProfileController, SelectingController
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import UNSETTLED, UNSETTLED_COUNT, HoldSettings, StepBack
from atpid_control.loop.protocol import HeightCommand, InlineExecutor, LoopAnswer, threaded
from atpid_control.selection.protocol import Excitation, Selection, SelectionError


def settings(settle: int = 2, margin: float = 0.0, **hold: Any) -> ControlSettings:
    step_back, drift = StepBack(0.1, settle, 3, 0.15, 0.05), DriftSettings(0.15, 0.02, 1e4)
    return ControlSettings(HoldSettings(**(SETTINGS | hold)), step_back, drift, margin)


class Held(Executor):
    """Computes when the test says so."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Callable[..., Any], Any, Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, fn, args, kwargs))
        return future

    def compute(self) -> None:
        """Compute what was submitted first."""
        future, fn, args, kwargs = self.waiting.pop(0)
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)


class Linear:
    """Height 19 times the amplitude up to 0.05 m, a tenth less with a margin."""

    def __init__(self, method: str = "direct", simulates: bool = True, share: float = 1.0) -> None:
        self.method, self.simulates, self.share = method, simulates, share
        self.asked: list[float] = []
        self.error: Exception | None = None
        self.changes: dict[str, Any] = {}

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        amplitude = excitation.amplitude
        self.asked.append(amplitude)
        if self.error is not None:
            raise self.error
        if amplitude > 0.05:
            raise SelectionError(f"amplitude: given {amplitude:g} m; allowed: up to 0.05 m")
        chosen = self.share * (17.1 if margin else 19.0) * amplitude
        return replace(Selection(chosen, 5.0 * amplitude, 0.8, self.method), **self.changes)


class Loop:
    """A controller whose computations the test finishes, fed with one estimate each 50 ms."""

    def __init__(
        self,
        selector: Any = None,
        limits: tuple[float, float] = (0.017, 1.0),
        given: ControlSettings | None = None,
        **more: Any,
    ) -> None:
        self.executor, self.selector, self.time, self.height = Held(), selector or Linear(), 0.0, 0.017
        more = {"executor": self.executor} | more
        self.controller = SelectingController(given or settings(), self.selector, limits, **more)
        self.events: list[LoopAnswer] = []

    def feed(self, *amplitudes: float, height: float | None = None, **changes: Any) -> list[HeightCommand]:
        """Return the commands that answer these amplitudes; without a height the ceiling is at once where it is sent.

        changes: of the estimates, each a value or called with the estimate's number.
        """
        commands = []
        for k, amplitude in enumerate(amplitudes):
            values = {name: value(k) if callable(value) else value for name, value in changes.items()}
            place = self.height if height is None else height
            answer = self.controller.answer(self.time, steady(amplitude, **values), place)
            commands.append(answer.command)
            self.events += [answer] if answer.kind else []
            self.time += 0.05
            self.height = answer.command.height if answer.command.height > 0.0 else self.height
        return commands

    def heard(self) -> list[tuple[str, int]]:
        return [(event.kind, event.severity) for event in self.events]


def looked_up(**more: Any) -> Loop:
    """Return a loop whose heights are looked up, in the answer that asks for them."""
    return Loop(Linear("lookup", simulates=False), **more)


@pytest.mark.parametrize("selector", [Linear(simulates=False), Linear()], ids=["looked up", "inline"])
def test_each_estimate_is_answered_and_the_height_repeated(selector: Linear) -> None:
    loop = Loop(selector, executor=InlineExecutor() if selector.simulates else Held())
    commands = loop.feed(*[0.015] * 10)
    assert all(math.isnan(command.height) for command in commands[:3])
    assert {command.height for command in commands[3:]} == {19.0 * 0.015}
    assert [command.sequence for command in commands] == [0] * 3 + [1] * 7
    assert "computing" not in {command.reason for command in commands}
    assert selector.asked == [0.015]


def test_an_excitation_out_of_the_map_is_refused_once_and_a_height_beyond_the_range_limited() -> None:
    loop = looked_up(limits=(0.017, 0.2))
    command = loop.feed(*[0.015] * 4)[-1]
    assert (command.height, "range" in command.reason) == (0.2, True)
    assert math.isnan(command.predicted_amplitude)
    assert {command.height for command in loop.feed(*[0.08] * 20)} == {0.2}
    (event,) = loop.events
    assert (event.kind, re.findall(r"[\d.]+ m", event.text)) == ("refused", ["0.08 m", "0.05 m"])
    assert loop.selector.asked == [0.015, 0.08]


def test_a_refusal_is_reported_again_after_a_good_estimate() -> None:
    loop, reported = looked_up(), []
    for quality in (Quality.POOR, Quality.POOR, Quality.STEADY, Quality.POOR, Quality.POOR):
        before = len(loop.events)
        loop.feed(0.015, quality=quality)
        reported.append(len(loop.events) - before)
    assert reported == [1, 0, 0, 1, 0]
    assert {kind for kind, _ in loop.heard()} == {"refused"}


def test_a_prescribed_ceiling_follows_its_profile_by_the_stamps_alone() -> None:
    machine = ProfileController(((6.0, 0.017), (7.0, 0.2)))
    heights = [machine.answer(t, steady(0.01), math.nan).command.height for t in (0.0, 6.5, 9.0)]
    assert heights == pytest.approx([0.017, 0.1085, 0.2])


# out of a rumble


def rumbling(settle: int = 0) -> tuple[Loop, float]:
    """Return a loop in which the beam rumbles, and its height."""
    loop = looked_up(given=settings(settle))
    high = loop.feed(*[0.015] * 4, height=0.3)[-1].height
    loop.controller.on_event("rumble")
    return loop, high


def stepped(loop: Loop, count: int, height: float, swing: Any = 0.12) -> list[float]:
    """Return the heights after each of `count` estimates with the ceiling at `height`, the beam at swing(k)."""
    return [command.height for command in loop.feed(*[0.015] * count, height=height, beam_amplitude=swing)]


def test_in_a_rumble_the_ceiling_steps_back_when_it_stands_and_again_while_it_lasts() -> None:
    loop, high = rumbling()
    assert stepped(loop, 10, height=0.1) == [high] * 10  # on its way
    lower = high - 0.1 * (high - 0.017)
    assert stepped(loop, 3, height=high) == pytest.approx([high, high, lower])
    (event,) = loop.events
    assert (event.kind, event.value, event.command.sequence) == ("step_back", event.command.height, 2)
    assert stepped(loop, 3, height=lower)[-1] == pytest.approx(lower - 0.1 * (lower - 0.017))
    loop.controller.on_event("calm")
    (stays,) = stepped(loop, 1, lower, math.nan)
    assert stepped(loop, 10, height=stays) == [stays] * 10
    settling, high = rumbling(settle=5)
    assert stepped(settling, 8, high)[-2] == high
    assert stepped(settling, 1, high)[-1] < high


def test_a_rumble_is_left_while_a_height_is_computed() -> None:
    loop = Loop()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    high = loop.feed(0.015, beam_amplitude=0.1)[0].height
    loop.feed(*[0.015] * 4, beam_amplitude=0.1)
    loop.controller.on_event("rumble")
    loop.feed(*[0.014, 0.0139], beam_amplitude=0.1)
    assert len(loop.executor.waiting) == 1
    assert loop.feed(0.0139, beam_amplitude=0.1)[0].height < high
    assert loop.heard() == [("step_back", Severity.WARNING)]


# at any frequency


class OfNoUse:
    """A method for which the damper is of no use below 5 Hz."""

    method, simulates, frequencies = "no_use", False, (2.7, 11.0)

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        if excitation.frequency >= 5.0:
            return Selection(20.0 * excitation.amplitude, 0.05, 0.8, self.method)
        return Selection(0.017, 0.02, 0.0, self.method, no_use=f"useless at {excitation.frequency:g} Hz")


def test_where_the_damper_is_of_no_use_it_is_closed_and_that_is_reported_once() -> None:
    loop, commands = Loop(OfNoUse(), given=settings(4, **ANYWHERE)), list[HeightCommand]()
    for frequency in (5.49, 4.5, 4.4, 5.2, 4.5):
        commands += loop.feed(*[0.015] * 10, frequency=frequency)
    heights = [command.height for command in commands]
    assert heights[9] == heights[39] == pytest.approx(0.3)
    assert heights[19] == heights[29] == heights[49] == 0.017
    assert loop.heard() == [("no_use", Severity.INFO)] * 2
    assert any("useless at 4.4 Hz" in command.reason for command in commands)
    assert commands[-1].predicted_amplitude == 0.02


def test_a_frequency_that_is_not_followed_is_reported_once_until_it_is_steady() -> None:
    """5 % a second: each estimate is a band away from the last."""
    loop = Loop(OfNoUse(), given=settings(4, **ANYWHERE))
    drifting = 5.49 * (1.0 + 0.05 * 0.05 * np.arange(100))
    commands = loop.feed(*[0.015] * 10)
    commands += loop.feed(*[0.015] * 100, frequency=lambda k: drifting[k], quality=Quality.TRANSIENT)
    commands += loop.feed(*[0.015] * 10, frequency=drifting[-1])
    (event,) = loop.events
    assert (event.kind, event.command.reason) == ("refused", UNSETTLED)
    first = next(k for k, command in enumerate(commands) if command.reason == UNSETTLED)
    assert 10 + UNSETTLED_COUNT <= first <= 12 + UNSETTLED_COUNT  # inside the dead band at first
    assert commands[-1].sequence == commands[first].sequence + 1
    assert commands[-1].reason == INSIDE


# while a height is computed


def test_every_estimate_is_answered_while_a_height_is_computed() -> None:
    loop = Loop()
    waiting = loop.feed(*[0.015] * 10)
    assert [command.sequence for command in waiting] == [0] * 10
    assert all(math.isnan(command.height) for command in waiting)
    assert [command.reason for command in waiting[3:]] == ["computing"] * 7
    loop.executor.compute()
    (poor,) = loop.feed(0.015, quality=Quality.POOR)  # must not be acted on: the result waits
    assert (poor.sequence, poor.reason.split()[0]) == (0, "poor")
    (selected,) = loop.feed(0.015)
    assert (selected.sequence, selected.reason) == (1, "selected")
    assert selected.height == pytest.approx(0.285)
    assert loop.selector.asked == [0.015]
    assert loop.feed(0.015)[0].reason == INSIDE


def test_what_a_height_holds_for_is_its_reason_and_a_missed_deadline_an_event() -> None:
    loop = Loop(executor=InlineExecutor())
    loop.selector.changes = {"wall_s": 0.21, "late": True, "note": "3/49"}
    commands = loop.feed(*[0.015] * 6)
    (event,) = loop.events
    assert event.command.reason == "selected (3/49)"
    assert (event.kind, event.severity, event.value) == ("slow", Severity.WARNING, 0.21)
    assert event.text == "direct: 3/49"
    assert commands[-1].reason == INSIDE


def test_a_height_for_an_excitation_that_fell_again_is_dropped_and_selected_anew() -> None:
    loop = Loop()
    loop.feed(*[0.03] * 4)
    loop.feed(*[0.015] * 2)
    loop.executor.compute()
    assert math.isnan(loop.feed(0.015)[0].height)
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == pytest.approx(0.285)
    assert loop.selector.asked == [0.03, 0.015]


def test_on_a_ramp_the_ceiling_follows_with_the_heights_on_the_way() -> None:
    loop = Loop()
    ramp = [0.01 * 1.02**k for k in range(30)]
    loop.feed(*ramp[:10])
    loop.executor.compute()
    (step,) = loop.feed(ramp[10])
    assert step.height == pytest.approx(19.0 * loop.selector.asked[0])
    assert len(loop.executor.waiting) == 1  # the height for where the ramp has come to is computed at once
    loop.executor.compute()
    assert loop.feed(ramp[11])[0].height == pytest.approx(19.0 * ramp[10])
    falling = Loop()
    falling.feed(*[0.03] * 4)
    falling.executor.compute()
    falling.feed(0.03, 0.028, 0.027, 0.026)
    falling.executor.compute()
    (step,) = falling.feed(0.025)
    assert step.height == pytest.approx(19.0 * 0.027)
    assert step.reason == "falling"


@pytest.mark.parametrize("now", [0.015, 0.03])
def test_a_defect_in_a_computation_is_raised_even_where_its_result_is_not_needed(now: float) -> None:
    loop = Loop()
    loop.selector.error = ZeroDivisionError("a defect")
    loop.feed(*[0.02] * 4)
    loop.executor.compute()
    with pytest.raises(ZeroDivisionError):
        loop.feed(now)


def test_another_margin_selects_anew_and_drops_what_was_computed_with_the_last() -> None:
    loop = Loop()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    before = loop.feed(0.015)[0].height
    loop.controller.configure(settings(margin=3.0))
    loop.feed(*[0.015] * 4)
    loop.controller.configure(settings())
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == before
    loop.feed(*[0.015] * 4)
    loop.controller.configure(settings(margin=3.0))
    loop.executor.compute()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == pytest.approx(17.1 * 0.015)


def test_the_twin_does_not_hold_up_an_answer_and_its_comparison_comes_later() -> None:
    loop = Loop(twin=Twin())
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    loop.feed(*[0.015] * 8, beam_amplitude=0.2)
    assert len(loop.executor.waiting) == 1  # one comparison at a time
    for _ in range(400):
        loop.executor.compute()
        while not loop.executor.waiting:
            loop.feed(0.015, beam_amplitude=0.2)
    (alarm,) = loop.events
    assert (alarm.kind, alarm.severity) == ("drift", Severity.ALARM)
    assert re.findall(r"[\d.]+ m\b", alarm.text) == ["0.2000 m", "0.1000 m"]


def test_a_thread_computes_with_a_lower_priority_than_the_loop() -> None:
    def nice() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    with threaded("computation") as executor:
        assert executor.submit(nice).result() > nice()


def test_a_method_that_is_late_is_replaced_by_the_look_up_until_it_answers_in_time() -> None:
    loop = Loop(fallback=Linear("lookup", simulates=False, share=0.9))
    late = loop.feed(*[0.015] * (3 + 20))
    assert [command.method for command in late] == ["direct"] * 22 + ["lookup"]
    assert late[-1].height == pytest.approx(0.9 * 0.285)
    assert loop.heard() == [("fallback", Severity.ALARM)]
    assert {"direct", "20"} <= set(loop.events[0].text.split())
    loop.executor.compute()
    assert {command.method for command in loop.feed(*[0.015] * 5)} == {"lookup"}  # a late height is dropped
    # out of use it is asked first, and the look-up answers meanwhile, without another event
    assert loop.feed(*[0.02] * 5)[-1].method == "lookup"
    assert len(loop.events) == 1
    loop.executor.compute()
    (answered,) = loop.feed(0.02)
    assert answered.method == "direct"
    assert answered.height == pytest.approx(0.38)
    assert loop.heard()[1:] == [("fallback", Severity.INFO)]


def test_a_method_that_fails_is_replaced_by_the_look_up() -> None:
    loop = Loop(executor=InlineExecutor(), fallback=Linear("lookup", simulates=False, share=0.9))
    loop.selector.error = SelectionError("no height for this excitation")
    assert loop.feed(*[0.015] * (4 + 20))[-1].method == "lookup"
    assert [kind for kind, _ in loop.heard()] == ["refused", "fallback"]
    loop.selector.error = None
    assert loop.feed(*[0.02] * 4)[-1].method == "direct"
    assert [kind for kind, _ in loop.heard()] == ["refused", "fallback", "fallback"]


def test_without_a_look_up_the_ceiling_is_held_which_is_announced_once() -> None:
    loop = Loop()
    assert all(math.isnan(command.height) for command in loop.feed(*[0.015] * 60))
    assert loop.heard() == [("fallback", Severity.ALARM)]
    assert {"direct", "20", "held"} <= set(loop.events[0].text.split())
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == pytest.approx(0.285)
    assert loop.heard()[1:] == [("fallback", Severity.INFO)]
