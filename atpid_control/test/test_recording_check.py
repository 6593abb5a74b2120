# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The check of the run in a bag: silent for a sound run, and each rule broken on purpose is found and named."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import SHORT, bench, block, make

from atpid_control.cli import main
from atpid_control.recording.session import RecordingSession
from atpid_control.runs.check import Checked, check
from atpid_control.runs.check_rules import KEPT, REACH, AnswerMatching, Findings
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.topics import DEFAULT, parse
from atpid_sim.scene import load_scene

Messages = list[tuple[str, bytes]]
LASER, TRUTH, EXCITATION = "/sensors/laser", "/plant/truth", "/excitation"
COMMAND, STATE, EVENTS = "/ceiling/command", "/ceiling/state", "/events"
MS = 1_000_000


def end_of(number: int) -> int:
    """Return the stamp of the last scan of a block [ns]."""
    return (50 * number + 49) * MS


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("checked") / "short.yaml"
    path.write_text(SHORT.replace("duration:   8.0", "duration:   2.0").replace("[7.0, 8.0]", "[1.0, 2.0]"))
    return path


@pytest.fixture(scope="module")
def sound(scene_file: Path) -> Messages:
    """Return the 40 blocks of a sound run of 2 s; the ceiling goes to 0.2 m from 0.8 s on."""
    return list(bench(load_scene(scene_file), [(0.8, 0.2, 0.01)]))


@pytest.fixture
def checked(scene_file: Path, tmp_path: Path) -> Callable[..., Checked]:
    def write(messages: Messages, clock: str = "lockstep", close: bool = True, faults: str = "") -> Checked:
        topics = [type(topic)(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, lockstep=True)]
        scene = tmp_path / scene_file.name
        scene.write_text(scene_file.read_text() + (f"\nfaults: [{{{faults}}}]\n" if faults else ""))
        run = new_run(scene, run_id="specimen", commit="none", clock=clock)
        # in the order given: a recorder in lockstep would sort them
        session = RecordingSession(tmp_path / "bag", run, topics, lockstep=False, offered=lambda _: (Qos(),))
        for number, (topic, data) in enumerate(messages):
            session.receive(topic, data, 1_000_000_000 + number * 1_000)
        if close:
            session.close()
        else:
            session.sync()
            session.writer._flush.finish()  # else its thread lasts until the writer is collected
            session.writer._sink.close()
        return check(tmp_path / "bag")

    return write


def without(messages: Messages, topic: str, *numbers: int) -> Messages:
    """Return the messages without the n-th ones of a topic."""
    seen, kept = -1, []
    for name, data in messages:
        seen += name == topic
        if name != topic or seen not in numbers:
            kept.append((name, data))
    return kept


def after(messages: Messages, topic: str, number: int, *more: tuple[str, bytes]) -> Messages:
    """Return the messages with `more` behind the n-th one of a topic."""
    place = [index for index, (name, _) in enumerate(messages) if name == topic][number]
    return [*messages[: place + 1], *more, *messages[place + 1 :]]


