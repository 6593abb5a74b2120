# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that other programs wrote become bags: npTDMS, pyuff, scipy, h5py and pandas write, `open_run` reads."""

import io
import shlex
import sys
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
import pyuff
from exported import BAG, RATE, ROOT, expected, run, written
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.io import savemat, wavfile

from atpid_control.cli import main
from atpid_control.runs.check import check
from atpid_control.runs.import_files import READERS, import_files
from atpid_control.runs.imports.units import si_of
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import Run, open_run
from atpid_control.runs.verify import verify

#: pyuff leaves files open that it writes.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")
MISSING = "npTDMS or h5py is missing: make import"
START = datetime(2026, 3, 4, 5, 6, 7, tzinfo=timezone.utc)
START_NS = int(START.timestamp()) * 10**9
RATES = (10.0, 100.0, 512.0, 1000.0, 1024.0, 4096.0, 10_000.0, 51_200.0)
LONG = settings.get_current_profile_name() == "long"
EXAMPLES = settings(
    max_examples=40 if LONG else 12,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


class Made(NamedTuple):
    """What a file holds."""

    rate: float
    values: dict[str, Any]  # (n,) each, by the names that the bag must have
    dated: bool = False


@st.composite
def tables(draw: st.DrawFn) -> Made:
    """Numbers whose last digits matter."""
    rows, rate = draw(st.integers(3, 400)), draw(st.sampled_from(RATES))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    names = draw(
        st.lists(st.sampled_from(("beam", "support", "acc1", "Kraft", "ch_3")), min_size=1, max_size=3, unique=True)
    )
    scale = 10.0 ** draw(st.integers(-9, 3))
    return Made(rate, {name: random.standard_normal(rows) * scale for name in names}, draw(st.booleans()))


def tdms(path: Path, made: Made) -> None:
    nptdms = pytest.importorskip("nptdms", reason=MISSING)
    about = {"wf_increment": 1.0 / made.rate, "wf_start_offset": 0.0, "unit_string": "m"}
    about |= {"wf_start_time": np.datetime64(START.replace(tzinfo=None))} if made.dated else {}
    with nptdms.TdmsWriter(path) as writer:
        for half in (slice(None, 2), slice(2, None)):
            writer.write_segment([nptdms.ChannelObject("Group", name, values[half], about)
                                  for name, values in made.values.items()])  # fmt: skip


def uff(path: Path, made: Made, binary: int = 1) -> None:
    for node, (name, values) in enumerate(made.values.items(), 1):
        rows = len(values)
        one = pyuff.prepare_58(
            binary=binary, func_type=1, rsp_node=node, rsp_dir=3, ref_node=0, ref_dir=0, data=values,
            x=np.arange(rows) / made.rate, id1=name, id3=START.strftime("%d-%b-%y %H:%M:%S") if made.dated else "none",
            rsp_ent_name="a", ref_ent_name="b", abscissa_spacing=1, abscissa_spec_data_type=17,
            ordinate_spec_data_type=8, orddenom_spec_data_type=0, z_axis_spec_data_type=0, abscissa_min=0.0,
            abscissa_inc=1.0 / made.rate,
        ) | {"ordinate_axis_lab": name, "ordinate_axis_units_lab": "m"}  # fmt: skip
        pyuff.UFF(str(path)).write_sets(one, "add")


def mat(path: Path, made: Made, nested: bool = False) -> None:
    rows = len(next(iter(made.values.values())))
    inside = {**made.values, "time": np.arange(rows) / made.rate}
    savemat(path, {"run": inside, "comment": "x"} if nested else inside)


def mat_by_rate(path: Path, made: Made) -> None:
    savemat(path, {**made.values, "fs": made.rate})


def mat_73(path: Path, made: Made) -> None:
    h5py = pytest.importorskip("h5py", reason=MISSING)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in made.values.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("Fs", data=[[made.rate]]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("note", data=np.array([[104], [105]], np.uint16)).attrs["MATLAB_class"] = np.bytes_("char")


def wav(path: Path, made: Made) -> None:
    wavfile.write(path, round(made.rate), np.column_stack(list(made.values.values())))


def csv(path: Path, made: Made) -> None:
    rows = len(next(iter(made.values.values())))
    pd.DataFrame({"time": np.arange(rows) / made.rate, **made.values}).to_csv(path, index=False)


def ascii_uff(path: Path, made: Made) -> None:
    uff(path, made, binary=0)


def struct(path: Path, made: Made) -> None:
    mat(path, made, nested=True)


#: By ending of the file: writers, how near the numbers come back, and whether names, dates and units do.
FORMS: dict[str, tuple[str, Callable[[Path, Made], None], float]] = {
    "tdms": (".tdms", tdms, 0.0), "uff": (".uff", uff, 0.0), "uff in ascii": (".unv", ascii_uff, 1e-11),
    "mat": (".mat", mat, 0.0), "mat by rate": (".mat", mat_by_rate, 0.0), "mat of structs": (".mat", struct, 0.0),
    "mat 7.3": (".mat", mat_73, 0.0), "wav": (".wav", wav, 0.0), "csv": (".csv", csv, 0.0),
}  # fmt: skip


@pytest.fixture
def place(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    return lambda: tmp_path_factory.mktemp("import")


def imported(path: Path, *wanted: str, **how: Any) -> Run:
    """Import a file, check the bag as a bag is checked, and read it."""
    out = path.parent / "bag"
    named = [(name, column) for name, _, column in (one.partition("=") for one in wanted)]
    import_files([path], out, named, **how)
    verify(out)
    assert all(line.startswith("lost: ") for line in check(out).findings)
    assert [item.name for item in path.parent.iterdir() if item.name.startswith(".")] == []
    return open_run(out)


#: Read by a process of its own, which takes half a second a file. The first example of hypothesis is the simplest.
OWN_PROCESS = ["mat", "mat by rate", "mat of structs"]
OTHERS = [form for form in FORMS if form not in OWN_PROCESS]
FEW = settings(EXAMPLES, max_examples=5 if LONG else 2)


@pytest.mark.parametrize("form", OTHERS)
@EXAMPLES
@given(made=tables())
def test_numbers_rate_and_start_come_back(form: str, made: Made, place: Callable[[], Path]) -> None:
    come_back(form, made, place)


@pytest.mark.parametrize("form", OWN_PROCESS)
@FEW
@given(made=tables())
def test_numbers_and_rate_of_matlab_come_back(form: str, made: Made, place: Callable[[], Path]) -> None:
    come_back(form, made, place)


def come_back(form: str, made: Made, place: Callable[[], Path]) -> None:
    ending, write, off = FORMS[form]
    path = place() / f"measured{ending}"
    write(path, made)
    found = imported(path)
    for number, (name, values) in enumerate(made.values.items(), 1):
        signal = found.signal(f"channel_{number}" if form == "wav" else name)
        np.testing.assert_allclose(signal.values, values, rtol=off, atol=off * np.abs(values).max())
        assert signal.rate == pytest.approx(made.rate, rel=1e-12)
        dated = made.dated and ("uff" in form or form == "tdms")
        assert signal.start_ns == (START_NS if dated else 0)
        assert signal.unit == ("m" if "uff" in form or form == "tdms" else "")


def test_every_ending_has_a_form_that_is_tested() -> None:
    tested = {ending for ending, _, _ in FORMS.values()}
    same = {READERS[ending] for ending in READERS} - {READERS[ending] for ending in tested}
    assert not same


@pytest.mark.parametrize("form", OTHERS)
@EXAMPLES
@given(data=st.data(), made=tables())
def test_what_is_torn_or_garbled_is_one_line_and_no_bag(
    form: str, data: st.DataObject, made: Made, place: Callable[[], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    torn_or_garbled(form, data, made, place, capsys)


@FEW
@given(data=st.data(), made=tables())
def test_what_is_torn_or_garbled_of_matlab(
    data: st.DataObject, made: Made, place: Callable[[], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    torn_or_garbled("mat", data, made, place, capsys)


def test_what_ends_the_library_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mat_by_rate(tmp_path / "a.mat", Made(10.0, {"beam": np.arange(40.0)}))
    content = bytearray((tmp_path / "a.mat").read_bytes())
    content[176] = 83  # the type of the numbers: scipy ends with a segmentation fault, or divides by 0
    (tmp_path / "a.mat").write_bytes(content)
    assert main(["bag", "import", str(tmp_path / "a.mat"), "--out", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert ("a.mat: cannot be read as" in error, error.count("\n")) == (True, 1)
    assert [item.name for item in tmp_path.iterdir()] == ["a.mat"]


def torn_or_garbled(
    form: str, data: st.DataObject, made: Made, place: Callable[[], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    ending, write, _ = FORMS[form]
    path = place() / f"measured{ending}"
    write(path, made)
    whole = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        del whole[data.draw(st.integers(0, len(whole) - 1)) :]
    else:
        for at in data.draw(st.lists(st.integers(0, min(len(whole) - 1, 600)), min_size=1, max_size=8)):
            whole[at] = data.draw(st.integers(0, 255))
    path.write_bytes(whole)
    out = path.parent / "bag"
    status = main(["bag", "import", str(path), "--out", str(out)])
    printed = capsys.readouterr()
    if status:
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        assert [item.name for item in path.parent.iterdir()] == [path.name]
    else:
        verify(out)


@st.composite
def layouts(draw: st.DrawFn) -> dict[str, Any]:
    decimal = draw(st.sampled_from(".,"))
    separator = draw(st.sampled_from([";", "\t", "|", *([","] if decimal == "." else []), " "]))
    return {"sep": separator, "decimal": decimal, "quoting": draw(st.sampled_from((0, 1))) if separator != " " else 0,
            "index": draw(st.booleans()) and separator != " ",
            "lineterminator": draw(st.sampled_from(("\n", "\r\n")))}  # fmt: skip


@settings(EXAMPLES, max_examples=60 if LONG else 24)
@given(made=tables(), layout=layouts(), data=st.data())
def test_tables_of_pandas_in_any_layout(
    made: Made, layout: dict[str, Any], data: st.DataObject, place: Callable[[], Path]
) -> None:
    rows = len(next(iter(made.values.values())))
    names, unit_row = list(made.values), data.draw(st.booleans())
    unit, factor = data.draw(st.sampled_from((("mm", 1e-3), ("µm", 1e-6), ("m", 1.0))))
    in_name = not unit_row and data.draw(st.booleans()) and layout["sep"] != " "
    heads = ["time", *(f"{name} [{unit}]" if in_name else name for name in names)]
    table = pd.DataFrame(dict(zip(heads, [np.arange(rows) / made.rate, *made.values.values()], strict=True)))
    table.index += data.draw(st.sampled_from((0, 0, 7)))
    assume(not (layout["index"] and table.index[0]))  # numbers that do not begin with 0 are a channel
    if unit_row:
        table.columns = pd.MultiIndex.from_arrays([heads, ["s", *[unit] * len(names)]])
    above = data.draw(
        st.lists(st.sampled_from(("# made by a program", "Operator: N. N.", "", "Date: today")), max_size=4)
    )
    encoding = data.draw(st.sampled_from(("utf-8", "utf-8-sig", "cp1252", "utf-16")))
    path = place() / "table.csv"
    text = io.StringIO()
    table.to_csv(text, **layout)
    path.write_text("".join(f"{line}{layout['lineterminator']}" for line in above) + text.getvalue(),
                    encoding=encoding, newline="")  # fmt: skip
    found = imported(path)
    scale = factor if unit_row or in_name else 1.0
    for name, values in made.values.items():
        signal = found.signal(name)
        np.testing.assert_array_equal(signal.values, values * scale)
        assert signal.rate == pytest.approx(made.rate, rel=1e-12)
        assert signal.unit == ("m" if unit_row or in_name else "")
    assert {column.name for table, _ in found.streams() for column in table.values} == set(names)


@pytest.mark.parametrize("form", ["csv", "mat", "uff"])
def test_what_was_exported_is_imported_to_the_same_numbers(form: str, tmp_path: Path) -> None:
    bag = written(tmp_path / "run")
    path = Path(run(bag, form, tmp_path / f"exported.{form}"))
    (tmp_path / "aside").mkdir()
    path = path.rename(tmp_path / "aside" / path.name)
    found = imported(path)
    for place, name in enumerate(("support_displacement", "beam_displacement")):
        signal = found.signal(name)
        np.testing.assert_array_equal(signal.values, expected(place))
        assert (signal.rate, signal.start_ns) == (RATE, open_run(bag).start_ns)
    if form != "csv":
        np.testing.assert_array_equal(found.signal("force").values, open_run(bag).signal("force").values)


def test_a_bag_of_the_stand_goes_there_and_back_and_is_analysed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import json

    monkeypatch.setattr("atpid_control.commands.analyse.panels", lambda _found: ())  # numbers are compared, no pictures
    numbers = []
    path = Path(run(BAG, "mat", tmp_path / "run.mat", "--topic", "/sensors/laser"))
    imported(path)
    for bag in (BAG, tmp_path / "bag"):
        capsys.readouterr()
        assert main(["bag", "analyse", str(bag), "--out", str(tmp_path / bag.name), "--json"]) == 0
        numbers.append(json.loads(capsys.readouterr().out))
    assert numbers[0]["frequency_response"] == numbers[1]["frequency_response"]
    assert numbers[0]["orders"] == numbers[1]["orders"]


def table(path: Path, columns: dict[str, Any]) -> Path:
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def lines(bag: Path) -> str:
    return open_bag(bag).files["import.txt"].decode()


def test_channels_are_named_and_scaled_as_stated(tmp_path: Path) -> None:
    time = np.arange(100) / 100.0
    path = table(tmp_path / "a.csv", {"time [ms]": 1e3 * time, "Laser:1 [V]": np.sin(time), "acc (g)": time, "x": time})
    found = imported(path, "beam_displacement=Laser:1:mm:20", "acceleration=acc", "support_displacement=Laser:1:m:1e-3")
    beam, acceleration = found.signal("beam_displacement"), found.signal("acceleration")
    np.testing.assert_allclose(beam.values, 0.02 * np.sin(time), rtol=1e-15)
    np.testing.assert_allclose(acceleration.values, 9.80665 * time, rtol=1e-15)
    assert (beam.unit, acceleration.unit, beam.rate) == ("m", "m/s^2", 100.0)
    assert "left out, not among --channels: a.csv: x" in lines(tmp_path / "bag")
    assert "= 9.80665 × a.csv: acc [g]" in lines(tmp_path / "bag")


@pytest.mark.parametrize(
    ("stated", "reason"),
    [("a:m:0", "given factor '0'; allowed: a number, not 0"), ("a:m:nan", "given factor 'nan'"),
     ("a:m:2:3", "given factor '2:3'"), ("a:furlong", "given :furlong; allowed: :unit[:factor]"),
     ("b", "given b; in the files: a")],
)  # fmt: skip
def test_channels_that_cannot_be_taken_are_refused(
    stated: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv", {"time": np.arange(9) / 8.0, "a": range(9)})
    given = ["bag", "import", str(path), "--out", str(tmp_path / "bag"), "--channels", f"beam={stated}"]
    assert main(given) == 2
    assert reason in capsys.readouterr().err


def test_gaps_keep_their_time_and_are_listed(tmp_path: Path) -> None:
    index = np.r_[0:50, 60:100, 101:200]
    found = imported(table(tmp_path / "a.csv", {"t": index / 250.0, "beam": index}))
    beam = found.signal("beam")
    kept = np.isfinite(beam.values)
    np.testing.assert_array_equal(np.flatnonzero(kept), index)
    np.testing.assert_array_equal(beam.values[kept], index)
    assert (beam.rate, beam.lost, len(beam.values)) == (250.0, 11, 200)
    assert "2 gaps, 11 samples missing" in lines(tmp_path / "bag")


def test_invalid_samples_are_nan_and_counted(tmp_path: Path) -> None:
    cells = ["1", "", "2", "overload", "inf", "3", *["4"] * 20]
    rows = "".join(f"{n / 8},{cell},on\n" for n, cell in enumerate(cells))
    (tmp_path / "a.csv").write_text(f"time,beam,text\n{rows}")
    beam = imported(tmp_path / "a.csv").signal("beam")
    np.testing.assert_array_equal(np.isnan(beam.values[:6]), [False, True, False, True, True, False])
    kept = lines(tmp_path / "bag")
    assert "beam: 1 cells are no numbers, NaN: the first 'overload' in row 4" in kept
    assert "beam: 3 samples are no finite number: NaN" in kept
    assert "text: left out, it holds no numbers" in kept


def test_several_rates_and_files_are_several_streams(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms", reason=MISSING)
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        for name, rate, rows in (("laser", 1000.0, 500), ("acc", 2500.0, 1250), ("force", 1000.0, 500)):
            about = {"wf_increment": 1.0 / rate, "wf_start_time": START.replace(tzinfo=None), "unit_string": "V"}
            writer.write_segment([nptdms.ChannelObject("All", name, np.arange(rows) * rate, about)])
    import_files([tmp_path / "a.tdms"], tmp_path / "bag", [])
    found = open_run(tmp_path / "bag")
    assert sorted((run_table.rate, run_table.rows) for run_table, _ in found.streams()) == [
        (1000.0, 500),
        (2500.0, 1250),
    ]
    laser, force = found.signals("laser", "force")
    assert (laser.values[1], force.values[1], found.signal("acc").time[-1]) == (1000.0, 1000.0, 1249 / 2500.0)


@pytest.mark.parametrize(("dtype", "full"), [(np.int16, 2.0**15), (np.int32, 2.0**31), (np.uint8, 128.0)])
def test_integers_of_a_wav_have_a_full_scale_of_one(tmp_path: Path, dtype: Any, full: float) -> None:
    about = np.iinfo(dtype)
    data = np.linspace(about.min, about.max, 1000).astype(dtype)
    wavfile.write(tmp_path / "a.wav", 8000, data)
    found = imported(tmp_path / "a.wav", "beam_displacement=channel_1:mm:5").signal("beam_displacement")
    zero = 128.0 if dtype == np.uint8 else 0.0
    np.testing.assert_allclose(found.values, (data.astype(float) - zero) / full * 5e-3, rtol=1e-12)
    assert "full scale is 1" in lines(tmp_path / "bag")


def test_24_bits_of_a_wav(tmp_path: Path) -> None:
    import wave

    values = np.array([0, 1, -1, 2**23 - 1, -(2**23)], np.int32)
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(3)
        file.setframerate(44_100)
        file.writeframes(b"".join(int(one).to_bytes(3, "little", signed=True) for one in values))
    np.testing.assert_array_equal(imported(tmp_path / "a.wav").signal("channel_1").values, values / 2.0**23)


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
***End_of_Header***\t

Channels\t2\t\t
Samples\t300\t300\t
Y_Unit_Label\tmm\tN\t
X0\t0.0\t0.0\t
Delta_X\t0.005\t0.005\t
***End_of_Header***\t\t\t
X_Value\tLaser\tForce\tComment
"""


def test_numbers_above_a_table_are_no_part_of_it(tmp_path: Path) -> None:
    values = np.random.default_rng(1).standard_normal((300, 2))
    rows = "".join(f"{0.005 * k:.6f}\t{a!r}\t{b!r}\t\n" for k, (a, b) in enumerate(values.tolist()))
    (tmp_path / "a.txt").write_text(LABVIEW + rows)
    run = imported(tmp_path / "a.txt")
    for place, name in enumerate(("Laser", "Force")):
        assert run.signal(name).rate == 200.0
        np.testing.assert_array_equal(run.signal(name).values, values[:, place])


def test_a_channel_is_named_by_what_it_ends_with(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms", reason=MISSING)
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("Group", "acc/X", np.arange(9.0), {"wf_increment": 0.01})])
    import_files([tmp_path / "a.tdms"], tmp_path / "bag", [("support_acceleration", "acc/X:g")])
    found = open_run(tmp_path / "bag").signal("support_acceleration")
    np.testing.assert_array_equal(found.values, 9.80665 * np.arange(9.0))


def test_x_is_a_channel_where_a_rate_is_stated(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"x": [3.0, 1.0, 2.0], "fs": 50.0}, format="4")
    found = imported(tmp_path / "a.mat").signal("x")
    assert (found.rate, list(found.values)) == (50.0, [3.0, 1.0, 2.0])


def test_what_numpy_writes_has_its_names(tmp_path: Path) -> None:
    values = np.random.default_rng(2).standard_normal(50)
    np.savetxt(tmp_path / "a.dat", np.column_stack([np.arange(50) / 100.0, values]), fmt="%.17g", header="time beam")
    found = imported(tmp_path / "a.dat").signal("beam")
    assert found.rate == 100.0
    np.testing.assert_array_equal(found.values, values)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "uneven": ({"time": [0.0, 0.1, 0.23, 0.3, 0.42], "a": range(5)}, "not evenly sampled"),
    "falling": ({"time": [0.0, 0.1, 0.05, 0.2, 0.3, 0.4], "a": range(6)}, "not evenly sampled at row"),
    "without times": ({"a": [0.5, 1.5, 2.5]}, "no times and no rate in it; give --rate HZ"),
    "one row": ({"time": [0.0], "a": [1.0]}, ""),
    "unit of time": ({"time [mm]": [0.0, 0.1, 0.2], "a": range(3)}, "its unit is 'mm'; allowed: one of time"),
    "empty time": ({"time": [0.0, np.nan, 0.2], "a": range(3)}, "all finite"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_even_time_is_refused_in_a_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns, reason = REFUSED[name]
    path = table(tmp_path / "a.csv", columns)
    assert main(["bag", "import", str(path), "--out", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert (reason in error, error.count("\n")) == (True, 1)
    assert [item.name for item in tmp_path.iterdir()] == ["a.csv"]


def test_a_rate_makes_rows_even(tmp_path: Path) -> None:
    beam = imported(table(tmp_path / "a.csv", {"time": [0, 0, 0, 1, 1], "beam": range(5)}), rate=4.0).signal("beam")
    assert (beam.rate, list(beam.values)) == (4.0, [0, 1, 2, 3, 4])
    assert "time: left out, rows count as even" in lines(tmp_path / "bag")


@pytest.mark.parametrize(
    ("text", "unit", "factor"),
    [("mm", "m", 1e-3), ("[µm]", "m", 1e-6), ("μm", "m", 1e-6), ("um", "m", 1e-6), ("g", "m/s^2", 9.80665),
     ("m/s²", "m/s^2", 1.0), ("m/s**2", "m/s^2", 1.0), ("mm/s^2", "m/s^2", 1e-3), ("m s^-2", "m/s^2", 1.0),
     ("kN", "N", 1e3), ("mV", "V", 1e-3), ("m/s", "m/s", 1.0), ("in", "m", 0.0254), ("ms", "s", 1e-3), ("", "", 1.0)],
)  # fmt: skip
def test_units_as_programs_spell_them(text: str, unit: str, factor: float) -> None:
    found = si_of(text)
    assert found is not None
    assert found[0] == unit
    assert found[1] == pytest.approx(factor)


@pytest.mark.parametrize("text", ["furlong", "G", "kg", "mm/s^2/Hz", "[", "m^2"])
def test_other_units_are_not_guessed(text: str) -> None:
    assert si_of(text) is None or text == "["


def test_dates_are_the_begin(tmp_path: Path) -> None:
    when = pd.date_range("2026-03-04 05:06:07", periods=300, freq="4ms")
    pd.DataFrame({"beam": np.arange(300.0)}, index=when).to_csv(tmp_path / "a.csv", sep=";", index_label="time")
    beam = imported(tmp_path / "a.csv").signal("beam")
    assert (beam.rate, beam.start_ns) == (250.0, START_NS)


def test_memory_does_not_grow_with_a_table(tmp_path: Path) -> None:
    import tracemalloc

    index = np.arange(400_000)
    for ending, write in ((".csv", csv), (".wav", wav)):
        path = tmp_path / f"long{ending}"
        write(path, Made(10_000.0, {"a": index / 1e4, "b": index / 3.0}))
        tracemalloc.start()
        import_files([path], tmp_path / f"bag{ending}", [])
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 60e6, ending


@pytest.mark.parametrize(("module", "ending"), [("nptdms", ".tdms"), ("h5py", ".mat")])
def test_a_library_that_is_missing_is_one_line(
    module: str, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # as an import that fails
    path = tmp_path / f"a{ending}"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    assert main(["bag", "import", str(path), "--out", str(tmp_path / "bag")]) == 2
    assert "which is not installed; `make import` installs it" in capsys.readouterr().err


def test_the_examples_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs/reading.md").read_text(encoding="utf-8")
    commands = [shlex.split(line)[1:] for line in page.splitlines() if line.startswith("    atpid bag import ")]
    monkeypatch.chdir(tmp_path)
    time = np.arange(2000) / 1000.0
    made = {"Time (s)": time, "Laser (mm)": np.sin(30.0 * time), "Shaker (V)": np.cos(30.0 * time)}
    pd.DataFrame(made).to_csv("measured.csv", index=False)
    wavfile.write("measured.wav", 8000, np.zeros((800, 2), np.int16))
    for command in commands:
        assert main(command) == 0
    assert len(commands) == 2
    found = open_run(tmp_path / "out/measured")
    np.testing.assert_allclose(found.signal("support_displacement").values, 0.002 * np.cos(30.0 * time), rtol=1e-15)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_matrix_is_a_channel_a_column(version: str, tmp_path: Path) -> None:
    table = np.random.default_rng(3).standard_normal((300, 2))
    if version == "5":
        savemat(tmp_path / "a.mat", {"data": table, "dt": 0.01})
    else:
        h5py = pytest.importorskip("h5py", reason=MISSING)
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
            file["data"], file["dt"] = table.T, [[0.01]]
    found = imported(tmp_path / "a.mat")
    for place, signal in enumerate(found.signals("data_1", "data_2")):
        np.testing.assert_array_equal(signal.values, table[:, place])
        assert signal.rate == pytest.approx(100.0)
