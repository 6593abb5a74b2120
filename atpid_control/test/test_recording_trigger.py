# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording that begins when a signal passes its level: which sample, how much before, how much after."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded import EVENTS, LASER, bench, block, make, receive, session_of, short, topics_of

from atpid_control.recording.session import RecordingSession, Writing
from atpid_control.recording.trigger import STATES, PreTrigger, Trigger, trigger_of
from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.topics import DEFAULT, Topic, parse
from atpid_sim.scene import load_scene

SUPPORT = "support_displacement"
TOPICS = [Topic(LASER, "atpid_interfaces/msg/SampleBlock"), Topic(EVENTS, "atpid_interfaces/msg/Event")]
SCANS, RATE = 50, 1000.0
MS = 1_000_000


def push(waiting: PreTrigger, number: int, values: Any) -> list[int]:
    """Give a block of the support's displacements; return the first indices of the blocks to be recorded."""
    data = np.stack([values, np.zeros(len(values))], axis=1)
    stamp = SCANS * number * MS
    held = waiting.push(LASER, block(SCANS * number, data, RATE), stamp + 50 * MS, stamp)
    assert sum(len(one.data) for one in held) <= waiting.trigger.memory
    return [one.publish_ns // MS for one in held if one.topic == LASER]


def waiting(**settings: Any) -> PreTrigger:
    return PreTrigger(Trigger(LASER, SUPPORT, **{"level": 0.5, "pre": 0.1, **settings}), TOPICS)


def scan_of(one: PreTrigger) -> int | None:
    """Return the scan that is the trigger; None: there was none so far."""
    return one.fired and one.fired.scan


def sine(number: int, amplitude: float) -> Any:
    """A tone of 10 Hz, which passes 0.5 of its amplitude upwards after a twelfth of each period."""
    return amplitude * np.sin(2 * np.pi * 10.0 * (SCANS * number + np.arange(SCANS)) / RATE)


def test_the_first_sample_at_the_level_is_the_trigger() -> None:
    one = waiting()
    assert [push(one, number, sine(number, 0.4)) for number in range(6)] == [[]] * 6
    # a period of 100 samples begins at 300; asin(0.5) is a twelfth of it: 8.33, so the 9th sample
    assert push(one, 6, sine(6, 1.0)) == [200, 250, 300]
    assert one.fired is not None
    assert tuple(one.fired) == pytest.approx((309 * MS, 309, np.sin(2 * np.pi * 0.09)))
    assert push(one, 7, sine(7, 1.0)) == [350]


@pytest.mark.parametrize(("edge", "index"), [("rising", 120), ("falling", 110), ("either", 110)])
def test_the_edge_decides_and_an_invalid_reading_is_no_passing(edge: str, index: int) -> None:
    one = waiting(edge=edge)
    ones, step = np.ones(SCANS), np.ones(SCANS)
    step[10:20] = 0.0
    push(one, 0, ones)
    push(one, 1, ones)
    assert scan_of(one) is None  # above the level from the begin is no passing
    push(one, 2, step)
    assert scan_of(one) == index
    invalid = waiting()
    step = np.zeros(SCANS)
    step[5], step[6] = np.nan, np.inf
    push(invalid, 0, step)
    assert scan_of(invalid) is None
    push(invalid, 1, np.ones(SCANS))
    assert scan_of(invalid) == 50


@given(pre=st.floats(0.0, 0.6), at=st.integers(0, 999))
def test_every_sample_of_the_pre_trigger_time_is_there_and_little_more(pre: float, at: int) -> None:
    values = np.zeros(1000)
    values[at] = 1.0
    one = waiting(pre=pre)
    pieces = (push(one, number, values[SCANS * number : SCANS * (number + 1)]) for number in range(20))
    kept = next((kept for kept in pieces if one.fired), None)
    assert scan_of(one) == (at or None)  # nothing came before the first, so nothing was passed
    if kept:
        first = at - round(pre * RATE)
        assert kept[0] <= max(0, first)
        assert kept[0] + SCANS > first  # at most the block in which the time begins


@pytest.mark.parametrize(("pre", "kept"), [(600.0, None), (0.1, [49_900, 49_950, 50_000])])
def test_memory_is_bounded_and_the_want_of_it_stated(pre: float, kept: list[int] | None) -> None:
    one = waiting(pre=pre, memory=20_000)
    for number in range(1000):
        push(one, number, np.zeros(SCANS))
    found = push(one, 1000, np.ones(SCANS))
    assert one.shortened == (kept is None)
    assert found == (kept or found)
    assert len(found) > (10 if kept is None else 0)


def test_events_from_before_are_kept() -> None:
    one = waiting()
    for number in range(2 * STATES):
        one.push(EVENTS, make("Event", number * MS, kind="moved"), number * MS, number * MS)
    for number in range(5, 30):
        push(one, number, np.zeros(SCANS))
    held = one.push(LASER, block(1500, np.ones((SCANS, 2)), RATE), 1500 * MS, 1500 * MS)
    assert [item.topic for item in held].count(EVENTS) == STATES
    assert held[-1].topic == LASER


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return short(tmp_path, 3.0)


def recorded(folder: Path, scene: Path, lockstep: bool, **settings: Any) -> RecordingSession:
    trigger = trigger_of(
        settings.pop("trigger", f"sensors/laser {SUPPORT}"), topics_of(lockstep), **{"level": 0.008, **settings}
    )
    session = session_of(folder, scene, lockstep=lockstep, writing=Writing(trigger=trigger))
    receive(session, bench(load_scene(scene), [(0.8, 0.2, 0.01)]))
    session.close()
    assert session.waiting is not None
    return session


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_triggered_run_is_a_bag_that_keeps_the_rules(tmp_path: Path, scene: Path, lockstep: bool) -> None:
    session = recorded(tmp_path / "bag", scene, lockstep, pre=0.2, post=1.0)
    bag = open_bag(tmp_path / "bag")
    index = scan_of(session.waiting)  # type: ignore[arg-type]
    assert index is not None
    blocks = [block for _, block in bag.messages(LASER)]
    values = np.concatenate([np.asarray(one.data).reshape(-1, 2)[:, 0] for one in blocks])
    first = int(blocks[0].first_index)
    assert first <= index - 200 < first + SCANS
    assert values[index - first - 1] < 0.008 <= values[index - first]
    last = blocks[-1].first_index + SCANS
    assert index + 1000 < last <= index + 1000 + SCANS
    assert f" {index}," in bag.result["trigger"]
    assert bag.result[f"lost_scans {LASER}"] == "0"
    found = check(tmp_path / "bag")
    assert (found.findings, found.verified.lost) == ([], ())


def test_any_number_is_a_signal_and_a_level_never_reached_is_stated(tmp_path: Path, scene: Path) -> None:
    waiting = recorded(tmp_path / "bag", scene, True, trigger="excitation amplitude", level=0.005, pre=0.0).waiting
    assert waiting is not None
    assert waiting.fired is not None
    assert (waiting.fired.value >= 0.005, waiting.fired.scan) == (True, None)
    recorded(tmp_path / "never", scene, True, level=1.0)
    bag = open_bag(tmp_path / "never")
    assert not bag.raw
    assert bag.result["trigger"].endswith(" 1: never")


@pytest.mark.parametrize(
    ("text", "level", "allowed"),
    [
        ("sensors/laser", 1.0, "'TOPIC SIGNAL'"),
        ("sensors/nothing x", 1.0, "'TOPIC SIGNAL'"),
        ("sensors/laser a b", 1.0, "'TOPIC SIGNAL'"),
        ("excitation nothing", 1.0, "amplitude"),
        ("events text", 1.0, "value"),
        (f"sensors/laser {SUPPORT}", float("nan"), "trigger_level: .*nan"),
    ],
)
def test_a_trigger_that_cannot_be_is_refused(text: str, level: float, allowed: str) -> None:
    with pytest.raises(BagError, match=allowed):
        trigger_of(text, parse(DEFAULT, lockstep=False), level=level)


def test_a_channel_that_no_block_has_is_named() -> None:
    one = PreTrigger(Trigger(LASER, "nothing", 0.0), TOPICS)
    push(one, 0, np.zeros(SCANS))
    assert one.complaint.startswith(f"{LASER} ")
    assert {"'nothing'", f"{SUPPORT},", "beam_displacement"} <= set(one.complaint.split())
