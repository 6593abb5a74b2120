# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measured series: what is read, where it begins, and the error for a file that is none."""

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene, SceneError, SeriesExcitation, load_scene
from atpid_sim.scene.series import read_series
from atpid_sim.simulation.excitation import support_rows
from atpid_sim.simulation.integration import drive_table, undamped_amplitude

TIMES = np.arange(2001) * 1e-3
VALUES = 0.01 * np.sin(2.0 * np.pi * 5.0 * TIMES)
ROWS = "".join(f"{t!r},{u!r}\n" for t, u in zip(TIMES.tolist(), VALUES.tolist(), strict=True))
HEADER = "time,support_displacement\n"
TONE = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml").with_(
    duration=2.0, steady_window=[0.0, 2.0], ceiling={"height": 0.017}
)


def scene_of(file: Path, **series: Any) -> Scene:
    return TONE.with_(excitation={"series": {"file": str(file), **series}})


def read(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    assert isinstance(scene.excitation, SeriesExcitation)
    return read_series(scene.excitation.series, scene.duration)


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def single(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("plain.csv", HEADER + ROWS),
        ("bom.csv", "\ufeff" + HEADER + ROWS),
        ("quoted.csv", '"time", "support_displacement"\r\n' + ROWS.replace("\n", "\r\n")),
        ("savetxt.csv", "# " + HEADER + ROWS),
        ("blank.csv", "\n" + HEADER + "\n" + ROWS + "# the end\n\n"),
        ("note.csv", "note," + HEADER + "".join(f"ok,{line}\n" for line in ROWS.splitlines())),
        ("arrays.npz", npz(time=TIMES, support_displacement=VALUES, note=np.array("ok"))),
        ("late.npz", npz(time=TIMES.astype(np.float64), support_displacement=VALUES + 0.0)),
    ],
)
def test_a_series_is_read(name: str, content: str | bytes, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    times, values = read(scene_of(file))
    assert np.array_equal(times, TIMES)
    assert np.array_equal(values, VALUES)


GOOD = npz(time=TIMES, support_displacement=VALUES)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("torn.npz", GOOD[:2000], ": is no NPZ archive of arrays (File is not a zip file); write it with numpy.savez("),
        ("empty.npz", b"", ": is no NPZ archive of arrays (File is not a zip file); write it with"),
        ("scalar.npz", single(3.0), ": is no NPZ archive of arrays (File is not a zip file); write it with"),
        ("pickle.npz", pickle.dumps({"time": 1}), ": is no NPZ archive of arrays (File is not a zip file)"),
        ("objects.npz", npz(time=np.array([1, None]), support_displacement=VALUES), ": is no NPZ archive of arrays"),
        ("two.npz", npz(time=TIMES, support_displacement=VALUES.reshape(-1, 3)), ": array 'support_displacement' has"),
        ("unequal.npz", npz(time=TIMES, support_displacement=VALUES[:-3]), ": given 2001 times and 1998 displ"),
        ("text.npz", npz(time=TIMES, support_displacement=VALUES.astype(str)), ": array 'support_displacement' is of"),
        ("complex.npz", npz(time=TIMES, support_displacement=VALUES + 1j), ": array 'support_displacement' is of"),
        ("other.npz", npz(t=TIMES), ": no array 'time'; it has t; name yours in excitation.series"),
        ("ragged.csv", HEADER + ROWS + "6.0\n", ":2003: 1 columns; allowed: 2, as the header names"),
        ("extra.csv", HEADER + ROWS.replace("\n", ",1\n"), ":2: 3 columns; allowed: 2, as the header names"),
        ("header.csv", HEADER, ": given 0 samples; allowed: at least 4"),
        ("empty.csv", "", ": no column 'time'; it has none; name yours"),
        ("latin.csv", HEADER.encode() + b"0,\xe9\n", ": is not text in UTF-8; save it as CSV in UTF-8"),
        ("utf16.csv", (HEADER + ROWS).encode("utf-16"), ": is not text in UTF-8"),
        ("words.csv", HEADER + ROWS + "6.0,none\n", ":2003: 'support_displacement' is 'none'; allowed: a number"),
        ("quote.csv", HEADER + ROWS + '6.0,"3\n', ":2003: not readable as CSV (unexpected end of data); save it"),
        ("twice.csv", "time," + HEADER + "0,0,0\n", ": two columns 'time'; allowed: one of each name"),
        ("line.csv", '"a\nb",c\n1,2\n', ": no column 'time'; it has a\\nb, c; name yours"),
        ("gap.csv", HEADER + ROWS + "6.0,nan\n", ": sample 2002 of 'support_displacement' is nan; allowed: finite"),
        ("back.csv", HEADER + ROWS + "1.0,0\n", ": time 1 s follows 2 s (sample 2002); allowed: times that rise by"),
        ("mm.csv", HEADER + ROWS + "6.0,1200\n", ": given up to 1200 m; allowed: 1000 m; convert to metres"),
        ("short.csv", HEADER + ROWS[: ROWS.index("1.5,")], ": lasts 1.499 s, the scene 2 s; shorten the duration"),
    ],
)  # fmt: skip
def test_what_is_no_series_is_one_line_that_names_the_file(
    name: str, content: str | bytes, expected: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SceneError) as caught:
        support_rows(scene_of(file))
    assert str(caught.value).startswith(f"{file}{expected}")
    assert "\n" not in str(caught.value)


