# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The soak: its schedule, its trends against known slopes, orphaned shared memory, and a short one end to end."""

import fcntl
import io
import json
import mmap
import os
import time
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
import yaml

from atpid_control.stand.errors import BenchError
from atpid_sim.scene import load_scene, scene_from_mapping
from atpid_sim.system import Array
from studies.cli import main
from studies.soak import segments
from studies.soak.delays import delays
from studies.soak.run import lost_of
from studies.soak.schedule import fault_times, leg_mapping, legs_of, points
from studies.soak.trends import Trend, trend

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "scenes" / "thesis_4_3.yaml"


def test_a_schedule_rises_in_time_and_ends_with_the_leg() -> None:
    for seed, duration in enumerate(np.geomspace(2.0, 5_000.0, 20)):
        times, amplitudes = zip(*points(np.random.default_rng(seed), duration, 0.04), strict=True)
        assert (times[0], times[-1]) == (0.0, duration)
        assert np.diff(times).min() > 0.0
        assert all(amplitude == 0.0 or 0.01 <= amplitude <= 0.04 for amplitude in amplitudes)
        kinds = [{"part": "support_laser", "kind": "off"}, {"part": "motor", "kind": "stuck"}]
        found = fault_times(np.random.default_rng(seed), 600.0, kinds)
        assert {fault["part"] for fault in found} == {"support_laser", "motor"}
        bounds = [bound for fault in found for bound in (fault["from"], fault["to"])]
        assert bounds == sorted(bounds)
        assert bounds[-1] < 600.0
    assert legs_of(2.5, 1.0) == [3600.0, 3600.0, 1800.0]


def test_a_leg_is_a_scene_of_its_own_that_a_seed_repeats(tmp_path: Path) -> None:
    scene = load_scene(SCENE)
    one, same, other = (leg_mapping(scene, 600.0, seed, leg) for seed, leg in ((1, 0), (1, 0), (1, 1)))
    assert one == same
    assert one["excitation"] != other["excitation"]
    made = scene_from_mapping(yaml.safe_load(yaml.safe_dump(one)), source="leg", folder=tmp_path)
    assert (made.duration, made.ceiling, made.beam) == (600.0, scene.ceiling, scene.beam)
    with pytest.raises(BenchError, match="controller"):
        leg_mapping(load_scene(ROOT / "scenes" / "standard.yaml"), 60.0, 1, 0)


TIMES = np.linspace(0.0, 3600.0, 400)


def noisy(slope: float, seed: int = 0) -> Array:
    """Return an hour of samples of a line [1/h] with correlated noise, as memory has."""
    noise = np.convolve(np.random.default_rng(seed).normal(size=420), np.ones(21) / 21.0, "valid")
    return 300.0 + slope * TIMES / 3600.0 + noise


def trend_of(*legs: Array, least: float = 1.0) -> Trend:
    numbers = np.repeat(np.arange(len(legs)), 400).tolist()
    times, values = np.tile(TIMES, len(legs)).tolist(), np.concatenate(legs).tolist()
    return trend("memory", "MB", numbers, times, values, least=least)


def test_a_growth_is_measured_to_its_error() -> None:
    found = trend_of(noisy(5.0))
    assert found.grows
    assert found.slope == pytest.approx(5.0, abs=3.0 * found.error)
    assert found.error < 0.5


def test_what_is_flat_an_offset_between_legs_and_the_warm_up_are_no_growth() -> None:
    assert sum(trend_of(noisy(0.0, seed), least=0.0).significant for seed in range(200)) <= 2
    offset = trend_of(noisy(0.0, 1), noisy(0.0, 2) + 50.0)
    assert not offset.grows
    assert abs(offset.slope) < 1.0
    assert not trend_of(noisy(0.0) - 100.0 * np.exp(-TIMES / 60.0) * (TIMES < 700.0)).grows


SEGMENT, PORT = "fastrtps_0123456789abcdef", "fastrtps_port7413"


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    """Return a folder as /dev/shm is, an hour old: a segment, a port, another program's file."""
    for name in (SEGMENT, f"{SEGMENT}_el", PORT, f"{PORT}_el", f"sem.{PORT}_mutex", "fastrtps_of_others", "psm_1"):
        (tmp_path / name).write_bytes(bytes(4096))
        os.utime(tmp_path / name, (time.time() - 3600.0,) * 2)
    return tmp_path


def test_what_no_process_uses_is_removed_and_nothing_else(memory: Path) -> None:
    with (memory / f"{SEGMENT}_el").open("r+") as locked:
        fcntl.flock(locked, fcntl.LOCK_EX)
        assert set(segments.orphans(memory)) == {PORT}
    with (memory / PORT).open("r+b") as file, mmap.mmap(file.fileno(), 4096):
        file.close()
        assert set(segments.orphans(memory)) == {SEGMENT}
    assert len(segments.present(memory)) == 2
    assert segments.clean(memory) == 2
    assert sorted(path.name for path in memory.iterdir()) == ["fastrtps_of_others", "psm_1"]


@pytest.mark.parametrize(
    ("made", "age", "left"),  # a port at any age: another run may be about to open it
    [(PORT, 10.0, {SEGMENT}), (PORT, 0.0, {SEGMENT}), (SEGMENT, 10.0, {PORT}), (SEGMENT, 0.0, {PORT, SEGMENT})],
)
def test_what_was_made_just_now_stays(memory: Path, made: str, age: float, left: set[str]) -> None:
    os.utime(memory / made)
    assert set(segments.orphans(memory, age)) == left


@pytest.mark.wall_time
def test_a_short_soak_runs_its_legs_and_leaves_nothing(tmp_path: Path) -> None:
    """Two legs of 2.7 s, whose bags are kept; alone, since tests that kill nodes leave shared memory, too."""
    out = tmp_path / "out"
    with redirect_stdout(io.StringIO()):
        assert main(["soak", str(SCENE), "--out", str(out), "--hours", "0.0015", "--leg", "0.00075", "--keep"]) == 0
    found = json.loads((out / "soak.json").read_text())
    assert [leg["lost"] for leg in found["legs"]] == [0, 0]
    assert lost_of("bag: 3 findings; 10 blocks answered, 4000 scans, 150 lost; ceiling") == 150
    assert [leg["findings"] for leg in found["legs"]] == [[], []]
    assert all({"54", "answered,"} <= set(leg["check"].split()) for leg in found["legs"])
    assert (found["segments_left"], found["stopped"]) == (0, "")
    assert {row["name"] for row in found["trends"]} >= {"memory", "handles", "threads", "shared-memory segments"}
    assert {row["verdict"].split()[-1] for row in found["trends"]} == {"short"}
    assert (out / "soak.png").is_file()
    (delay,) = delays(out / "leg-0001" / "bag")
    assert delay.largest == 0.0  # in lockstep