def test_a_sound_run_is_one_line_and_status_0(
    checked: Callable[..., Checked], sound: Messages, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = checked(sound)
    assert found.findings == found.events == []
    assert (found.blocks, found.lost) == (40, 0)
    assert main(["bag", "check", str(tmp_path / "bag")]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\n") == 1
    assert "40 blocks answered, 4000 scans, 0 lost" in printed
    assert "allowed 0.017 to 1 m, 0.3 m/s" in printed
    assert "finished: 2 s simulated" in printed


def test_lost_scans_are_counted_and_named_by_index(checked: Callable[..., Checked], sound: Messages) -> None:
    found = checked(without(sound, LASER, 7, 8))
    assert found.lost == 100
    assert "lost: /sensors/laser: 100 scans, index 350 to 449" in found.findings
    # what answers them answers nothing
    assert found.counts["unasked"] == 2


def test_scans_the_device_counts_as_lost_are_named(checked: Callable[..., Checked], sound: Messages) -> None:
    odd = block(500, np.full((50, 2), np.nan), dropped=50)
    place = [index for index, (name, _) in enumerate(sound) if name == LASER][10]
    found = checked([*sound[:place], (LASER, odd), *sound[place + 1 :]])
    assert found.findings == ["lost: /sensors/laser: 50 scans by the device's own count, before index 500"]


def test_a_stream_that_goes_back_is_named(checked: Callable[..., Checked], sound: Messages) -> None:
    again = block(0, np.zeros((50, 2)), start_ns=2_000 * MS)
    found = checked(after(sound, LASER, 39, (LASER, again)))
    assert "index: /sensors/laser: the stream goes back to index 0 after 1999" in found.findings


@pytest.mark.parametrize(("topic", "name"), [(EXCITATION, "estimate"), (COMMAND, "command")])
def test_a_block_without_an_answer_is_named(
    checked: Callable[..., Checked], sound: Messages, topic: str, name: str
) -> None:
    found = checked(without(sound, topic, 5))
    assert found.findings == [f"unanswered: the block that ends at 0.299000000 s has no {name}"]
    assert found.blocks == 39


@pytest.mark.parametrize(("topic", "kind", "name"), [
    (EXCITATION, "Excitation", "estimate"), (COMMAND, "CeilingCommand", "command"),
])  # fmt: skip
def test_a_second_answer_is_named(
    checked: Callable[..., Checked], sound: Messages, topic: str, kind: str, name: str
) -> None:
    found = checked(after(sound, topic, 5, (topic, make(kind, end_of(5), "selector_node", height=0.2)
                                           if kind == "CeilingCommand" else make(kind, end_of(5)))))  # fmt: skip
    assert f"twice: a second {name} for 0.299000000 s" in found.findings
    assert set(found.counts) == {"twice", "stamp"}


def test_the_last_blocks_of_a_run_that_was_stopped_may_be_under_way(
    checked: Callable[..., Checked], sound: Messages
) -> None:
    cut = [message for message in sound if message[0] != EVENTS]
    found = checked(without(cut, COMMAND, 39))
    assert found.findings == []
    assert "stopped before a source had finished" in found.line


def test_the_same_is_found_in_a_run_that_has_finished(checked: Callable[..., Checked], sound: Messages) -> None:
    assert checked(without(sound, COMMAND, 39)).counts == {"unanswered": 1}


def test_stamps_that_fall_are_named(checked: Callable[..., Checked], sound: Messages) -> None:
    places = [index for index, (name, _) in enumerate(sound) if name == STATE][20:22]
    swapped = list(sound)
    swapped[places[0]], swapped[places[1]] = swapped[places[1]], swapped[places[0]]
    found = checked(swapped)
    assert "stamp: /ceiling/state: 1.049000000 s follows 1.099000000 s" in found.findings


@pytest.mark.parametrize("height", [1.001, 0.0169, float("inf")])
def test_a_command_outside_the_limits_is_named(checked: Callable[..., Checked], sound: Messages, height: float) -> None:
    wrong = make("CeilingCommand", end_of(20), "selector_node", height=height)
    found = checked(after(without(sound, COMMAND, 20), EXCITATION, 20, (COMMAND, wrong)))
    assert found.findings == [f"height: {height:g} m was commanded at 1.049000000 s; allowed: 0.017 to 1 m"]


@pytest.mark.parametrize("height", [1.0, 0.017, float("nan")])
def test_a_command_at_the_limit_or_to_stay_is_not(
    checked: Callable[..., Checked], sound: Messages, height: float
) -> None:
    right = make("CeilingCommand", end_of(20), "selector_node", height=height)
    assert checked(after(without(sound, COMMAND, 20), EXCITATION, 20, (COMMAND, right))).findings == []


def test_a_ceiling_that_jumps_is_named(checked: Callable[..., Checked], sound: Messages) -> None:
    jumped = make("CeilingState", end_of(39) + MS, "motor_node", mode=3, homed=True, height=0.25, target=0.25)
    found = checked(after(sound, STATE, 39, (STATE, jumped)))
    assert found.counts == {"speed": 1}
    assert "allowed: 0.3 m/s" in found.findings[0]


def test_a_report_of_a_real_device_may_jitter_and_no_more(checked: Callable[..., Checked], sound: Messages) -> None:
    late = [make("CeilingState", end_of(39) + step * MS, "motor_node", mode=4, height=0.2 + path, target=0.3)
            for step, path in ((20, 0.011), (40, 0.024))]  # fmt: skip
    found = checked(after(sound, STATE, 39, *((STATE, data) for data in late)), clock="real time")
    assert found.counts == {"speed": 1}  # 11 mm in 20 ms: 12 mm are possible with a stamp off by 20 ms; 13 mm are not


def test_the_simulated_ceiling_is_held_to_range_and_speed(checked: Callable[..., Checked], sound: Messages) -> None:
    series: dict[str, Any] = {name: np.zeros(50) for name in ("support", "beam", "grain")}
    heights = np.full(50, 0.2)
    heights[25:] = 1.2
    wrong = make("PlantTruth", 2_000 * MS, "plant", first_index=2000, rate=1000.0, ceiling=heights, **series)
    found = checked(after(sound, TRUTH, 39, (TRUTH, wrong)))
    assert found.counts == {"height": 1, "speed": 1}
    assert any("1000 m/s" in line for line in found.findings)


def test_stamps_of_a_clock_that_failed_on_purpose_are_no_finding(
    checked: Callable[..., Checked], sound: Messages
) -> None:
    places = [number for number, (topic, _) in enumerate(sound) if topic == LASER][20:22]
    swapped = list(sound)
    swapped[places[0]], swapped[places[1]] = swapped[places[1]], swapped[places[0]]
    assert set(checked(swapped).counts) == {"stamp", "index", "lost"}


@pytest.mark.parametrize("lost", [False, True])
def test_but_each_of_its_blocks_has_to_be_answered(
    checked: Callable[..., Checked], sound: Messages, lost: bool
) -> None:
    """Two blocks have one stamp, out of order in the file; both are answered, or one of them is not."""
    places = [number for number, (topic, _) in enumerate(sound) if topic == LASER][20:22]
    swapped = list(sound)
    swapped[places[0]], swapped[places[1]] = swapped[places[1]], swapped[places[0]]
    swapped = without(swapped, EXCITATION, 25) if lost else swapped
    found = checked(swapped, faults="part: clock, kind: stuck, from: 0.5, to: 1.9")
    # lost: here the recorder received them so, and counted
    assert found.counts == {"lost": 1} | ({"unanswered": 1} if lost else {})
    assert found.blocks == (39 if lost else 40)
    shared = AnswerMatching()
    shared.shared_stamps = True
    findings = Findings()
    for place, count in ((0, 3), (1, 3), (2, 2)):
        for _ in range(count):
            shared.add(place, 7, findings)
    shared.end(findings, None)
    assert findings.lines() == ["twice: 3 blocks, 3 estimates, 2 commands for 0.000000007 s"]


@pytest.mark.parametrize(("begin", "end", "counts"), [(1.9, 2.0, {}), (0.5, 1.0, {"speed": 1})])
def test_reports_of_a_sensor_that_failed_on_purpose_are_not_the_ceilings(
    begin: float, end: float, counts: dict[str, int], checked: Callable[..., Checked], sound: Messages
) -> None:
    jumped = make("CeilingState", end_of(39) + MS, "motor_node", mode=3, homed=True, height=0.25, target=0.25)
    faults = f"part: height_sensor, kind: garbage, from: {begin}, to: {end}"
    assert checked(after(sound, STATE, 39, (STATE, jumped)), faults=faults).counts == counts


def test_warnings_are_listed_and_break_no_rule(checked: Callable[..., Checked], sound: Messages) -> None:
    events = [make("Event", (900 + k) * MS, "x", severity=1 + k % 2, kind="stale", text="no laser") for k in range(3)]
    found = checked(after(sound, STATE, 17, *((EVENTS, event) for event in events)))
    assert found.findings == []
    assert found.events == ["stale: 3, the first at 0.900000000 s, no laser"]


def test_a_message_that_cannot_be_is_named(checked: Callable[..., Checked], sound: Messages) -> None:
    odd = make("Excitation", end_of(20), quality=9)
    found = checked(after(sound, EXCITATION, 20, (EXCITATION, odd)))
    assert found.findings == ["message: /excitation: its quality is 9 and its origin 0; see Excitation.msg"]


def test_findings_are_status_1_with_each_rule_by_name(
    checked: Callable[..., Checked], sound: Messages, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checked(without(sound, COMMAND, *range(30)))
    assert main(["bag", "check", str(tmp_path / "bag")]) == 1
    printed = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("unanswered: the block") for line in printed) == KEPT
    assert f"unanswered: and {30 - KEPT} more" in printed
    assert "30 findings; 10 blocks answered" in printed[-1]


def test_a_recording_that_was_not_closed_is_refused(checked: Callable[..., Checked], sound: Messages) -> None:
    with pytest.raises(BagError, match="recover"):
        checked(sound, close=False)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_run() -> None:
    def size(blocks: int) -> int:
        answers, findings = AnswerMatching(), Findings()
        tracemalloc.start()
        for number in range(blocks):
            for place in (1, 0, 2):  # in real time an answer may be recorded first
                if number % 7 or place < 2:  # every seventh has no command
                    answers.add(place, number, findings)
        held = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        assert 0 <= findings.counts["unanswered"] - (blocks // 7 - REACH) <= 2
        return held

    assert size(60_000) < 1.2 * size(15_000)
