# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""While a height is being computed the loop goes on, and a result that came too late moves nothing."""

import math
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import pytest

from atpid_common.vocabulary import Severity
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.computation import InlineExecutor, threaded
from atpid_control.loop.controller import SelectingController
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import HoldSettings
from atpid_control.loop.protocol import ControlSettings, HeightCommand
from atpid_control.loop.step_back import StepBack
from atpid_control.selection.protocol import Excitation, Selection, SelectionError

HOLD = HoldSettings(
    dead_band=0.01,
    sigmas=4.0,
    steady_count=4,
    rising_count=4,
    falling_count=2,
    frequency=5.49,
    frequency_tolerance=0.05,
)
SETTINGS = ControlSettings(HOLD, StepBack(0.1, 2, 3, 0.15, 0.05), DriftSettings(0.15, 0.02, 1e4), 0.0)


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
    """Height 19 times the amplitude, a tenth less with a margin."""

    method, simulates = "direct", True

    def __init__(self) -> None:
        self.asked: list[float] = []
        self.error: Exception | None = None

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        del height
        amplitude = excitation.amplitude
        self.asked.append(amplitude)
        if self.error is not None:
            raise self.error
        return Selection((17.1 if margin else 19.0) * amplitude, 5.0 * amplitude, 0.8, self.method)


class Twin:
    """Expects 0.1 m everywhere."""

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        del amplitude, frequency, height
        return 0.1


class Loop:
    """A controller whose computations the test finishes, fed with one estimate each 50 ms."""

    def __init__(
        self, executor: Executor | None = None, twin: Twin | None = None, fallback: Linear | None = None
    ) -> None:
        self.executor, self.selector, self.time, self.height = Held(), Linear(), 0.0, 0.017
        executor = executor or self.executor
        self.controller = SelectingController(SETTINGS, self.selector, (0.017, 1.0), twin, executor, fallback)
        self.events: list[tuple[str, int, str]] = []

    def feed(
        self, *amplitudes: float, quality: Quality = Quality.STEADY, beam: float = math.nan
    ) -> list[HeightCommand]:
        """Return the commands that answer these amplitudes; the ceiling is at once where it is sent."""
        commands = []
        for amplitude in amplitudes:
            estimate = Estimate(
                quality=quality, amplitude=amplitude, amplitude_std=1e-6, frequency=5.49, beam_amplitude=beam
            )
            answer = self.controller.answer(self.time, estimate, self.height)
            commands.append(answer.command)
            if answer.kind:
                self.events.append((answer.kind, answer.severity, answer.text))
            self.time += 0.05
            self.height = commands[-1].height if commands[-1].height > 0.0 else self.height
        return commands


def test_every_estimate_is_answered_while_a_height_is_computed() -> None:
    loop = Loop()
    waiting = loop.feed(*[0.015] * 10)
    assert [command.sequence for command in waiting] == [0] * 10
    assert all(math.isnan(command.height) for command in waiting)
    assert [command.reason for command in waiting[3:]] == ["computing"] * 7
    loop.executor.compute()
    (selected,) = loop.feed(0.015)
    assert (selected.sequence, selected.reason) == (1, "selected")
    assert selected.height == pytest.approx(0.285)
    assert loop.selector.asked == [0.015]
    assert loop.feed(0.015)[0].reason == "inside dead band"


def test_a_height_that_is_only_looked_up_is_in_the_answer_that_asks_for_it() -> None:
    selector = Linear()
    selector.simulates = False
    machine = SelectingController(SETTINGS, selector, (0.017, 1.0), None, Held())
    estimate = Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49)
    assert [machine.answer(0.05 * k, estimate, 0.017).command.sequence for k in range(5)] == [0, 0, 0, 1, 1]


class Late(Linear):
    """Ends after its deadline."""

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        found = super().select(excitation, margin, height)
        return replace(found, wall_s=0.21, late=True, note="in 3 of 49 sampled systems; late: 0.210 s of 0.15 s")


