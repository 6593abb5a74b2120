# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A map that was killed goes on where it stopped, and what is in its journal is not computed again."""

import fcntl
import json
import signal
import subprocess
from pathlib import Path

import pytest
from sim_program import PROGRAM

from atpid_sim.maps import Best, DamperResponse, HeightMap, build, build_map
from atpid_sim.maps.best import best_height
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.journal import JournalError

ROOT = Path(__file__).parents[2]
SCENE = ROOT / "scenes" / "standard.yaml"


@pytest.fixture
def scene() -> Scene:
    return load_scene(SCENE)


@pytest.mark.slow
def test_a_killed_map_is_resumed_without_recomputation(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, journal = tmp_path / "map.npz", tmp_path / "map.npz.journal"
    command = [*PROGRAM, "map", str(SCENE), "--amplitudes", "0.01:0.04:61"]
    with subprocess.Popen(
        [*command, "--mass-fractions", "0.1", "--out", str(out)], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, cwd=tmp_path,
    ) as process:  # fmt: skip
        while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 3):
            try:
                process.wait(0.005)
            except subprocess.TimeoutExpired:
                continue
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not out.exists()
    # the kill may have torn the last line
    journal.write_bytes(journal.read_bytes() + b'{"point": [0.1, 0.0')
    kept = journal.read_bytes().count(b"\n") - 1
    computed = []
    original = best_height

    def counted(damper: DamperResponse, amplitude: float, hysteresis: float) -> Best:
        computed.append(amplitude)
        return original(damper, amplitude, hysteresis)

    monkeypatch.setattr(build, "best_height", counted)
    seen: list[tuple[int, int]] = []
    made = build_map(scene, [round(0.01 + 0.0005 * k, 9) for k in range(61)], [0.1], out, lambda *at: seen.append(at))
    assert 3 <= kept < 61
    assert len(computed) == 61 - kept
    assert seen[0] == (kept, 61)
    assert seen[-1] == (61, 61)
    assert not journal.exists()
    assert (HeightMap.load(out).heights == made.heights).all()


def test_the_journal_of_another_system_is_refused(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "map.npz"
    journal = tmp_path / "map.npz.journal"
    journal.write_text(json.dumps({"format": 1, "system": {"beam.mass": 1.0}, "tolerance": 1e-5}) + "\n")
    with pytest.raises(JournalError, match="begun for another system"):
        build_map(scene, [0.01, 0.02], [0.1], out)
    journal.write_text("not a journal\n")
    with pytest.raises(JournalError, match="is no journal of this command"):
        build_map(scene, [0.01, 0.02], [0.1], out)


def test_two_runs_cannot_make_the_same_map(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "map.npz"
    with (tmp_path / "map.npz.journal").open("a+b") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(JournalError, match="another run is writing it"):
            build_map(scene, [0.01, 0.02], [0.1], out)


def test_a_map_that_cannot_be_written_is_refused_before_the_work(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="cannot be written"):
        build_map(scene, [0.01, 0.02], [0.1], tmp_path / "none" / "map.npz")
