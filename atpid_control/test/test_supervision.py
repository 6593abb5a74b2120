# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rules of supervision: who is silent, what is then permitted, what a stop and a level do."""

import math
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from atpid_common.vocabulary import RunState
from atpid_control.supervision.limits import (
    QUANTITIES,
    AbortLevels,
    ContactRate,
    Levels,
    OnTime,
    PassedLevel,
    largest,
    sustained,
)
from atpid_control.supervision.states import NodeLiveness, Supervision, SupervisionError

NODES = ("identifier_node", "selector_node", "motor_node")
NEEDED = NODES[:2]
TURN = 0.1
#: Between two multiples of the turn, so that rounding decides nothing [s].
ANSWER_TIME = 0.45


def supervision(*answered: str) -> tuple[NodeLiveness, Supervision]:
    """Return the rules of a graph of which some nodes have answered at 0 s."""
    answers = NodeLiveness(NODES, ANSWER_TIME, TURN)
    for name in answered:
        answers.answered(name, 0.0)
    return answers, Supervision(answers, NEEDED)


@example([(0, False)] * 25 + [(0, True), (1, True)] + [(0, False)] * 3)
@given(st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=200))
def test_motion_is_permitted_only_while_every_needed_node_has_answered_within_the_answer_time(
    turns: list[tuple[int, bool]],
) -> None:
    """Whatever answers in whatever order, by a second account of it: the last answer of each node."""
    answers, rules = supervision()
    last: dict[str, float] = {}
    for turn, (node, answered) in enumerate(turns):
        now = turn * TURN
        if answered:
            answers.answered(NODES[node], now)
            last[NODES[node]] = now
        answers.check(now)
        fresh = all(now - last.get(name, -math.inf) <= ANSWER_TIME for name in NEEDED)
        assert rules.situation().permit == fresh


@given(st.lists(st.sampled_from(["stop", "rearm", "answer", "silence", "end"]), max_size=60))
def test_a_stop_holds_until_it_is_rearmed_and_never_permits_motion(acts: list[str]) -> None:
    answers, rules = supervision()
    now, stopped = 0.0, False
    for act in acts:
        now += TURN
        if act == "stop":
            rules.stop("operator")
            stopped = True
        elif act == "rearm":
            stopped = bool(rules.rearm()) and stopped
        elif act == "answer":
            for name in NODES:
                answers.answered(name, now)
        elif act == "end":
            rules.end()
        else:
            now += 0.05
        answers.check(now)
        situation = rules.situation()
        assert situation.stop == stopped == (situation.state is RunState.SAFE)
        assert not (situation.stop and situation.permit)


def test_each_state_follows_from_who_answers() -> None:
    answers, rules = supervision()
    assert rules.situation().state is RunState.STARTING
    for name in NEEDED:
        answers.answered(name, 0.0)
    assert (rules.situation().state, rules.situation().permit) == (RunState.STARTING, True), "so that the motor can arm"
    answers.answered("motor_node", 0.0)
    answers.check(0.0)
    assert rules.situation().state is RunState.READY
    for turn in range(1, 6):
        for name in NEEDED:
            answers.answered(name, turn * TURN)
        changes = answers.check(turn * TURN)
    assert [(change.name, change.back) for change in changes] == [("motor_node", False)]
    assert (rules.situation().state, rules.situation().permit) == (RunState.DEGRADED, True)
    for turn in range(6, 12):
        answers.check(turn * TURN)
    assert rules.situation().state is RunState.FAULT
    assert rules.situation().reason.endswith(", ".join(NEEDED))
    assert rules.rearm(), "nothing is armed while a needed node is silent"
    assert rules.given_up(5.0, 10.0) == ""
    assert rules.given_up(10.6, 10.0) == "identifier_node"
    assert rules.given_up(10.6, 0.0) == "", "0: never"


def test_the_end_withdraws_the_permission_and_the_first_reason_of_a_stop_stays() -> None:
    _, rules = supervision(*NODES)
    assert rules.situation().permit
    rules.end()
    assert (rules.situation().state, rules.situation().permit) == (RunState.SHUTDOWN, False)
    assert rules.stop("level")
    assert not rules.stop("operator")
    assert rules.stopped == "level"
    assert rules.situation().reason.startswith("level")
    assert rules.rearm() == ""
    assert not rules.situation().permit


def test_a_node_without_a_process_may_be_away_for_the_restart_time() -> None:
    answers, rules = supervision(*NODES)
    for turn in range(9):
        answers.check(turn * TURN)
    limits = 10.0, 60.0

    def ends(now: float, *, runs: bool) -> bool:
        return bool(rules.given_up(now, *limits, lambda _: runs))

    assert not ends(30.0, runs=False), "it is being started again"
    assert not ends(39.9, runs=True), "its process is there, and has some time to answer"
    assert ends(40.1, runs=True)
    assert not ends(59.9, runs=False)
    assert ends(60.1, runs=False), "it does not come"


