# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole graph in lockstep: it repeats itself, meets the thesis's adaptive bench, and follows what changes."""

import os
import signal
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import Event, Excitation
from graph_runs import decoded, in_lockstep, parameters, scene_file

from atpid_control.runs.read import Bag
from atpid_control.runs.run import open_run
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import run_lockstep
from atpid_control.stand.summary import lost_scans, unanswered_blocks
from atpid_control.views.report.view import view_of
from atpid_sim.maps import DamperResponse, HeightMap
from atpid_sim.scene import load_scene
from studies.pure_loop import LoopRun, run_loop
from studies.seeds.measure import configured, longest_rumble

ANSWERS = ("/excitation", "/ceiling/command", "/ceiling/state")
LOOP = ("/sensors/laser", "/plant/truth", *ANSWERS, "/events")
CEILING = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3}


def messages(bag: Bag, topic: str) -> list[Any]:
    return [message for _, message in bag.messages(topic)]


def seconds(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def kinds(bag: Bag, since: float = 0.0) -> Counter[str]:
    """Return how many events of each kind were published from a time on [s]."""
    return Counter(event.kind for event in messages(bag, "/events") if seconds(event) >= since)


def true(bag: Bag, name: str) -> Any:
    return np.concatenate([getattr(message, name) for message in messages(bag, "/plant/truth")])


@pytest.fixture(scope="module")
def adaptive(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Bag:
    """The bag of the thesis's adaptive bench."""
    return in_lockstep(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("adaptive"))


def test_two_runs_with_the_same_seed_give_the_same_messages_of_every_sensor(scenes: Path, tmp_path: Path) -> None:
    steps = [[0.0, 0.0], [0.3, 0.015], [1.0, 0.015], [1.5, 0.02]]
    sensors = {"laser": {"rate": 1000.0, "noise": 2e-5}, "accelerometer": {"rate": 1600.0, "noise": 0.05}}
    changes = {"duration": 2.0, "steady_window": [1.5, 2.0], "amplitude": steps, "sensors": sensors}
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    first, again = (in_lockstep(path, tmp_path / name) for name in ("first", "again"))
    assert [raw.topic for raw in first.raw] == [raw.topic for raw in again.raw]
    for topic in (*LOOP, "/sensors/accelerometer"):
        assert decoded(first, topic) == decoded(again, topic), topic
    assert len(messages(first, "/sensors/laser")) == 40
    assert [len(message.data) for message in messages(first, "/sensors/accelerometer")] == [80] * 40
    assert lost_scans(open_run(first.path)) == 0


def test_every_block_is_there_and_answered_with_the_stamp_of_its_last_sample(adaptive: Bag) -> None:
    assert float(adaptive.result["data_s"]) == 20.0
    assert lost_scans(open_run(adaptive.path)) == 0
    assert unanswered_blocks(open_run(adaptive.path)) == 0
    assert {topic: len(messages(adaptive, topic)) for topic in LOOP[:-1]} == dict.fromkeys(LOOP[:-1], 400)
    blocks = messages(adaptive, "/sensors/laser")
    ends = [(block.first_index + len(block.data) // 2 - 1) / block.rate for block in blocks]
    for topic in ANSWERS:
        assert [seconds(message) for message in messages(adaptive, topic)] == pytest.approx(ends, abs=1e-9), topic


# stage: end [s], excitation [m], best height by brute force [m], closed damper's amplitude [m]
STAGES = [(6.0, 0.015, 0.29, 0.333), (13.0, 0.04, 0.76, 0.888), (20.0, 0.03, 0.57, 0.666)]


@pytest.mark.always("the whole graph in lockstep")
@pytest.mark.parametrize(("end", "excitation", "height", "closed"), STAGES)
def test_the_thesis_adaptive_bench(adaptive: Bag, end: float, excitation: float, height: float, closed: float) -> None:
    window = slice(round((end - 2.0) * 1000.0), round(end * 1000.0))
    blocks = slice(round((end - 2.0) * 20.0), round(end * 20.0))
    estimated = [message.amplitude for message in messages(adaptive, "/excitation")[blocks]]
    assert estimated == pytest.approx([excitation] * len(estimated), rel=0.01)
    assert true(adaptive, "ceiling")[window][-1] == pytest.approx(height, rel=0.05)
    assert 0.5 * np.ptp(true(adaptive, "beam")[window]) <= 0.24 * closed
    assert not {"step_back", "drift"} & set(kinds(adaptive))


def test_the_energy_ledger_closes_and_the_true_ceiling_follows_the_motor(adaptive: Bag) -> None:
    truth, states = messages(adaptive, "/plant/truth"), messages(adaptive, "/ceiling/state")
    last = truth[-1]
    out = last.beam_loss + last.contact_loss + last.stored_energy
    assert last.input_energy + last.ceiling_work == pytest.approx(out, rel=1e-5)
    gaps = [abs(true.ceiling[-1] - state.height) for true, state in zip(truth, states, strict=True)]
    assert max(gaps) <= 0.3 * 0.0015  # one sample's travel: the motor's clock starts at the last sample, not after it


def as_without_the_graph(bag: Bag, path: Path, height_map: Path) -> LoopRun:
    """Return the same run of the loop alone, after comparing what it commands and reports with the graph's bag."""
    ran = run_loop(load_scene(path), configured(), height_map)
    sent = [message.height for message in messages(bag, "/ceiling/command")]
    assert [answer.command.height for answer in ran.answers] == pytest.approx(sent, rel=1e-12, nan_ok=True)
    assert np.max(np.abs(ran.beam - true(bag, "beam"))) <= 1e-9
    reported = [event.kind for event in messages(bag, "/events") if event.node == "selector_node"]
    assert reported == [answer.kind for answer in ran.answers if answer.kind]
    return ran


def test_the_loop_without_the_graph_decides_as_the_graph_does(scenes: Path, adaptive: Bag) -> None:
    path = scenes / "thesis_4_3.yaml"
    height_map = map_for(load_scene(path))
    assert height_map is not None
    as_without_the_graph(adaptive, path, height_map)


def test_a_map_that_lies_too_high_is_left_and_not_returned_to(scenes: Path, tmp_path: Path) -> None:
    shipped = map_for(load_scene(scenes / "thesis_4_3.yaml"))
    assert shipped is not None
    good = HeightMap.load(shipped)
    replace(good, heights=1.08 * good.heights).save(tmp_path / "high.npz")
    ceiling = CEILING | {"controller": "lookup", "map": "high.npz"}
    changes = {"duration": 10.0, "steady_window": [8.0, 10.0], "ceiling": ceiling, "amplitude": 0.015}
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    bag = in_lockstep(path, tmp_path / "run")
    assert {"rumble", "step_back"} <= set(kinds(bag))
    assert 0.5 * np.ptp(true(bag, "beam")[8000:]) <= 0.3 * 0.333
    ran = as_without_the_graph(bag, path, tmp_path / "high.npz")
    assert {answer.kind for answer in ran.answers} == {"", "step_back"}
    first = ran.events("step_back")[0][0]
    after = [answer.command.height for t, answer in zip(ran.time, ran.answers, strict=True) if t >= first]
    best = good.lookup(0.015, 0.1)
    assert max(after) < 1.08 * best.height
    assert all(later <= earlier for earlier, later in pairwise(after))
    assert longest_rumble(ran, (0.2, 10.0), best) > 1.0  # the bench's own measure sees it as well


@pytest.mark.parametrize("ceiling", [{"height": 0.1}, {"closed": 0.017, "open": 0.1, "start": 0.2, "end": 0.5}])
def test_an_uncontrolled_ceiling_follows_the_scene(scenes: Path, tmp_path: Path, ceiling: dict[str, float]) -> None:
    changes = {"duration": 0.7, "steady_window": [0.5, 0.7], "ceiling": ceiling}
    bag = in_lockstep(scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes), tmp_path / "run")
    assert true(bag, "ceiling")[-1] == pytest.approx(0.1)
    assert messages(bag, "/ceiling/state")[-1].height == pytest.approx(0.1)
    assert {message.method for message in messages(bag, "/ceiling/command")} == {"fixed"}


def test_ctrl_c_in_a_callback_ends_the_run_after_it_and_closes_the_bag(scenes: Path, tmp_path: Path) -> None:
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, duration=2.5, steady_window=[2.0, 2.5])
    _, started = parameters(path, tmp_path / "run", lockstep=True)
    ended: list[float] = []

    def follow(time: float, _: Any) -> None:
        if time >= 0.5 and not ended:
            os.kill(os.getpid(), signal.SIGINT)
            ended.append(time)  # not torn

    with own_domain(), pytest.raises(KeyboardInterrupt):
        run_lockstep(started, lambda _: None, follow)
    assert ended
    times = open_run(tmp_path / "run" / "bag").motion.time
    assert ended[0] - 0.1 < times[-1] < ended[0] + 0.2
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("method", ["pca", "direct", "search"])
def test_a_method_that_computes_runs_on_the_bench(scenes: Path, tmp_path: Path, method: str) -> None:
    changes = {"duration": 3.0, "steady_window": [2.5, 3.0], "ceiling": CEILING | {"controller": method}}
    bag = in_lockstep(scene_file(scenes / "stepped_4_8.yaml", tmp_path, **changes), tmp_path / "run")
    commands = messages(bag, "/ceiling/command")
    assert {message.method for message in commands} == {method}
    # `direct` keeps its margin for an error of mass, frequency and restitution, too
    assert commands[-1].height == pytest.approx(0.57, rel=0.1 if method == "direct" else 0.05)
    assert unanswered_blocks(open_run(bag.path)) == 0
    assert not [event for event in messages(bag, "/events") if event.severity == Event.ALARM]


def test_a_drift_of_one_per_cent_a_second_is_followed_without_rumble(scenes: Path, tmp_path: Path) -> None:
    """Shortened: 5.3 to 5.47 Hz in 3.2 s. No step, rumble or step back; the beam keeps to what its height leaves."""
    changes = {"duration": 10.0, "steady_window": [9.0, 10.0], "frequency": [[5.0, 5.3], [8.2, 5.47]]}
    path = scene_file(scenes / "drifting_frequency.yaml", tmp_path, **changes)
    bag = in_lockstep(path, tmp_path / "run")
    assert unanswered_blocks(open_run(bag.path)) == 0
    assert not {"excitation_changed", "rumble", "step_back", "drift", "refused"} & set(kinds(bag, since=5.0))
    estimates = messages(bag, "/excitation")[100:]
    assert all(message.quality == Excitation.STEADY for message in estimates)
    times = 0.05 * (101 + np.arange(len(estimates)))
    off = np.array([message.frequency for message in estimates]) / np.interp(times, [5.0, 8.2], [5.3, 5.47]) - 1.0
    assert np.abs(off).max() < 1.5e-3
    heights = [message.height for message in messages(bag, "/ceiling/command")[100:]]
    assert (np.diff(heights) > -1e-3).all()  # the optimum rises up to resonance
    assert len(set(heights)) >= 6
    assert heights[-1] / heights[0] == pytest.approx(1.14, abs=0.05)
    closed = [DamperResponse(load_scene(path).with_(frequency=f)).closed_amplitude(0.015) for f in (5.3, 5.47)]
    assert max(message.beam_amplitude for message in estimates) < 0.45 * closed[0] < 0.3 * closed[1]


def test_a_frequency_that_steps_is_selected_for_and_closed_where_it_is_of_no_use(scenes: Path, tmp_path: Path) -> None:
    frequency = [[5.0, 5.25], [5.01, 5.47], [10.0, 5.47], [10.01, 3.2]]
    changes = {"duration": 17.0, "steady_window": [16.0, 17.0], "frequency": frequency}
    path = scene_file(scenes / "stepping_frequency.yaml", tmp_path, **changes)
    bag = in_lockstep(path, tmp_path / "run")
    found = view_of(bag.path).stages
    assert [round(stage.identified_frequency, 2) for stage in found] == [5.25, 5.47, 3.2]
    assert [(stage.t0, stage.t1) for stage in found] == [(1.0, 5.0), (5.01, 10.0), (10.01, 17.0)]
    assert found[0].efficiency > 0.55
    assert found[1].efficiency == pytest.approx(0.795, abs=0.02)
    assert found[2].height == pytest.approx(0.017, abs=1e-6)
    steady = DamperResponse(load_scene(path).with_(frequency=3.2)).closed_amplitude(0.015)
    assert found[2].amplitude == pytest.approx(steady, rel=0.1)  # swings of 5.5 Hz die out in seconds
    late = kinds(bag, since=4.0)
    assert (late["excitation_changed"], late["no_use"]) == (2, 1)
    reasons = {message.reason for message in messages(bag, "/ceiling/command")}
    assert any({"no", "use", "0.015", "3.2"} <= set(reason.split()) for reason in reasons)