def test_a_file_that_has_gone_is_named(tmp_path: Path) -> None:
    for name in ("gone.csv", "gone.npz"):
        file = tmp_path / name
        file.write_bytes(GOOD)
        scene = scene_of(file)
        file.unlink()
        with pytest.raises(SceneError, match=rf"{name}: no such file"):
            support_rows(scene)


@pytest.mark.parametrize(("resting", "series"), [(0.0, {}), (0.3, {}), (0.3, {"offset": 0.3}), (-0.02, {})])
def test_a_run_begins_at_rest_wherever_the_laser_reads(
    resting: float, series: dict[str, float], tmp_path: Path
) -> None:
    file = tmp_path / "laser.npz"
    np.savez(file, time=TIMES + 100.0, support_displacement=VALUES + resting)
    scene = scene_of(file, **series)
    rows = support_rows(scene)
    assert drive.support_displacement(rows, 0.0) == pytest.approx(0.0, abs=1e-15)
    middle = 0.5 * (rows[:-1, columns.START] + rows[:-1, columns.END])
    found = [drive.support_displacement(rows, t) for t in middle[::97]]
    assert np.allclose(found, 0.01 * np.sin(2.0 * np.pi * 5.0 * middle[::97]), rtol=0.0, atol=1e-10)


def test_an_offset_given_is_the_one_taken(tmp_path: Path) -> None:
    file = tmp_path / "laser.npz"
    np.savez(file, time=TIMES, support_displacement=VALUES + 0.3)
    assert read(scene_of(file, offset=0.0))[1][0] == pytest.approx(0.3)
    assert read(scene_of(file, offset=0.25))[1][0] == pytest.approx(0.05)
    lines = [line for line in scene_of(file).defaults() if "offset" in line]
    assert len(lines) == 1
    assert "the first one, so that the run begins at rest" in lines[0]
    with pytest.raises(SceneError, match=r"excitation\.series\.offset: given 1e\+300; allowed: from -1000 to 1000"):
        scene_of(file, offset=1e300)


def test_a_series_of_a_tone_moves_the_beam_as_the_tone_does(tmp_path: Path) -> None:
    file = tmp_path / "tone.npz"
    np.savez(file, time=TIMES, support_displacement=VALUES + 0.3)
    tone = TONE.with_(excitation={"amplitude": 0.01, "frequency": 5.0})
    both = [undamped_amplitude(scene, drive_table(scene, (0.0, 2.0))) for scene in (scene_of(file), tone)]
    assert both[0] == pytest.approx(both[1], rel=1e-6)
