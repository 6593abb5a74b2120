# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole graph: lockstep repeats itself, the thesis's adaptive bench is met, and other ceilings run as well."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_runs import decoded, in_lockstep, parameters, scene_file

from atpid_control.runs.read import Bag
from atpid_control.runs.run import open_run
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.running import run_lockstep
from atpid_control.stand.summary import lost_scans, unanswered_blocks
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene

LOOP = ("/sensors/laser", "/plant/truth", "/excitation", "/ceiling/command", "/ceiling/state", "/events")


@pytest.fixture(scope="module")
def adaptive(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Bag:
    """The bag of the thesis's adaptive bench."""
    return in_lockstep(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("adaptive"))


@pytest.mark.slow
def test_two_runs_with_the_same_seed_give_the_same_messages(scenes: Path, tmp_path: Path) -> None:
    steps = [[0.0, 0.0], [0.3, 0.015], [1.5, 0.015], [2.0, 0.02]]
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, duration=2.5, steady_window=[2.0, 2.5], amplitude=steps)
    first, again = (in_lockstep(path, tmp_path / name) for name in ("first", "again"))
    assert [raw.topic for raw in first.raw] == [raw.topic for raw in again.raw]
    for topic in LOOP:
        assert decoded(first, topic) == decoded(again, topic), topic
    assert len(decoded(first, "/sensors/laser")) == 50


@pytest.mark.slow
def test_every_block_is_there_and_answered(adaptive: Bag) -> None:
    assert float(adaptive.result["data_s"]) == 20.0
    assert lost_scans(open_run(adaptive.path)) == 0
    assert unanswered_blocks(open_run(adaptive.path)) == 0
    assert {topic: len(decoded(adaptive, topic)) for topic in LOOP[:-1]} == dict.fromkeys(LOOP[:-1], 400)


def test_stamps_are_those_of_the_samples_and_answers_carry_them(adaptive: Bag) -> None:
    ends = [
        (message.first_index + len(message.data) // 2 - 1) / message.rate for _, message in adaptive.messages(LOOP[0])
    ]
    for topic in LOOP[2:5]:
        stamps = [message.header.stamp for _, message in adaptive.messages(topic)]
        assert [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps] == pytest.approx(ends, abs=1e-9), topic


# stage: end [s], excitation [m], best height by brute force [m], closed damper's amplitude [m]
STAGES = [(6.0, 0.015, 0.29, 0.333), (13.0, 0.04, 0.76, 0.888), (20.0, 0.03, 0.57, 0.666)]


@pytest.mark.parametrize(("end", "excitation", "height", "closed"), STAGES)
def test_the_adaptive_bench_of_the_thesis(
    adaptive: Bag, end: float, excitation: float, height: float, closed: float
) -> None:
    truth = [message for _, message in adaptive.messages("/plant/truth")]
    window = slice(round((end - 2.0) * 1000.0), round(end * 1000.0))
    beam = np.concatenate([message.beam for message in truth])[window]
    ceiling = np.concatenate([message.ceiling for message in truth])[window]
    blocks = slice(round((end - 2.0) * 20.0), round(end * 20.0))
    estimates = [message for _, message in adaptive.messages("/excitation")][blocks]
    assert [message.amplitude for message in estimates] == pytest.approx([excitation] * len(estimates), rel=0.01)
    assert ceiling[-1] == pytest.approx(height, rel=0.05)
    assert 0.5 * np.ptp(beam) <= 0.24 * closed


def test_the_energy_ledger_closes(adaptive: Bag) -> None:
    last = [message for _, message in adaptive.messages("/plant/truth")][-1]
    out = last.beam_loss + last.contact_loss + last.stored_energy
    assert last.input_energy + last.ceiling_work == pytest.approx(out, rel=1e-5)


def test_the_true_ceiling_follows_the_motor(adaptive: Bag) -> None:
    truth = [message for _, message in adaptive.messages("/plant/truth")]
    states = [message for _, message in adaptive.messages("/ceiling/state")]
    gaps = [abs(true.ceiling[-1] - state.height) for true, state in zip(truth, states, strict=True)]
    assert max(gaps) <= 0.3 * 0.0015  # one sample's travel: the motor's clock starts at the last sample, not after it


@pytest.mark.slow
def test_a_map_that_lies_too_high_is_left_by_stepping_back(scenes: Path, tmp_path: Path) -> None:
    shipped = map_for(load_scene(scenes / "thesis_4_3.yaml"))
    assert shipped is not None
    good = HeightMap.load(shipped)
    replace(good, heights=1.08 * good.heights).save(tmp_path / "high.npz")
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup", "map": "high.npz"}
    changes = {"duration": 10.0, "steady_window": [8.0, 10.0], "ceiling": ceiling, "amplitude": 0.015}
    bag = in_lockstep(scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes), tmp_path / "run")
    kinds = [event.kind for _, event in bag.messages("/events")]
    assert "rumble" in kinds
    assert "step_back" in kinds
    beam = np.concatenate([message.beam for _, message in bag.messages("/plant/truth")])
    assert 0.5 * np.ptp(beam[8000:]) <= 0.3 * 0.333


@pytest.mark.parametrize("ceiling", [{"height": 0.1}, {"closed": 0.017, "open": 0.1, "start": 0.2, "end": 0.5}])
def test_a_ceiling_without_a_controller_follows_the_scene(
    scenes: Path, tmp_path: Path, ceiling: dict[str, float]
) -> None:
    changes = {"duration": 1.0, "steady_window": [0.5, 1.0], "ceiling": ceiling}
    bag = in_lockstep(scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes), tmp_path / "run")
    truth = [message for _, message in bag.messages("/plant/truth")]
    states = [message for _, message in bag.messages("/ceiling/state")]
    assert truth[-1].ceiling[-1] == pytest.approx(0.1)
    assert states[-1].height == pytest.approx(0.1)
    assert {message.method for _, message in bag.messages("/ceiling/command")} == {"fixed"}


def test_a_second_sensor_is_recorded_at_its_own_rate(scenes: Path, tmp_path: Path) -> None:
    sensors = {"laser": {"rate": 1000.0}, "accelerometer": {"rate": 1600.0, "noise": 0.05}}
    changes = {"duration": 1.0, "steady_window": [0.5, 1.0], "sensors": sensors}
    bag = in_lockstep(scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes), tmp_path / "run")
    blocks = [message for _, message in bag.messages("/sensors/accelerometer")]
    assert [len(message.data) for message in blocks] == [80] * 20
    assert lost_scans(open_run(bag.path)) == 0


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