def test_time_in_which_the_supervisor_was_held_up_is_no_silence_of_others() -> None:
    answers, _ = supervision(*NODES)
    answers.check(0.0)
    assert answers.check(3.0) == []
    assert {change.name for turn in range(1, 6) for change in answers.check(3.0 + turn * TURN)} == set(NODES)


def test_a_node_that_has_ended_is_silent_at_once_until_it_answers_again() -> None:
    answers, rules = supervision(*NODES)
    assert answers.check(TURN, ended={NEEDED[0]})[0].name == NEEDED[0]
    assert not rules.situation().permit
    assert answers.check(2 * TURN, ended={NEEDED[0]}) == []
    answers.answered(NEEDED[0], 3 * TURN)
    assert [change.back for change in answers.check(3 * TURN)] == [True]
    assert rules.situation().permit


@pytest.mark.parametrize(("nodes", "needed"), [((), ()), (("a", "a"), ("a",)), (("a",), ("b",)), (("a",), ())])
def test_nodes_that_cannot_be_are_refused(nodes: tuple[str, ...], needed: tuple[str, ...]) -> None:
    with pytest.raises(SupervisionError, match="allowed:"):
        Supervision(NodeLiveness(nodes, 0.4, TURN), needed)


@given(st.lists(st.floats(-20.0, 20.0) | st.floats(), max_size=50), st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_an_abort_is_given_once_by_the_first_value_above(values: list[float], first: float, second: float) -> None:
    levels = Levels(min(first, second), max(first, second))
    limits = AbortLevels({"beam_displacement": levels})
    passed = [limits.update("beam_displacement", value, 0.01 * turn) for turn, value in enumerate(values)]
    aborts = [turn for turn, each in enumerate(passed) if each and each.severity is PassedLevel.ABORT]
    above = [turn for turn, value in enumerate(values) if abs(value) > levels.abort]
    assert aborts == above[:1]
    warned = [turn for turn, each in enumerate(passed) if each and each.severity is PassedLevel.WARNING]
    between = [turn for turn, value in enumerate(values) if abs(value) > levels.warning]
    assert warned == [turn for turn in between[:1] if turn not in above], "unless that value is above both at once"
    assert bool(limits.aborted) == bool(above)


def test_a_warning_comes_again_after_a_quiet_second_and_without_levels_nothing_is_limited() -> None:
    limits = AbortLevels({"beam_displacement": Levels(warning=0.1)})
    times = [time for time in (0.0, 0.5, 1.4, 3.0) if limits.update("beam_displacement", 0.2, time)]
    assert times == [0.0, 3.0]
    unlimited = AbortLevels({name: Levels() for name in QUANTITIES})
    assert not [name for name in QUANTITIES if unlimited.limited(name) or unlimited.update(name, 1e300, 0.0)]


def test_an_aborted_quantity_is_rearmed_only_when_it_is_lower() -> None:
    limits = AbortLevels({"beam_displacement": Levels(abort=0.1)})
    passed = limits.update("beam_displacement", -0.2, 0.0)
    assert re.fullmatch(r"beam_displacement 0\.2 m .*abort.* 0\.1 m", str(passed))
    assert limits.still_above({"beam_displacement": -0.2}) == ("beam_displacement",)
    assert limits.still_above({"beam_displacement": 0.01}) == ()
    limits.rearm()
    assert limits.update("beam_displacement", 0.2, 1.0) is not None


@pytest.mark.parametrize("levels", [Levels(0.2, 0.1), Levels(math.nan), Levels(abort=-1.0), Levels(0.0, 1.0)])
def test_levels_that_cannot_be_are_refused(levels: Levels) -> None:
    with pytest.raises(SupervisionError, match=r"beam_displacement: .*; allowed"):
        AbortLevels({"beam_displacement": levels})


def test_a_lone_spike_is_no_displacement_and_an_impact_is_an_acceleration() -> None:
    series = np.zeros(50)
    series[20] = 5.0
    assert sustained(series) == 0.0
    assert largest(series) == 5.0
    series[20:23] = -3.0, -4.0, -5.0
    assert sustained(series) == 3.0
    series[21] = math.nan
    assert sustained(series) == 0.0
    assert math.isnan(sustained(np.full(50, math.nan)))
    assert math.isnan(largest(np.full(50, math.nan)))


def test_contacts_a_second_are_counted_over_blocks_of_any_size() -> None:
    """Eleven pulses a second, each with a second swing inside the dead time."""
    rate, time = 2000.0, np.arange(6000) / 2000.0
    pulses = np.zeros_like(time)
    for start in np.arange(0.05, 3.0, 1.0 / 11.0):
        first = round(start * rate)
        pulses[first], pulses[first + 4] = 80.0, -60.0
    for block in (37, 100, 6000):
        counted = ContactRate(50.0, 0.005)
        for first in range(0, 6000, block):
            last = counted.push(first, rate, pulses[first : first + block])
        assert last == pytest.approx(11.0, abs=1.0)


def test_the_motor_is_timed_while_it_is_on_without_interruption() -> None:
    timed = OnTime()
    assert [timed.push(on, now) for on, now in ((True, 1.0), (True, 3.5), (False, 4.0), (True, 5.0))] == [0, 2.5, 0, 0]