def test_what_a_height_holds_for_is_its_reason_and_a_missed_deadline_an_event() -> None:
    machine = SelectingController(SETTINGS, Late(), (0.017, 1.0))
    estimate = Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49)
    answers = [machine.answer(0.05 * k, estimate, 0.017) for k in range(6)]
    (event,) = [answer for answer in answers if answer.kind]
    assert event.command.reason == "selected (in 3 of 49 sampled systems; late: 0.210 s of 0.15 s)"
    assert (event.kind, event.severity, event.value) == ("slow", Severity.WARNING, 0.21)
    assert event.text == "direct: in 3 of 49 sampled systems; late: 0.210 s of 0.15 s"
    assert answers[-1].command.reason == "inside dead band"


def test_inline_the_height_is_in_the_answer_that_asks_for_it() -> None:
    loop = Loop(InlineExecutor())
    commands = loop.feed(*[0.015] * 5)
    assert [command.sequence for command in commands] == [0, 0, 0, 1, 1]
    assert "computing" not in {command.reason for command in commands}


def test_a_height_for_an_excitation_that_fell_again_is_dropped_and_selected_anew() -> None:
    loop = Loop()
    loop.feed(*[0.03] * 4)
    loop.feed(*[0.015] * 2)
    loop.executor.compute()
    dropped = loop.feed(0.015)
    assert math.isnan(dropped[0].height)
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
    assert len(loop.executor.waiting) == 1, "the height for where the ramp has come to is computed at once"
    loop.executor.compute()
    assert loop.feed(ramp[11])[0].height == pytest.approx(19.0 * ramp[10])


def test_on_a_falling_ramp_too() -> None:
    loop = Loop()
    loop.feed(*[0.03] * 4)
    loop.executor.compute()
    loop.feed(0.03)
    loop.feed(0.028, 0.027, 0.026)
    loop.executor.compute()
    (step,) = loop.feed(0.025)
    assert step.height == pytest.approx(19.0 * 0.027)
    assert step.reason == "falling"


def test_a_result_waits_while_estimates_must_not_be_acted_on() -> None:
    loop = Loop()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    (poor,) = loop.feed(0.015, quality=Quality.POOR)
    assert (poor.sequence, poor.reason) == (0, "poor estimate")
    assert loop.feed(0.015)[0].sequence == 1


def test_no_height_is_reported_when_it_is_known() -> None:
    loop = Loop()
    loop.selector.error = SelectionError("amplitude: given 1 m; allowed: up to 0.05 m")
    loop.feed(*[0.015] * 5)
    loop.executor.compute()
    answer = loop.controller.answer(
        1.0, Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49), 0.017
    )
    assert answer.kind == "refused"
    assert "up to 0.05 m" in answer.text


@pytest.mark.parametrize("now", [0.015, 0.03])
def test_a_defect_in_a_computation_is_raised_even_where_its_result_is_not_needed(now: float) -> None:
    loop = Loop()
    loop.selector.error = ZeroDivisionError("a defect")
    loop.feed(*[0.02] * 4)
    loop.executor.compute()
    with pytest.raises(ZeroDivisionError, match="a defect"):
        loop.feed(now)


def test_another_margin_selects_anew_and_drops_what_was_computed_with_the_last() -> None:
    loop = Loop()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    before = loop.feed(0.015)[0].height
    loop.controller.configure(ControlSettings(HOLD, SETTINGS.step_back, SETTINGS.drift, 3.0))
    loop.feed(*[0.015] * 4)
    loop.controller.configure(SETTINGS)
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == before
    loop.feed(*[0.015] * 4)
    loop.controller.configure(ControlSettings(HOLD, SETTINGS.step_back, SETTINGS.drift, 3.0))
    loop.executor.compute()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == pytest.approx(17.1 * 0.015)


