# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The soak: its schedule, its trends against known slopes, orphaned shared memory, and a short one end to end."""

import fcntl
import io
import json
import mmap
import os
import signal
import subprocess
import sys
import time
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from graph_runs import wait_until
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_control.stand.errors import BenchError
from atpid_sim.scene import load_scene, scene_from_mapping
from atpid_sim.system import Array
from studies.cli import main
from studies.soak import segments
from studies.soak.delays import delays
from studies.soak.measure import Sampler, processes
from studies.soak.run import lost_of
from studies.soak.schedule import fault_times, leg_mapping, legs_of, points
from studies.soak.trends import Trend, trend

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "scenes" / "thesis_4_3.yaml"


# the schedule


@given(seed=st.integers(0, 2**32), duration=st.floats(2.0, 5_000.0))
@settings(max_examples=50)
def test_a_schedule_rises_in_time_and_ends_with_the_leg(seed: int, duration: float) -> None:
    times, amplitudes = zip(*points(np.random.default_rng(seed), duration, 0.04), strict=True)
    assert (times[0], times[-1]) == (0.0, duration)
    assert all(after > before for before, after in pairwise(times))
    assert all(amplitude == 0.0 or 0.01 <= amplitude <= 0.04 for amplitude in amplitudes)


def test_a_leg_is_a_scene_of_its_own_that_a_seed_repeats(tmp_path: Path) -> None:
    scene = load_scene(SCENE)
    one, same, other = (leg_mapping(scene, 600.0, seed, leg) for seed, leg in ((1, 0), (1, 0), (1, 1)))
    assert one == same
    assert one["excitation"] != other["excitation"]
    made = scene_from_mapping(yaml.safe_load(yaml.safe_dump(one)), source="leg", folder=tmp_path)
    assert (made.duration, made.ceiling, made.beam) == (600.0, scene.ceiling, scene.beam)
    with pytest.raises(BenchError, match="controller"):
        leg_mapping(load_scene(ROOT / "scenes" / "standard.yaml"), 60.0, 1, 0)


def test_pauses_occur_faults_follow_one_another_and_legs_add_up() -> None:
    amplitudes = [amplitude for _, amplitude in points(np.random.default_rng(1), 3_600.0, 0.04)]
    assert 0.05 < amplitudes.count(0.0) / len(amplitudes) < 0.4
    kinds = [{"part": "support_laser", "kind": "off"}, {"part": "motor", "kind": "stuck"}]
    found = fault_times(np.random.default_rng(3), 600.0, kinds)
    assert {fault["part"] for fault in found} == {"support_laser", "motor"}
    bounds = [bound for fault in found for bound in (fault["from"], fault["to"])]
    assert bounds == sorted(bounds)
    assert bounds[-1] < 600.0
    assert legs_of(2.5, 1.0) == [3600.0, 3600.0, 1800.0]
    assert legs_of(24.0, 1.0) == [3600.0] * 24
    assert legs_of(0.01, 1.0) == [36.0]


# trends

TIMES = np.linspace(0.0, 3600.0, 400)


def noisy(slope: float, seed: int = 0) -> Array:
    """Return an hour of samples of a line [1/h] with correlated noise, as memory has."""
    noise = np.convolve(np.random.default_rng(seed).normal(size=420), np.ones(21) / 21.0, "valid")
    return 300.0 + slope * TIMES / 3600.0 + noise


def trend_of(*legs: "np.ndarray[tuple[int], np.dtype[np.float64]]", least: float = 1.0) -> Trend:
    numbers = np.repeat(np.arange(len(legs)), 400).tolist()
    return trend(
        "memory", "MB", numbers, np.tile(TIMES, len(legs)).tolist(), np.concatenate(legs).tolist(), least=least
    )


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


