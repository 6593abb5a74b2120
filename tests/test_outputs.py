# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What cannot be written is one line and status 2, for every user, and before the work."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from atpid_common.output import OutputError, file, folder, writing
from atpid_control.cli import main as atpid
from atpid_sim.maps import HeightMap
from studies.cli import main as studies

#: A folder in which no user can make anything, root included.
NOWHERE = "/proc/nowhere"
READINGS = "position,volts\n-0.1,1\n0,3\n0.1,5\n0.12,5.4\n0.05,4\n-0.05,2\n0.02,3.4\n"
MAP = ["map", "scenes/standard.yaml", "--amplitudes", "0.01:0.02:2", "--mass-fractions", "0.1"]
STRUCTURE = ["--mass", "2", "--frequency", "15", "--damping", "0.02", "--amplitudes", "0.001:0.004"]
SENSOR = ["--channel", "support_displacement", "--sensor", "X", "--serial", "A"]


@pytest.mark.parametrize(
    ("main", "arguments"),
    [
        (studies, ["tradeoff", "scenes/standard.yaml", "--out", NOWHERE]),
        (studies, ["extremes", "--systems", "1", "--out", NOWHERE]),
        (studies, ["atlas", "--quick", "--out", NOWHERE]),
        (atpid, ["simulate", "scenes/standard.yaml", "--series", f"{NOWHERE}/run.csv"]),
        (atpid, ["simulate", "scenes/standard.yaml", "--picture", f"{NOWHERE}/run.png"]),
        (
            atpid,
            [*MAP, "--out", "MAP", "--header", f"{NOWHERE}/table.h"],
        ),
        (studies, ["figures", "contact", "--out", NOWHERE]),
        (studies, ["figures", "free_decay", "--out", NOWHERE]),
        (studies, ["figures", "identification", "--out", NOWHERE]),
        (studies, ["figures", "selection", "--out", NOWHERE]),
        (atpid, ["bench", "scenes/standard.yaml", "--out", NOWHERE]),
        (atpid, ["bag", "report", "bags/thesis_4_3_short", "--out", NOWHERE]),
        (atpid, ["design", *STRUCTURE, "--out", NOWHERE]),
        (
            atpid,
            ["calibrate", "beam", "bags/thesis_4_3_short", "--moving-mass", "0.36", "--out", f"{NOWHERE}/beam.yaml"],
        ),
        (atpid, ["calibrate", "sensor", "READINGS", *SENSOR, "--out", f"{NOWHERE}/laser.yaml"]),
        (atpid, ["calibrate", "sensor", "READINGS", *SENSOR, "--out", "OUT", "--picture", f"{NOWHERE}/laser.png"]),
        (atpid, ["calibrate", "reading", f"{NOWHERE}/readings.csv", "--position", "0.1", "--terminal", "AIN0"]),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, list) else "",
)
def test_a_place_that_cannot_be_written_is_one_line(
    main: Callable[[list[str]], int],
    arguments: list[str],
    root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(root)
    (tmp_path / "readings.csv").write_text(READINGS)
    places = {"READINGS": tmp_path / "readings.csv", "OUT": tmp_path / "laser.yaml", "MAP": tmp_path / "map.npz"}
    assert main([str(places.get(word, word)) for word in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("error: ")
    assert NOWHERE in printed.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["readings.csv"]


def test_a_new_folder_is_made_for_the_beam_s_parameters(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "beam.yaml"
    found = atpid(
        ["calibrate", "beam", str(root / "bags/thesis_4_3_short"), "--moving-mass", "0.36", "--out", str(out)]
    )
    printed = capsys.readouterr().err
    assert out.parent.is_dir()
    assert "Traceback" not in printed
    assert (found == 0) == out.is_file()


@pytest.mark.slow
def test_a_disk_that_fills_up_costs_no_point_of_a_map(root: Path, tmp_path: Path) -> None:
    """A file that may not grow stands for the full disk: the same command goes on from what is in the journal."""
    out = tmp_path / "map.npz"
    command = ["atpid", "map", str(root / "scenes/standard.yaml")]
    command += ["--amplitudes", "0.01:0.012:12", "--mass-fractions", "0.1", "--out", str(out)]
    # first in another file, so that the kernels are compiled: they are kept in files as well
    subprocess.run([*command[:-1], str(tmp_path / "first.npz")], capture_output=True, check=True)
    full = subprocess.run(["sh", "-c", 'ulimit -f 2; exec "$@"', "sh", *command], capture_output=True, text=True)
    assert full.returncode == 2
    assert "Traceback" not in full.stderr
    line = full.stderr.strip().splitlines()[-1]
    assert line.startswith("error: ")
    assert "make room and give the same command: it goes on" in line
    journal = Path(f"{out}.journal")
    kept = journal.read_bytes().count(b"\n") - 1
    assert 0 < kept < 12
    assert not out.exists()
    again = subprocess.run(command, capture_output=True, text=True)
    assert again.returncode == 0, again.stderr
    assert HeightMap.load(out).heights.shape == (1, 12)
    assert not journal.exists()


def test_files_and_folders_that_are_the_other(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file; give a folder to --out"):
        folder(tmp_path / "file")
    with pytest.raises(OutputError, match="is a folder; give a file to --series"):
        file(tmp_path, "--series")
    with pytest.raises(OutputError, match="is a file; choose another --out"):
        file(tmp_path / "file" / "below")
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"), writing(tmp_path / "x"):
        (tmp_path / "none" / "x").write_text("")
    assert folder(tmp_path / "a" / "b").is_dir()
    assert list((tmp_path / "a" / "b").iterdir()) == []