def test_a_rumble_is_left_while_a_height_is_computed() -> None:
    loop = Loop()
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    high = loop.feed(0.015, beam=0.1)[0].height
    loop.feed(*[0.015] * 4, beam=0.1)
    loop.controller.on_event("rumble")
    loop.feed(*[0.014, 0.0139], beam=0.1)
    assert len(loop.executor.waiting) == 1
    (lower,) = loop.feed(0.0139, beam=0.1)
    assert lower.reason == "rumble: stepped back"
    assert lower.height < high


def test_the_twin_does_not_hold_up_an_answer_and_its_comparison_comes_later() -> None:
    loop = Loop(twin=Twin())
    loop.feed(*[0.015] * 4)
    loop.executor.compute()
    loop.feed(*[0.015] * 8, beam=0.2)
    assert len(loop.executor.waiting) == 1, "one comparison at a time"
    alarms = []
    for _ in range(400):
        loop.executor.compute()
        answer = loop.controller.answer(
            loop.time,
            Estimate(quality=Quality.STEADY, amplitude=0.015, amplitude_std=1e-6, frequency=5.49, beam_amplitude=0.2),
            loop.height,
        )
        alarms += [answer.text] if answer.kind == "drift" else []
        while not loop.executor.waiting:
            loop.feed(0.015, beam=0.2)
    assert len(alarms) == 1
    assert "(0.2000 m against 0.1000 m)" in alarms[0]


def test_a_thread_computes_with_a_lower_priority_than_the_loop() -> None:
    import os
    import threading

    def nice() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    with threaded("computation") as executor:
        assert executor.submit(nice).result() > nice()


class Looked(Linear):
    """A look-up: lower heights, at once."""

    method, simulates = "lookup", False

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        given = super().select(excitation, margin, height)
        return Selection(0.9 * given.height, given.beam_amplitude, given.efficiency, self.method)


def test_a_method_that_is_late_is_replaced_by_the_look_up_until_it_answers_in_time() -> None:
    loop = Loop(fallback=Looked())
    late = loop.feed(*[0.015] * (3 + 20))
    assert [command.method for command in late] == ["direct"] * 22 + ["lookup"]
    assert late[-1].height == pytest.approx(0.9 * 0.285)
    assert loop.events == [("fallback", 2, "direct has given no height for 20 estimates: heights are looked up")]
    loop.executor.compute()
    assert {command.method for command in loop.feed(*[0.015] * 5)} == {"lookup"}, "a late height is dropped"
    # out of use it is asked first, and the look-up answers meanwhile, without another event
    assert loop.feed(*[0.02] * 5)[-1].method == "lookup"
    assert len(loop.events) == 1
    loop.executor.compute()
    (answered,) = loop.feed(0.02)
    assert answered.method == "direct"
    assert answered.height == pytest.approx(0.38)
    assert loop.events[1:] == [("fallback", 0, "direct gives heights in time again")]


def test_a_method_that_fails_is_replaced_by_the_look_up() -> None:
    loop = Loop(InlineExecutor(), fallback=Looked())
    loop.selector.error = SelectionError("no height for this excitation")
    assert loop.feed(*[0.015] * (4 + 20))[-1].method == "lookup"
    assert [kind for kind, _, _ in loop.events] == ["refused", "fallback"]
    loop.selector.error = None
    assert loop.feed(*[0.02] * 4)[-1].method == "direct"
    assert [kind for kind, _, _ in loop.events] == ["refused", "fallback", "fallback"]


def test_without_a_look_up_the_ceiling_is_held_which_is_announced_once() -> None:
    loop = Loop()
    assert all(math.isnan(command.height) for command in loop.feed(*[0.015] * 60))
    assert loop.events == [("fallback", 2, "direct has given no height for 20 estimates: the ceiling is held")]
    loop.executor.compute()
    assert loop.feed(0.015)[0].height == pytest.approx(0.285)
    assert loop.events[-1] == ("fallback", 0, "direct gives heights in time again")