def test_files_opened_and_memory_taken_show_in_the_samples() -> None:
    sampler = Sampler(1.0)
    shown: list[float] = []
    progress = sampler.following(shown.append)
    progress(0.0)
    # mapped and not allocated: the allocator may have so much left over from other tests
    taken = np.frombuffer(mmap.mmap(-1, 40_000_000), dtype=np.uint8)
    taken[:] = 1
    with Path("/dev/null").open() as _:
        progress(1.0)
    progress(1.5)  # not due
    first, second = sampler.samples
    assert shown == [0.0, 1.0, 1.5]
    assert second.total.handles == first.total.handles + 1
    assert second.total.memory - first.total.memory > 0.8 * taken.nbytes / 1e6


def test_a_process_that_was_started_is_counted() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        wait_until(lambda: Path(sys.executable).name in processes())  # it has no name while it begins
        child.communicate(b"\n")
    assert "bench" in processes()


# shared memory

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


@pytest.mark.parametrize(("made", "age", "left"), [
    (PORT, 10.0, {SEGMENT}), (PORT, 0.0, {SEGMENT}),  # another run may be about to open it
    (SEGMENT, 10.0, {PORT}), (SEGMENT, 0.0, {PORT, SEGMENT}),
])  # fmt: skip
def test_what_was_made_just_now_stays(memory: Path, made: str, age: float, left: set[str]) -> None:
    os.utime(memory / made)
    assert set(segments.orphans(memory, age)) == left


# end to end


def test_a_short_soak_runs_its_legs_and_leaves_nothing(tmp_path: Path) -> None:
    """Two legs of 2.7 s, whose bags are kept."""
    out = tmp_path / "out"
    with redirect_stdout(io.StringIO()) as printed:
        assert main(["soak", str(SCENE), "--out", str(out), "--hours", "0.0015", "--leg", "0.00075", "--keep"]) == 0
    found = json.loads((out / "soak.json").read_text())
    assert [leg["lost"] for leg in found["legs"]] == [0, 0]
    assert [leg["findings"] for leg in found["legs"]] == [[], []]
    assert all({"54", "answered,"} <= set(leg["check"].split()) for leg in found["legs"])
    assert (found["segments_left"], found["stopped"]) == (0, "")
    assert {row["name"] for row in found["trends"]} >= {"memory", "handles", "threads", "shared-memory segments"}
    assert {row["verdict"].split()[-1] for row in found["trends"]} == {"short"}
    assert (out / "soak.png").stat().st_size > 10_000
    assert "short" in printed.getvalue()
    (delay,) = delays(out / "leg-0001" / "bag")
    assert delay.largest == 0.0  # in lockstep


def test_ctrl_c_ends_a_soak_with_what_there_is(tmp_path: Path) -> None:
    out = tmp_path / "out"
    bag = out / "leg-0001" / "bag" / "bag_0.mcap"
    command = [sys.executable, "-m", "studies", "soak", str(SCENE), "--hours", "2", "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        try:
            wait_until(lambda: bag.exists() and bag.stat().st_size > 100_000, running, timeout=500.0)
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate()
        finally:
            running.kill()
    assert running.returncode == 130, errors
    assert "Ctrl-C" in errors
    assert json.loads((out / "soak.json").read_text())["segments_left"] == 0
    assert (bag.parent / "metadata.yaml").exists()  # closed


@pytest.mark.parametrize(("more", "words"), [
    ("--hours nan", {"--hours:", "nan;"}),
    ("--hours -1", {"--hours:", "-1;"}),
    ("--hours 1 --seed -1", {"--seed:", "-1;"}),
    ("--hours 1 --faults /dev/null", {"--faults:", "YAML"}),
])  # fmt: skip
def test_nonsense_is_one_line(tmp_path: Path, more: str, words: set[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", str(SCENE), "--out", str(tmp_path / "out"), *more.split()]) == 2
    assert words <= set(capsys.readouterr().err.splitlines()[-1].split())
    assert not (tmp_path / "out").exists()


def test_the_lost_scans_are_read_from_the_line() -> None:
    assert lost_of("bag: 3 findings; 10 blocks answered, 4000 scans, 150 lost; ceiling") == 150
