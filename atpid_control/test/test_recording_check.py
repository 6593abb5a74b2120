# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The check of the run in a bag: silent for a sound run, and each rule broken on purpose is found and named."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import EVENTS, LASER, STATES, Capture, bench, block, make, session_of, short

from atpid_control.cli import main
from atpid_control.runs.check import Checked, check
from atpid_control.runs.check_rules import KEPT, REACH, AnswerMatching, Findings
from atpid_sim.scene import load_scene

Messages = list[tuple[str, bytes]]
Change = Callable[[Messages], Messages]
TRUTH, EXCITATION, COMMAND = "/plant/truth", "/excitation", "/ceiling/command"
MS = 1_000_000


def end_of(number: int) -> int:
    """Return the stamp of the last scan of a block [ns]."""
    return (50 * number + 49) * MS


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short(tmp_path_factory.mktemp("checked"), 2.0)


@pytest.fixture(scope="module")
def sound(scene_file: Path) -> Messages:
    """Return the 40 blocks of a sound run of 2 s; the ceiling goes to 0.2 m from 0.8 s on."""
    return list(bench(load_scene(scene_file), [(0.8, 0.2, 0.01)]))


@pytest.fixture
def checked(scene_file: Path, tmp_path: Path) -> Callable[..., Checked]:
    def write(messages: Messages, clock: str = "lockstep", faults: str = "") -> Checked:
        scene = tmp_path / scene_file.name
        scene.write_text(scene_file.read_text() + (f"\nfaults: [{{{faults}}}]\n" if faults else ""))
        # in the order given: a recorder in lockstep would sort them
        session = session_of(tmp_path / "bag", scene, lockstep=False, clock=clock)
        for number, (topic, data) in enumerate(messages):
            session.receive(topic, data, 1_000_000_000 + number * 1_000)
        session.close()
        return check(tmp_path / "bag")

    return write


def places(messages: Messages, topic: str) -> list[int]:
    return [index for index, (name, _) in enumerate(messages) if name == topic]


def without(messages: Messages, topic: str, *numbers: int) -> Messages:
    """Return the messages without the n-th ones of a topic."""
    left_out = {places(messages, topic)[number] for number in numbers}
    return [message for index, message in enumerate(messages) if index not in left_out]


def after(messages: Messages, topic: str, number: int, *more: tuple[str, bytes]) -> Messages:
    """Return the messages with `more` behind the n-th one of a topic."""
    place = places(messages, topic)[number]
    return [*messages[: place + 1], *more, *messages[place + 1 :]]


def swapped(messages: Messages, topic: str) -> Messages:
    """Return the messages with the 20th and the 21st of a topic in each other's place."""
    first, second = places(messages, topic)[20:22]
    changed = list(messages)
    changed[first], changed[second] = changed[second], changed[first]
    return changed


def commanded(messages: Messages, height: float) -> Messages:
    """Return the messages with another height in the command that answers block 20."""
    command = make("CeilingCommand", end_of(20), "selector_node", height=height)
    return after(without(messages, COMMAND, 20), EXCITATION, 20, (COMMAND, command))


def counted_as_lost(messages: Messages) -> Messages:
    place = places(messages, LASER)[10]
    odd = block(500, np.full((50, 2), np.nan), dropped=50)
    return [*messages[:place], (LASER, odd), *messages[place + 1 :]]


def jumped(messages: Messages) -> Messages:
    state = make("CeilingState", end_of(39) + MS, "motor_node", mode=3, homed=True, height=0.25, target=0.25)
    return after(messages, STATES, 39, (STATES, state))


def simulated_ceiling(messages: Messages) -> Messages:
    series: dict[str, Any] = {name: np.zeros(50) for name in ("support", "beam", "grain")}
    heights = np.full(50, 0.2)
    heights[25:] = 1.2
    wrong = make("PlantTruth", 2_000 * MS, "plant", first_index=2000, rate=1000.0, ceiling=heights, **series)
    return after(messages, TRUTH, 39, (TRUTH, wrong))


