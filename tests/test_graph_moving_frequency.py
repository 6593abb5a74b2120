# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole graph in lockstep under a frequency that drifts or steps, and under two tones."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from atpid_interfaces.msg import Excitation
from graph_runs import in_lockstep, scene_file

from atpid_control.runs.read import Bag
from atpid_control.runs.run import open_run
from atpid_control.stand.summary import unanswered_blocks
from atpid_control.views.report.stages import stages
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import load_scene


def kinds(bag: Bag, since: float) -> Counter[str]:
    """Return how many events of each kind were published from a time on [s]."""
    return Counter(
        event.kind
        for _, event in bag.messages("/events")
        if event.header.stamp.sec + 1e-9 * event.header.stamp.nanosec >= since
    )


@pytest.mark.slow
def test_a_drift_of_one_per_cent_a_second_is_followed_without_rumble(scenes: Path, tmp_path: Path) -> None:
    """Shortened: 5.3 to 5.47 Hz in 3.2 s. No step, rumble or step back; the beam keeps to what its height leaves."""
    changes = {"duration": 10.0, "steady_window": [9.0, 10.0]}
    path = scene_file(scenes / "drifting_frequency.yaml", tmp_path, **changes, frequency=[[5.0, 5.3], [8.2, 5.47]])
    bag = in_lockstep(path, tmp_path / "run")
    assert unanswered_blocks(open_run(bag.path)) == 0
    assert not {"excitation_changed", "rumble", "step_back", "drift", "refused"} & set(kinds(bag, since=5.0))
    estimates = [message for _, message in bag.messages("/excitation")]
    assert all(message.quality == Excitation.STEADY for message in estimates[100:])
    times = 0.05 * (1 + np.arange(len(estimates)))
    true = np.interp(times, [5.0, 8.2], [5.3, 5.47])
    off = np.array([message.frequency for message in estimates])[100:] / true[100:] - 1.0
    assert np.abs(off).max() < 1.5e-3
    heights = [message.height for _, message in bag.messages("/ceiling/command")][100:]
    assert (np.diff(heights) > -1e-3).all()  # the optimum rises up to resonance
    assert len(set(heights)) >= 6
    assert heights[-1] / heights[0] == pytest.approx(1.14, abs=0.05)
    beam = [message.beam_amplitude for message in estimates]
    closed = [DamperResponse(load_scene(path).with_(frequency=f)).closed_amplitude(0.015) for f in (5.3, 5.47)]
    assert max(beam[100:]) < 0.45 * closed[0] < 0.3 * closed[1]


@pytest.mark.slow
def test_a_frequency_that_steps_is_selected_for_and_closed_where_the_damper_is_of_no_use(
    scenes: Path, tmp_path: Path
) -> None:
    frequency = [[5.0, 5.25], [5.01, 5.47], [10.0, 5.47], [10.01, 3.2]]
    changes = {"duration": 17.0, "steady_window": [16.0, 17.0], "frequency": frequency}
    path = scene_file(scenes / "stepping_frequency.yaml", tmp_path, **changes)
    bag = in_lockstep(path, tmp_path / "run")
    found = stages(open_run(bag.path))
    assert [round(stage.identified_frequency, 2) for stage in found] == [5.25, 5.47, 3.2]
    assert [(stage.t0, stage.t1) for stage in found] == [(1.0, 5.0), (5.01, 10.0), (10.01, 17.0)]
    assert found[0].efficiency > 0.55
    assert found[1].efficiency == pytest.approx(0.795, abs=0.02)
    assert found[2].height == pytest.approx(0.017, abs=1e-6)
    steady = DamperResponse(load_scene(path).with_(frequency=3.2)).closed_amplitude(0.015)
    assert found[2].amplitude == pytest.approx(steady, rel=0.1)  # swings of 5.5 Hz die out in seconds
    assert kinds(bag, since=4.0)["excitation_changed"] == 2
    assert kinds(bag, since=4.0)["no_use"] == 1
    reasons = [message.reason for _, message in bag.messages("/ceiling/command")]
    assert any("the damper is of no use at 0.015 m and 3.2 Hz" in reason for reason in reasons)


def test_two_tones_are_refused_with_a_sentence_and_the_ceiling_stays(scenes: Path, tmp_path: Path) -> None:
    t = np.arange(0.0, 6.001, 0.001)
    grown = np.clip(t, 0.0, 1.0)
    support = 0.015 * grown * np.sin(2.0 * np.pi * 5.47 * t) + 0.006 * grown * np.sin(2.0 * np.pi * 7.1 * t)
    np.savetxt(tmp_path / "support.csv", np.column_stack([t, support]), delimiter=",", comments="",
               header="time,support_displacement")  # fmt: skip
    changes = {"excitation": {"series": {"file": str(tmp_path / "support.csv")}}, "duration": 6.0}
    path = scene_file(scenes / "drifting_frequency.yaml", tmp_path, **changes, steady_window=[5.0, 6.0])
    bag = in_lockstep(path, tmp_path / "run")
    assert unanswered_blocks(open_run(bag.path)) == 0
    (event,) = [event for _, event in bag.messages("/events") if event.kind == "two_tones"]
    assert event.node == "identifier_node"
    assert "two tones excite the structure" in event.text
    seen = event.header.stamp.sec + 1e-9 * event.header.stamp.nanosec
    assert seen < 3.5
    late = [message for _, message in bag.messages("/ceiling/command")][round(seen / 0.05) :]
    assert len({message.sequence for message in late}) == 1
    assert {message.reason for message in late[1:]} == {"poor estimate"}
    assert kinds(bag, since=seen)["refused"] == 1
