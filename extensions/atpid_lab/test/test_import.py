# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that other programs wrote become bags: npTDMS, pyuff, scipy, h5py and pandas write, `open_run` reads."""

import io
import shutil
import struct
import sys
import wave
import zlib
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
import pyuff
from bag_files import BEAM, RATE, SUPPORT, expected, exported, written
from hypothesis import settings
from recorded import Capture, peak_of, refused
from scipy.io import savemat, wavfile

from atpid_control.cli import main
from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import Run, open_run
from atpid_control.runs.verify import verify
from atpid_lab.imports.command import import_files
from atpid_lab.imports.series import mapped, si_of

#: pyuff leaves files open that it writes.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")
START = datetime(2026, 3, 4, 5, 6, 7, tzinfo=timezone.utc)
START_NS = int(START.timestamp()) * 10**9
RATES = (10.0, 100.0, 512.0, 1000.0, 1024.0, 4096.0, 10_000.0, 51_200.0)
LONG = settings.get_current_profile_name() == "long"


def library(name: str) -> Any:
    return pytest.importorskip(name, reason="npTDMS or h5py is missing: make import")


class Made(NamedTuple):
    """What a file holds."""

    rate: float
    values: dict[str, Any]  # (n,) each, by the names that the bag must have
    dated: bool = False


def drawn(random: np.random.Generator) -> Made:
    """Return numbers whose last digits matter."""
    rows, rate, scale = random.integers(3, 401), random.choice(RATES), 10.0 ** random.integers(-9, 4)
    names = random.choice(["beam", "support", "acc1", "Kraft", "ch_3"], random.integers(1, 4), replace=False)
    values = {str(name): random.standard_normal(rows) * scale for name in names}
    return Made(float(rate), values, bool(random.integers(2)))


def table(path: Path, columns: dict[str, Any]) -> Path:
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def times_of(made: Made) -> Any:
    return np.arange(len(next(iter(made.values.values())))) / made.rate


def tdms(path: Path, made: Made) -> None:
    nptdms = library("nptdms")
    about = {"wf_increment": 1.0 / made.rate, "wf_start_offset": 0.0, "unit_string": "m"}
    about |= {"wf_start_time": np.datetime64(START.replace(tzinfo=None))} if made.dated else {}
    with nptdms.TdmsWriter(path) as writer:
        for half in (slice(None, 2), slice(2, None)):
            writer.write_segment(
                [nptdms.ChannelObject("Group", name, values[half], about) for name, values in made.values.items()]
            )


def uff(path: Path, made: Made, binary: int = 1, begin: float = 0.0) -> None:
    for node, (name, values) in enumerate(made.values.items(), 1):
        one = pyuff.prepare_58(
            binary=binary, func_type=1, rsp_node=node, rsp_dir=3, ref_node=0, ref_dir=0, data=values,
            x=times_of(made), id1=name, id3=START.strftime("%d-%b-%y %H:%M:%S") if made.dated else "none",
            rsp_ent_name="a", ref_ent_name="b", abscissa_spacing=1, abscissa_spec_data_type=17,
            ordinate_spec_data_type=8, orddenom_spec_data_type=0, z_axis_spec_data_type=0, abscissa_min=begin,
            abscissa_inc=1.0 / made.rate,
        ) | {"ordinate_axis_lab": name, "ordinate_axis_units_lab": "m"}  # fmt: skip
        pyuff.UFF(str(path)).write_sets(one, "add")