def late_reports(messages: Messages) -> Messages:
    """11 mm in 20 ms: 12 mm are possible with a stamp off by 20 ms; 13 mm are not."""
    late = [
        make("CeilingState", end_of(39) + step * MS, "motor_node", mode=4, height=0.2 + path, target=0.3)
        for step, path in ((20, 0.011), (40, 0.024))
    ]
    return after(messages, STATES, 39, *((STATES, data) for data in late))


def stopped(messages: Messages) -> Messages:
    """The last block of a run that was stopped may be under way."""
    return without([message for message in messages if message[0] != EVENTS], COMMAND, 39)


def second(topic: str, kind: str) -> Change:
    fields: dict[str, Any] = {"sender": "selector_node", "height": 0.2} if kind == "CeilingCommand" else {}
    return lambda sound: after(sound, topic, 5, (topic, make(kind, end_of(5), **fields)))


def backwards(messages: Messages) -> Messages:
    return after(messages, LASER, 39, (LASER, block(0, np.zeros((50, 2)), start_ns=2_000 * MS)))


def impossible(messages: Messages) -> Messages:
    return after(messages, EXCITATION, 20, (EXCITATION, make("Excitation", end_of(20), quality=9)))


#: What is changed, how many findings of each rule that makes, and the parts of one of them.
BROKEN: dict[str, tuple[Change, dict[str, int], str]] = {
    "lost": (lambda sound: without(sound, LASER, 7, 8), {"lost": 1, "unasked": 2}, "lost: LASER: 100 .* 350 to 449"),
    "counted as lost": (counted_as_lost, {"lost": 1}, "lost: LASER: 50 .*device.* 500"),
    "back": (backwards, {"index": 1}, "index: LASER: .* 0 after 1999"),
    "no estimate": (lambda sound: without(sound, EXCITATION, 5), {"unanswered": 1}, r"0\.299000000 s .*estimate"),
    "no command": (lambda sound: without(sound, COMMAND, 5), {"unanswered": 1}, r"0\.299000000 s .*command"),
    "no last command": (lambda sound: without(sound, COMMAND, 39), {"unanswered": 1}, r"1\.999000000 s .*command"),
    "stopped": (stopped, {}, ""),
    "two estimates": (second(EXCITATION, "Excitation"), {"twice": 1, "stamp": 1}, r"twice: .*estimate .*0\.299000000"),
    "two commands": (second(COMMAND, "CeilingCommand"), {"twice": 1, "stamp": 1}, r"twice: .*command .*0\.299000000"),
    "falling": (lambda sound: swapped(sound, STATES), {"stamp": 1}, r"stamp: STATES: 1\.049000000 .* 1\.099000000 s"),
    "swapped": (lambda sound: swapped(sound, LASER), {"stamp": 1, "index": 1, "lost": 2}, "index: LASER"),
    "too high": (lambda sound: commanded(sound, 1.001), {"height": 1}, r"height: 1\.001 m .*1\.049.* 0\.017 to 1 m"),
    "too low": (lambda sound: commanded(sound, 0.0169), {"height": 1}, r"height: 0\.0169 m .* 0\.017 to 1 m"),
    "infinite": (lambda sound: commanded(sound, float("inf")), {"height": 1}, "height: inf m "),
    "highest": (lambda sound: commanded(sound, 1.0), {}, ""),
    "lowest": (lambda sound: commanded(sound, 0.017), {}, ""),
    "to stay": (lambda sound: commanded(sound, float("nan")), {}, ""),
    "jumped": (jumped, {"speed": 1}, r"speed: .* 0\.3 m/s"),
    "simulated ceiling": (simulated_ceiling, {"height": 1, "speed": 1}, " 1000 m/s"),
    "impossible": (impossible, {"message": 1}, "message: /excitation: .* 9 .* 0;"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_each_broken_rule_is_found_and_named(name: str, checked: Callable[..., Checked], sound: Messages) -> None:
    change, counts, finding = BROKEN[name]
    found = checked(change(sound))
    assert found.counts == counts
    assert len(found.findings) == sum(counts.values())
    pattern = finding.replace("LASER", LASER).replace("STATES", STATES)
    assert not counts or any(re.search(pattern, line) for line in found.findings), found.findings
    assert found.lost == {"lost": 100, "swapped": found.lost}.get(name, 0)
    unanswered = {"lost": 2, "swapped": 0}.get(name, counts.get("unanswered", 0))
    assert found.blocks == 40 - unanswered - (name == "stopped")
    assert ("stopped" in found.line) == (name == "stopped")


def test_a_sound_run_is_counted_and_status_0(
    checked: Callable[..., Checked], sound: Messages, tmp_path: Path, capsys: Capture
) -> None:
    found = checked(sound)
    assert found.findings == found.events == []
    assert (found.blocks, found.lost) == (40, 0)
    assert main(["bag", "check", str(tmp_path / "bag")]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\n") == 8
    assert re.search(r" 40 .* 4000 .* 0 lost.* 0\.017 to 1 m, 0\.3 m/s", printed)
    assert "finished: 2 s" in printed


def test_a_report_of_a_real_device_may_jitter_and_no_more(checked: Callable[..., Checked], sound: Messages) -> None:
    assert checked(late_reports(sound), clock="real time").counts == {"speed": 1}


@pytest.mark.parametrize("lost", [False, True])
def test_each_block_of_a_clock_that_failed_on_purpose_has_to_be_answered(
    checked: Callable[..., Checked], sound: Messages, lost: bool
) -> None:
    """Two blocks have one stamp, out of order in the file; both are answered, or one of them is not."""
    messages = swapped(sound, LASER)
    messages = without(messages, EXCITATION, 25) if lost else messages
    found = checked(messages, faults="part: clock, kind: stuck, from: 0.5, to: 1.9")
    # lost: here the recorder received them so, and counted
    assert found.counts == {"lost": 1} | ({"unanswered": 1} if lost else {})
    assert found.blocks == (39 if lost else 40)


def test_blocks_that_share_a_stamp_have_as_many_answers() -> None:
    shared, findings = AnswerMatching(), Findings()
    shared.shared_stamps = True
    for place, count in ((0, 3), (1, 3), (2, 2)):
        for _ in range(count):
            shared.add(place, 7, findings)
    shared.end(findings, None)
    (line,) = findings.lines()
    assert line.startswith("twice: ")
    assert re.findall(r"\d+", line) == ["3", "3", "2", "0", "000000007"]


@pytest.mark.parametrize(("begin", "end", "counts"), [(1.9, 2.0, {}), (0.5, 1.0, {"speed": 1})])
def test_reports_of_a_sensor_that_failed_on_purpose_are_not_the_ceilings(
    begin: float, end: float, counts: dict[str, int], checked: Callable[..., Checked], sound: Messages
) -> None:
    faults = f"part: height_sensor, kind: garbage, from: {begin}, to: {end}"
    assert checked(jumped(sound), faults=faults).counts == counts


def test_warnings_are_listed_and_break_no_rule(checked: Callable[..., Checked], sound: Messages) -> None:
    events = [make("Event", (900 + k) * MS, "x", severity=1 + k % 2, kind="stale", text="no laser") for k in range(3)]
    found = checked(after(sound, STATES, 17, *((EVENTS, event) for event in events)))
    assert found.findings == []
    (line,) = found.events
    assert re.match(r"stale: 3, .*0\.900000000 s, no laser$", line)


def test_findings_are_status_1_with_each_rule_by_name(
    checked: Callable[..., Checked], sound: Messages, tmp_path: Path, capsys: Capture
) -> None:
    checked(without(sound, COMMAND, *range(30)))
    assert main(["bag", "check", str(tmp_path / "bag")]) == 1
    whole, *named, rest, last = (line for line in capsys.readouterr().out.splitlines() if not line.startswith(" "))
    assert whole.endswith("every one read and decoded")
    assert len(named) == KEPT
    assert all(line.startswith("unanswered: ") for line in named)
    assert re.match(rf"unanswered: \D*{30 - KEPT}\D*$", rest)
    assert re.search("30 findings; 10 blocks", last)


def test_answers_may_come_first_and_what_has_none_is_counted_soon() -> None:
    """In real time an answer may be recorded before its block; every seventh block has no command."""
    answers, findings = AnswerMatching(), Findings()
    for number in range(15_000):
        for place in (1, 0, 2):
            if number % 7 or place < 2:
                answers.add(place, number, findings)
    assert 0 <= findings.counts["unanswered"] - (15_000 // 7 - REACH) <= 2  # the others are kept in memory
