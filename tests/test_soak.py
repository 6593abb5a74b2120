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
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_control.stand.errors import BenchError
from atpid_sim.scene import Scene, load_scene, scene_from_mapping
from studies.cli import main
from studies.soak import segments
from studies.soak.delays import delays
from studies.soak.measure import Sampler, processes
from studies.soak.run import lost_of
from studies.soak.schedule import fault_times, leg_mapping, legs_of, points
from studies.soak.trends import trend

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "thesis_4_3.yaml")


# the schedule


@given(seed=st.integers(0, 2**32), duration=st.floats(2.0, 5_000.0))
@settings(max_examples=50, deadline=None)
def test_a_schedule_rises_in_time_and_ends_with_the_leg(seed: int, duration: float) -> None:
    found = points(np.random.default_rng(seed), duration, 0.04)
    times, amplitudes = zip(*found, strict=True)
    assert times[0] == 0.0
    assert times[-1] == duration
    assert all(after > before for before, after in pairwise(times))
    assert all(amplitude == 0.0 or 0.01 <= amplitude <= 0.04 for amplitude in amplitudes)


def test_a_leg_is_a_scene_of_its_own_that_a_seed_repeats(scene: Scene, tmp_path: Path) -> None:
    one, same, other = (leg_mapping(scene, 600.0, seed, leg) for seed, leg in ((1, 0), (1, 0), (1, 1)))
    assert one == same
    assert one["excitation"] != other["excitation"]
    made = scene_from_mapping(yaml.safe_load(yaml.safe_dump(one)), source="leg", folder=tmp_path)
    assert made.duration == 600.0
    assert made.ceiling == scene.ceiling
    assert made.beam == scene.beam


def test_pauses_and_stages_both_occur() -> None:
    amplitudes = [amplitude for _, amplitude in points(np.random.default_rng(1), 3_600.0, 0.04)]
    share = sum(amplitude == 0.0 for amplitude in amplitudes) / len(amplitudes)
    assert 0.05 < share < 0.4


def test_faults_follow_one_another_inside_the_leg() -> None:
    kinds = [{"part": "support_laser", "kind": "off"}, {"part": "motor", "kind": "stuck"}]
    found = fault_times(np.random.default_rng(3), 600.0, kinds)
    assert {fault["part"] for fault in found} == {"support_laser", "motor"}
    bounds = [bound for fault in found for bound in (fault["from"], fault["to"])]
    assert bounds == sorted(bounds)
    assert bounds[-1] < 600.0


def test_a_scene_without_a_controller_is_refused() -> None:
    with pytest.raises(BenchError, match="controller"):
        leg_mapping(load_scene(ROOT / "scenes" / "standard.yaml"), 60.0, 1, 0)


def test_the_legs_add_up() -> None:
    assert legs_of(2.5, 1.0) == [3600.0, 3600.0, 1800.0]
    assert legs_of(24.0, 1.0) == [3600.0] * 24
    assert legs_of(0.01, 1.0) == [36.0]


# trends


def noisy(slope: float, seed: int = 0, offset: float = 0.0) -> tuple[list[float], list[float]]:
    """Return an hour of samples [s] of a line [1/h] with correlated noise, as memory has."""
    random = np.random.default_rng(seed)
    times = np.linspace(0.0, 3600.0, 400)
    noise = np.convolve(random.normal(size=420), np.ones(21) / 21.0, "valid")
    return times.tolist(), (300.0 + offset + slope * times / 3600.0 + noise).tolist()


def test_a_growth_is_measured_to_its_error() -> None:
    found = trend("memory", "MB", [0] * 400, *noisy(5.0), least=1.0)
    assert found.grows
    assert found.slope == pytest.approx(5.0, abs=3.0 * found.error)
    assert found.error < 0.5


def test_what_is_flat_is_called_flat() -> None:
    found = [trend("memory", "MB", [0] * 400, *noisy(0.0, seed), least=0.0) for seed in range(200)]
    assert sum(one.significant for one in found) <= 2


def test_an_offset_between_legs_is_no_slope_within_them() -> None:
    first, second = noisy(0.0, 1), noisy(0.0, 2, offset=50.0)
    found = trend("memory", "MB", [0] * 400 + [1] * 400, first[0] + second[0], first[1] + second[1], least=1.0)
    assert not found.grows
    assert abs(found.slope) < 1.0


def test_the_warm_up_is_left_out() -> None:
    times, values = noisy(0.0)
    warming = [value - 100.0 * np.exp(-time / 60.0) * (time < 700.0) for time, value in zip(times, values, strict=True)]
    assert not trend("memory", "MB", [0] * 400, times, warming, least=1.0).grows


def test_too_little_gives_no_verdict() -> None:
    found = trend("memory", "MB", [0, 0], [0.0, 1.0], [1.0, 2.0], least=0.0)
    assert found.verdict == "too short"
    assert not found.grows


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
        name, found = Path(sys.executable).name, processes()
        while name not in found:  # it has no name while it begins
            found = processes()
        child.communicate(b"\n")
    assert "bench" in found