def mat_73(path: Path, made: Made) -> None:
    with library("h5py").File(path, "w", userblock_size=512) as file:
        for name, values in made.values.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("Fs", data=[[made.rate]]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("note", data=np.array([[104], [105]], np.uint16)).attrs["MATLAB_class"] = np.bytes_("char")


def mat_by_rate(path: Path, made: Made) -> None:
    savemat(path, {**made.values, "fs": made.rate, "comment": "x"})


def wav(path: Path, made: Made) -> None:
    wavfile.write(path, round(made.rate), np.column_stack(list(made.values.values())))


#: Ending of the file, writer, and how near the numbers come back.
FORMS: dict[str, tuple[str, Callable[[Path, Made], object], float]] = {
    "tdms": (".tdms", tdms, 0.0),
    "uff": (".uff", uff, 0.0),
    "uff in ascii": (".unv", lambda path, made: uff(path, made, binary=0), 1e-11),
    "mat 7.3": (".mat", mat_73, 0.0),
    "mat": (".mat", lambda path, made: savemat(path, {**made.values, "time": times_of(made)}), 0.0),
    "mat by rate": (".mat", mat_by_rate, 0.0),
    "mat of structs": (".mat", lambda path, made: savemat(path, {"run": {**made.values, "time": times_of(made)}}), 0.0),
    "wav": (".wav", wav, 0.0),
    "csv": (".csv", lambda path, made: table(path, {"time": times_of(made), **made.values}), 0.0),
}
MATLAB = ("mat", "mat by rate", "mat of structs")
#: Form and seed: MATLAB's are read by a process of its own, which takes half a second a file.
CASES = [(form, seed) for form in FORMS for seed in range((10 if LONG else 1) if form in MATLAB else 40 if LONG else 8)]


def imported(path: Path, *wanted: str, **how: Any) -> Run:
    """Import a file, check the bag as a bag is checked, and read it."""
    out = path.parent / "bag"
    named = [(name, column) for name, _, column in (one.partition("=") for one in wanted)]
    import_files([path], out, named, **how)
    assert all(line.startswith("lost: ") for line in check(out).findings)
    assert [item.name for item in path.parent.iterdir() if item.name.startswith(".")] == []
    return open_run(out)


@pytest.mark.parametrize(("form", "seed"), CASES)
def test_numbers_rate_and_start_come_back(form: str, seed: int, tmp_path: Path) -> None:
    made = drawn(np.random.default_rng(seed))
    ending, write, off = FORMS[form]
    path = tmp_path / f"measured{ending}"
    write(path, made)
    found = imported(path)
    told = "uff" in form or form == "tdms"
    for number, (name, values) in enumerate(made.values.items(), 1):
        signal = found.signal(f"channel_{number}" if form == "wav" else name)
        np.testing.assert_allclose(signal.values, values, rtol=off, atol=off * np.abs(values).max())
        assert signal.rate == pytest.approx(made.rate, rel=1e-12)
        assert (signal.start_ns, signal.unit) == (START_NS if told and made.dated else 0, "m" if told else "")


@pytest.mark.parametrize(("form", "seed"), CASES)
def test_what_is_torn_or_garbled_is_one_line_and_no_bag(form: str, seed: int, tmp_path: Path, capsys: Capture) -> None:
    """A damaged file is refused in one line, or becomes a whole bag."""
    ending, write, _ = FORMS[form]
    random = np.random.default_rng(seed)
    path, out = tmp_path / f"measured{ending}", tmp_path / "bag"
    write(path, drawn(random))
    whole = bytearray(path.read_bytes())
    if random.integers(2):
        del whole[random.integers(len(whole)) :]
    else:
        for at in random.integers(0, min(len(whole), 601), random.integers(1, 9)):
            whole[at] = random.integers(256)
    path.write_bytes(whole)
    status = main(["bag", "import", str(path), "--out", str(out)])
    error = capsys.readouterr().err
    if status:
        assert (status, error[:7], error.count("\n")) == (2, "error: ", 1)
        assert list(tmp_path.iterdir()) == [path]
    else:
        verify(out)


def test_what_ends_the_library_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.mat"
    mat_by_rate(path, Made(10.0, {"beam": np.arange(40.0)}))
    content = bytearray(path.read_bytes())
    content[176] = 83  # the type of the numbers: scipy ends with a segmentation fault, or divides by 0
    path.write_bytes(content)
    refused(capsys, ["bag", "import", path, "--out", tmp_path / "bag"], "a.mat: cannot be read")
    assert [item.name for item in tmp_path.iterdir()] == ["a.mat"]


@pytest.mark.parametrize("seed", range(60 if LONG else 16))
def test_tables_of_pandas_in_any_layout(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    made = drawn(random)

    def one_of(*choices: Any) -> Any:
        return choices[random.integers(len(choices))]

    separator, decimal = one_of((";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", ","), (",", "."), (" ", "."))
    spaces, (unit, factor) = separator == " ", one_of(("mm", 1e-3), ("µm", 1e-6), ("m", 1.0))
    stated = one_of("", "in a row", "" if spaces else "in the name")
    names, end = list(made.values), one_of("\n", "\r\n")
    heads = ["time", *(f"{name} [{unit}]" if stated == "in the name" else name for name in names)]
    columns = [times_of(made), *made.values.values()]
    table = pd.DataFrame(dict(zip(heads, columns, strict=True)))
    index = one_of(True, False) and not spaces
    table.index += 0 if index else one_of(0, 7)  # numbers that do not begin with 0 are a channel
    if stated == "in a row":
        table.columns = pd.MultiIndex.from_arrays([heads, ["s", *[unit] * len(names)]])
    text, quoting = io.StringIO(), 0 if spaces else one_of(0, 1)
    table.to_csv(text, sep=separator, decimal=decimal, quoting=quoting, index=index, lineterminator=end)
    above = random.choice(["# made by a program", "Operator: N. N.", "", "Date: today"], random.integers(5))
    path = tmp_path / "table.csv"
    encoding = one_of("utf-8", "utf-8-sig", "cp1252", "utf-16")
    path.write_text("".join(f"{line}{end}" for line in above) + text.getvalue(), encoding=encoding, newline="")
    found = imported(path)
    for name, values in made.values.items():
        signal = found.signal(name)
        np.testing.assert_array_equal(signal.values, values * (factor if stated else 1.0))
        assert signal.rate == pytest.approx(made.rate, rel=1e-12)
        assert signal.unit == ("m" if stated else "")
    assert {column.name for table, _ in found.streams() for column in table.values} == set(names)


@pytest.mark.parametrize("form", ["csv", "mat", "uff"])
def test_what_was_exported_is_imported_to_the_same_numbers(form: str, tmp_path: Path) -> None:
    bag = written(tmp_path / "run")
    (tmp_path / "aside").mkdir()
    found = imported(exported(bag, form, tmp_path / f"run.{form}").rename(tmp_path / f"aside/run.{form}"))
    for place, name in enumerate((SUPPORT, BEAM)):
        signal = found.signal(name)
        np.testing.assert_array_equal(signal.values, expected(place))
        assert (signal.rate, signal.start_ns) == (RATE, open_run(bag).start_ns)
    if form != "csv":
        np.testing.assert_array_equal(found.signal("force").values, open_run(bag).signal("force").values)


# single features


def has_line(folder: Path, *parts: str) -> bool:
    """Whether what is stated of the import in the bag has a line with these parts."""
    lines = open_bag(folder / "bag").files["import.txt"].decode().splitlines()
    return any(all(part in line for part in parts) for line in lines)


def test_channels_are_named_and_scaled_as_stated(tmp_path: Path) -> None:
    time = np.arange(100) / 100.0
    path = table(tmp_path / "a.csv", {"time [ms]": 1e3 * time, "Laser:1 [V]": np.sin(time), "acc (g)": time, "x": time})
    found = imported(path, f"{BEAM}=Laser:1:mm:20", "acceleration=acc", f"{SUPPORT}=Laser:1:m:1e-3")
    beam, acceleration = found.signal(BEAM), found.signal("acceleration")
    np.testing.assert_allclose(beam.values, 0.02 * np.sin(time), rtol=1e-15)
    np.testing.assert_allclose(acceleration.values, 9.80665 * time, rtol=1e-15)
    assert (beam.unit, acceleration.unit, beam.rate) == ("m", "m/s^2", 100.0)
    assert has_line(tmp_path, "left out", "--channels", "a.csv: x")
    assert has_line(tmp_path, "= 9.80665 × a.csv: acc [g]")


def test_gaps_keep_their_time_and_are_listed(tmp_path: Path) -> None:
    index = np.r_[0:50, 60:100, 101:200]
    expected = np.full(200, np.nan)
    expected[index] = index
    beam = imported(table(tmp_path / "a.csv", {"t": index / 250.0, "beam": index})).signal("beam")
    np.testing.assert_array_equal(beam.values, expected)
    assert (beam.rate, beam.lost) == (250.0, 11)
    assert has_line(tmp_path, "2 gaps", "11 samples")


def test_invalid_samples_are_nan_and_counted(tmp_path: Path) -> None:
    cells = ["1", "", "2", "overload", "inf", "3", *["4"] * 20]
    rows = "".join(f"{n / 8},{cell},on\n" for n, cell in enumerate(cells))
    (tmp_path / "a.csv").write_text(f"time,beam,text\n{rows}")
    beam = imported(tmp_path / "a.csv").signal("beam")
    np.testing.assert_array_equal(beam.values[:6], [1.0, np.nan, 2.0, np.nan, np.nan, 3.0])
    assert has_line(tmp_path, "beam: 1 cells", "'overload'", "row 4")
    assert has_line(tmp_path, "beam: 3 samples", "NaN")
    assert has_line(tmp_path, "text: left out")


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_integers_of_a_wav_have_a_full_scale_of_one(width: int, tmp_path: Path) -> None:
    full, zero = 2.0 ** (8 * width - 1), 128.0 if width == 1 else 0.0
    values = np.array([0, 1, -1, full - 1, -full]) + zero
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setparams((1, width, 44_100, len(values), "NONE", ""))
        file.writeframes(b"".join(int(one).to_bytes(width, "little", signed=width > 1) for one in values))
    found = imported(tmp_path / "a.wav", f"{BEAM}=channel_1:mm:5").signal(BEAM)
    np.testing.assert_allclose(found.values, (values - zero) / full * 5e-3, rtol=1e-12)
    assert has_line(tmp_path, "full scale", "1")


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
***End_of_Header***\t

Samples\t300\t300\t
Y_Unit_Label\tmm\tN\t
Delta_X\t0.005\t0.005\t
***End_of_Header***\t\t\t
X_Value\tLaser\tForce\tComment
"""


def test_numbers_above_a_table_are_no_part_of_it(tmp_path: Path) -> None:
    values = np.random.default_rng(1).standard_normal((300, 2))
    rows = "".join(f"{0.005 * k:.6f}\t{a!r}\t{b!r}\t\n" for k, (a, b) in enumerate(values.tolist()))
    (tmp_path / "a.txt").write_text(LABVIEW + rows)
    for place, signal in enumerate(imported(tmp_path / "a.txt").signals("Laser", "Force")):
        assert signal.rate == 200.0
        np.testing.assert_array_equal(signal.values, values[:, place])
    shutil.rmtree(tmp_path / "bag")
    timed = np.column_stack([np.arange(300) / 100.0, values[:, 0]])
    np.savetxt(tmp_path / "a.dat", timed, fmt="%.17g", header="time beam")  # a line that begins with #
    found = imported(tmp_path / "a.dat").signal("beam")
    assert found.rate == 100.0
    np.testing.assert_array_equal(found.values, values[:, 0])


def test_x_is_a_channel_where_a_rate_is_stated(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"x": [3.0, 1.0, 2.0], "fs": 50.0}, format="4")
    found = imported(tmp_path / "a.mat").signal("x")
    assert (found.rate, list(found.values)) == (50.0, [3.0, 1.0, 2.0])


def test_a_rate_makes_rows_even(tmp_path: Path) -> None:
    beam = imported(table(tmp_path / "a.csv", {"time": [0, 0, 0, 1, 1], "beam": range(5)}), rate=4.0).signal("beam")
    assert (beam.rate, list(beam.values)) == (4.0, [0, 1, 2, 3, 4])
    assert has_line(tmp_path, "time: left out")


def test_dates_are_the_begin(tmp_path: Path) -> None:
    when = pd.date_range("2026-03-04 05:06:07", periods=300, freq="4ms")
    pd.DataFrame({"beam": np.arange(300.0)}, index=when).to_csv(tmp_path / "a.csv", sep=";", index_label="time")
    beam = imported(tmp_path / "a.csv").signal("beam")
    assert (beam.rate, beam.start_ns) == (250.0, START_NS)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_matrix_is_a_channel_a_column(version: str, tmp_path: Path) -> None:
    matrix = np.random.default_rng(3).standard_normal((300, 2))
    if version == "5":
        savemat(tmp_path / "a.mat", {"data": matrix, "dt": 0.01})
    else:
        with library("h5py").File(tmp_path / "a.mat", "w", userblock_size=512) as file:
            file["data"], file["dt"] = matrix.T, [[0.01]]
    for place, signal in enumerate(imported(tmp_path / "a.mat").signals("data_1", "data_2")):
        np.testing.assert_array_equal(signal.values, matrix[:, place])
        assert signal.rate == pytest.approx(100.0)


def test_several_rates_and_files_are_several_streams(tmp_path: Path) -> None:
    nptdms = library("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        for name, rate, rows in (("laser", 1000.0, 500), ("acc", 2500.0, 1250), ("force", 1000.0, 500)):
            about = {"wf_increment": 1.0 / rate, "wf_start_time": START.replace(tzinfo=None), "unit_string": "V"}
            writer.write_segment([nptdms.ChannelObject("All", name, np.arange(rows) * rate, about)])
    found = imported(tmp_path / "a.tdms")
    streams = [(stream.rate, stream.rows) for stream, _ in found.streams()]
    assert sorted(streams) == [(1000.0, 500), (2500.0, 1250)]
    laser, force = found.signals("laser", "force")
    assert (laser.values[1], force.values[1], found.signal("acc").time[-1]) == (1000.0, 1000.0, 1249 / 2500.0)


@pytest.mark.parametrize(
    ("columns", "parts"),
    [
        ({"time": [0.0, 0.1, 0.23, 0.3, 0.42], "a": range(5)}, ["evenly"]),
        ({"time": [0.0, 0.1, 0.05, 0.2, 0.3, 0.4], "a": range(6)}, ["evenly", " row "]),
        ({"a": [0.5, 1.5, 2.5]}, ["--rate HZ"]),
        ({"time": [0.0], "a": [1.0]}, []),
        ({"time [mm]": [0.0, 0.1, 0.2], "a": range(3)}, ["'mm'; allowed"]),
        ({"time": [0.0, np.nan, 0.2], "a": range(3)}, ["finite"]),
        ("a:m:0", ["'0'; allowed"]),
        ("a:m:nan", ["'nan'"]),
        ("a:m:2:3", ["'2:3'"]),
        ("a:furlong", [":furlong; allowed: :unit[:factor]"]),
        ("b", ["given b;", ": a"]),
    ],
)
def test_impossible_times_and_channels_are_refused(columns: Any, parts: list[str], tmp_path: Path, capsys: Any) -> None:
    stated = ["--channels", f"beam={columns}"] if isinstance(columns, str) else []
    path = table(tmp_path / "a.csv", {"time": np.arange(9) / 8.0, "a": range(9)} if stated else columns)
    refused(capsys, ["bag", "import", path, "--out", tmp_path / "bag", *stated], *parts)
    assert [item.name for item in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.parametrize(
    ("text", "unit", "factor"),
    [("mm", "m", 1e-3), ("[µm]", "m", 1e-6), ("μm", "m", 1e-6), ("um", "m", 1e-6), ("g", "m/s^2", 9.80665),
     ("m/s²", "m/s^2", 1.0), ("m/s**2", "m/s^2", 1.0), ("mm/s^2", "m/s^2", 1e-3), ("m s^-2", "m/s^2", 1.0),
     ("kN", "N", 1e3), ("mV", "V", 1e-3), ("m/s", "m/s", 1.0), ("in", "m", 0.0254), ("ms", "s", 1e-3), ("", "", 1.0),
     ("[", "", 1.0), *((text, "unknown", 0.0) for text in ("furlong", "G", "kg", "mm/s^2/Hz", "m^2"))],
)  # fmt: skip
def test_units_as_programs_spell_them_and_others_are_not_guessed(text: str, unit: str, factor: float) -> None:
    found = si_of(text) or ("unknown", 0.0)
    assert found[0] == unit
    assert found[1] == pytest.approx(factor)


@pytest.mark.parametrize(("module", "ending"), [("nptdms", ".tdms"), ("h5py", ".mat")])
def test_a_library_that_is_missing_is_one_line(
    module: str, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # as an import that fails
    path = tmp_path / f"a{ending}"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    refused(capsys, ["bag", "import", path, "--out", tmp_path / "bag"], "`make import`")


# files that state, or unpack to, more than they hold: refused by what they state, before memory is taken

HUGE = 10**9


@pytest.mark.parametrize("form", ["csv", "wav"])
def test_memory_does_not_grow_with_a_table(form: str, tmp_path: Path) -> None:
    ending, write, _ = FORMS[form]
    path, index = tmp_path / f"long{ending}", np.arange(200_000)
    write(path, Made(10_000.0, {"a": index / 1e4, "b": index / 3.0}))
    assert peak_of(lambda: import_files([path], tmp_path / "bag", [])) < 30e6


def columns_of_hdf5(path: Path) -> None:
    """Write 2 kB that state two columns of 8 GB."""
    with library("h5py").File(path, "w", userblock_size=512) as file:
        for name in ("time", "beam"):
            file.create_dataset(name, shape=(1, HUGE), dtype="f8")


def chunk_of_hdf5(path: Path) -> None:
    """Write 50 numbers in a packed chunk of 2 GB."""
    with library("h5py").File(path, "w", userblock_size=512) as file:
        file["fs"] = [[10.0]]
        file.create_dataset("beam", (1, 50), "f8", chunks=(1, HUGE // 4), maxshape=(1, None), compression="gzip")


def column_of_matlab_5(path: Path) -> None:
    """Write a packed column that states 2 GB, of which nothing is there."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    rows = HUGE // 4
    about = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", rows, 1)) + element(1, b"beam")
    inside = about + struct.pack("<II", 9, 8 * rows)
    packed = zlib.compress(struct.pack("<II", 14, len(about) + 8 * rows) + inside)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def samples_of_wav(path: Path, bits: int) -> None:
    """Write 300 bytes of samples where 4 GB are stated."""
    about = struct.pack("<HHIIHH", 1, 1, 8000, 1000 * bits, bits // 8, bits)
    length = struct.pack("<I", 2**32 - 48)
    head = b"RIFF" + length + b"WAVE" + b"fmt " + struct.pack("<I", 16) + about + b"data" + length
    path.write_bytes(head + bytes(300))


BEYOND: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "columns of MATLAB 7.3": (".mat", columns_of_hdf5, "2e+09 numbers in 0.00218 MB"),
    "a chunk of MATLAB 7.3": (".mat", chunk_of_hdf5, "2.5e+08 numbers in 0.00"),
    "a column of MATLAB 5": (".mat", column_of_matlab_5, "2.5e+08 numbers in 0.000"),
    "samples of 16 bits": (".wav", lambda path: samples_of_wav(path, 16), "greater"),
    "samples of 24 bits": (".wav", lambda path: samples_of_wav(path, 24), "EOF"),
}


@pytest.mark.parametrize("name", BEYOND)
def test_what_states_more_than_it_holds_takes_no_memory(name: str, tmp_path: Path, capsys: Capture) -> None:
    ending, write, reason = BEYOND[name]
    path = tmp_path / f"a{ending}"
    write(path)
    assert peak_of(lambda: refused(capsys, ["bag", "import", path, "--out", tmp_path / "bag"], reason)) < 60e6
    assert list(tmp_path.iterdir()) == [path]


def test_pieces_that_come_to_more_than_their_file_are_refused(tmp_path: Path) -> None:
    path, given = tmp_path / "a.csv", Given(tmp_path)
    path.write_bytes(bytes(1000))
    assert len(mapped(path, given, [np.zeros(100_000)])) == 100_000
    with pytest.raises(BagError, match=r"1\.5e\+05 .* 0\.001 MB"):
        mapped(path, given, [np.zeros(100_000), np.zeros(50_000)])


def test_records_far_apart_are_not_filled(tmp_path: Path) -> None:
    """Half a second at 10 MHz would be 40 MB, 500 seconds 40 GB."""
    path = tmp_path / "a.uff"
    for begin in (0.0, 500.0):
        uff(path, Made(1e7, {"beam": np.arange(1.0, 4.0)}), begin=begin)
    import_files([path], tmp_path / "bag", [])
    found = open_run(tmp_path / "bag")
    for name in ("beam", "beam_1"):
        assert list(found.signal(name).values) == [1.0, 2.0, 3.0]