# shared memory


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    """Return a folder as /dev/shm is, an hour old: a segment, a port, another program's file."""
    for name in ("fastrtps_0123456789abcdef", "fastrtps_0123456789abcdef_el", "fastrtps_port7413",
                 "fastrtps_port7413_el", "sem.fastrtps_port7413_mutex", "fastrtps_of_others", "psm_1"):  # fmt: skip
        path = tmp_path / name
        path.write_bytes(bytes(4096))
        os.utime(path, (time.time() - 3600.0,) * 2)
    return tmp_path


def test_what_no_process_uses_is_removed_and_nothing_else(memory: Path) -> None:
    assert len(segments.present(memory)) == 2
    assert segments.clean(memory) == 2
    assert sorted(path.name for path in memory.iterdir()) == ["fastrtps_of_others", "psm_1"]


def test_a_segment_whose_lock_is_held_stays(memory: Path) -> None:
    with (memory / "fastrtps_0123456789abcdef_el").open("r+") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert set(segments.orphans(memory)) == {"fastrtps_port7413"}


def test_a_port_that_is_mapped_stays(memory: Path) -> None:
    with (memory / "fastrtps_port7413").open("r+b") as file, mmap.mmap(file.fileno(), 4096):
        file.close()
        assert set(segments.orphans(memory)) == {"fastrtps_0123456789abcdef"}


@pytest.mark.parametrize(("made", "age", "left"), [
    ("fastrtps_port7413", 10.0, {"fastrtps_0123456789abcdef"}),
    ("fastrtps_port7413", 0.0, {"fastrtps_0123456789abcdef"}),  # another run may be about to open it
    ("fastrtps_0123456789abcdef", 10.0, {"fastrtps_port7413"}),
    ("fastrtps_0123456789abcdef", 0.0, {"fastrtps_port7413", "fastrtps_0123456789abcdef"}),
])  # fmt: skip
def test_what_was_made_just_now_stays(memory: Path, made: str, age: float, left: set[str]) -> None:
    os.utime(memory / made)
    assert set(segments.orphans(memory, age)) == left


# end to end


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A soak of two legs of 3.6 s, whose bags are kept: its folder and what it printed."""
    out, printed = tmp_path_factory.mktemp("soak") / "out", io.StringIO()
    command = ["soak", str(ROOT / "scenes" / "thesis_4_3.yaml"), "--out", str(out)]
    with redirect_stdout(printed):
        assert main([*command, "--hours", "0.002", "--leg", "0.001", "--keep"]) == 0
    return out, printed.getvalue()


@pytest.mark.slow
def test_a_short_soak_runs_its_legs_and_leaves_nothing(short: tuple[Path, str]) -> None:
    out, printed = short
    found = json.loads((out / "soak.json").read_text())
    assert [leg["lost"] for leg in found["legs"]] == [0, 0]
    assert all("no findings; 72 blocks answered" in leg["check"] for leg in found["legs"])
    assert found["segments_left"] == 0
    assert found["stopped"] == ""
    assert {row["name"] for row in found["trends"]} >= {"memory", "handles", "threads", "shared-memory segments"}
    assert all(row["verdict"] == "too short" for row in found["trends"])
    assert (out / "soak.png").stat().st_size > 10_000
    assert "too short for a trend" in printed


@pytest.mark.slow
def test_the_delay_of_a_bag_in_lockstep_is_nothing(short: tuple[Path, str]) -> None:
    (one,) = delays(short[0] / "leg-0001" / "bag")
    assert one.largest == 0.0


@pytest.mark.slow
def test_ctrl_c_ends_a_soak_with_what_there_is(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "studies", "soak", str(ROOT / "scenes" / "thesis_4_3.yaml"),
               "--hours", "2", "--out", str(out)]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        bag, deadline = out / "leg-0001" / "bag" / "bag_0.mcap", time.monotonic() + 300.0
        try:
            while not (bag.exists() and bag.stat().st_size > 100_000):
                assert running.poll() is None, "it ended by itself"
                assert time.monotonic() < deadline, "its bag did not grow"
                time.sleep(0.05)
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=200)
        finally:
            running.kill()
    assert running.returncode == 130, errors
    assert "stopped by Ctrl-C or a signal" in errors
    assert json.loads((out / "soak.json").read_text())["segments_left"] == 0
    assert (bag.parent / "metadata.yaml").exists()  # closed


@pytest.mark.parametrize(("more", "words"), [
    (("--hours", "nan"), "allowed: "),
    (("--hours", "-1"), "allowed: "),
    (("--hours", "1", "--seed", "-1"), "--seed: given -1"),
    (("--hours", "1", "--faults", "/dev/null"), "a YAML list of faults"),
])  # fmt: skip
def test_nonsense_is_one_line(
    tmp_path: Path, more: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(ROOT / "scenes" / "thesis_4_3.yaml")
    assert main(["soak", scene, "--out", str(tmp_path / "out"), *more]) == 2
    assert words in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out").exists()


def test_the_lost_scans_are_read_from_the_line() -> None:
    assert lost_of("bag: 3 findings; 10 blocks answered, 4000 scans, 150 lost; ceiling") == 150
