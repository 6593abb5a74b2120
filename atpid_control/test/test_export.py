# SPDX-License-Identifier: Apache-2.0
"""A bag read anywhere: xarray, pandas, CSV, UFF 58, MATLAB and Parquet hold what is in the bag, to the last digit."""

import json
import shutil
import subprocess
import sys
import tracemalloc
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyuff
import xarray as xr
from recorded import block, make
from scipy.io import loadmat

from atpid_control.bags import BagWriter, new_run
from atpid_control.bags import open_bag as messages_of
from atpid_control.beam_calibration.recording import read_recording
from atpid_control.cli import main
from atpid_control.export import ExportError, Source, frames, open_bag
from atpid_control.export.uff_file import runs

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/thesis_4_3_short"
RATE, SLOW = 1000.0, 320.0
START = 1_700_000_000_000_000_000
#: pandas reads floats to the last digit by default from version 3 on.
EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
LOST = (200, 60)  # first index, how many


def samples(index: Any, channels: int = 2) -> Any:
    """Return values (n, channels) whose last digits matter."""
    return np.sin(np.outer(index, np.arange(1, channels + 1)) * 0.1) / 3.0


def written(folder: Path, blocks: int = 10, size: int = 50, closed: bool = True, seed: int = 1) -> Path:
    """Write a bag of two rates: samples lost by index in the laser, an invalid one, an event, and estimates."""
    writer = BagWriter(folder, new_run(run_id="numbers", commit="none"))
    names = {"/sensors/laser": "SampleBlock", "/sensors/force": "SampleBlock", "/excitation": "Excitation",
             "/events": "Event"}  # fmt: skip
    for topic, kind in names.items():
        writer.add_topic(topic, f"atpid_interfaces/msg/{kind}")
    for number in range(blocks):
        first = number * size + (LOST[1] if number * size >= LOST[0] else 0)
        data = samples(first + np.arange(size))
        if number == 1:
            data[7, 1] = np.nan
        at = START + round(first / RATE * 1e9)
        writer.write("/sensors/laser", block(first, data, RATE, START, dropped=0), at, at)
        force = samples(number * 16 + np.arange(16), 1)
        told = {"channels": ["force"], "units": ["N"], "skew": np.array([1e-5])}
        writer.write("/sensors/force", block(number * 16, force, SLOW, START, **told), at + 1, at + 1)
        estimate = make("Excitation", at + 2, "identifier", quality=1, amplitude=0.01 / 3.0, frequency=5.5, used=number)
        writer.write("/excitation", estimate, at + 3_000_000, at + 2)
    event = make("Event", START + 5, "recorder_node", severity=1, kind="dropped", value=60.0, text='60 lost, "here" #1')
    writer.write("/events", event, START + 5, START + 5)
    if closed:
        writer.close({"finished": "yes"})
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("exported") / "run")


def expected(channel: int) -> Any:
    """Return the laser's channel as it must come out: lost and invalid samples are NaN."""
    index = np.arange(10 * 50 + LOST[1])
    values = samples(index)[:, channel]
    values[LOST[0] : LOST[0] + LOST[1]] = np.nan
    if channel == 1:
        values[57] = np.nan
    return values


def test_samples_have_names_units_and_hardware_time(bag: Path) -> None:
    laser = open_bag(bag)["sensors/laser"].to_dataset()
    assert dict(laser.sizes) == {"time": 560}
    for place, name in enumerate(("support_displacement", "beam_displacement")):
        np.testing.assert_array_equal(laser[name], expected(place))
        assert laser[name].attrs["units"] == "m"
    np.testing.assert_array_equal(laser["index"], np.arange(560))
    np.testing.assert_array_equal(laser["stamp"], START + np.arange(560) * 1_000_000)
    np.testing.assert_allclose(laser["time"], np.arange(560) / RATE, rtol=0.0, atol=1e-12)
    assert (laser["time"].attrs["units"], laser["stamp"].attrs["units"]) == ("s", "ns")


def test_what_was_lost_is_counted_and_never_joined(bag: Path) -> None:
    tree = open_bag(bag)
    laser = tree["sensors/laser"].attrs
    assert (laser["lost"], laser["gap_first_index"], laser["gap_samples"]) == (LOST[1], [LOST[0]], [LOST[1]])
    assert tree.attrs["missing"] == ["sensors/laser: 60 samples lost in 1 gaps; their rows are NaN"]
    assert tree["sensors/force"].attrs["lost"] == 0


def test_other_rates_and_topics_are_datasets_of_their_own(bag: Path) -> None:
    tree = open_bag(bag)
    assert {node.path for node in tree.leaves} == {
        "/sensors/laser", "/sensors/laser_blocks", "/sensors/force", "/sensors/force_blocks", "/excitation", "/events",
    }  # fmt: skip
    force, estimates, event = (tree[name].to_dataset() for name in ("sensors/force", "excitation", "events"))
    assert (force.attrs["rate"], force.sizes["time"], force["force"].attrs["skew"]) == (SLOW, 160, 1e-5)
    assert force["force"].attrs["units"] == "N"
    np.testing.assert_array_equal(estimates["used"], np.arange(10))
    assert estimates["frequency"].attrs["units"] == "Hz"
    assert float(estimates["amplitude"][3]) == 0.01 / 3.0
    np.testing.assert_allclose(estimates["received"] - estimates["time"], 0.003 - 2e-9, atol=1e-9)
    assert (event["text"].item(), event["source"].item()) == ('60 lost, "here" #1', "recorder_node")
    assert tree.attrs["run_id"] == "numbers"


def test_pandas_tables_have_the_time_as_index(bag: Path) -> None:
    laser = frames(bag, ["/sensors/laser"])["sensors/laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], expected(1))
    assert (laser.index.name, laser.attrs["units"]["beam_displacement"]) == ("time", "m")


def test_the_recorded_bag_is_what_its_messages_hold() -> None:
    tree, bag = open_bag(BAG), messages_of(BAG)
    blocks = [message for _, message in bag.messages("/sensors/laser")]
    data = np.concatenate([np.reshape(message.data, (-1, 2)) for message in blocks])
    laser = tree["sensors/laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], data[:, 1])
    for name, topic in (("plant/truth", "/plant/truth"), ("excitation", "/excitation")):
        read = [message for _, message in bag.messages(topic)]
        column = "grain" if name == "plant/truth" else "amplitude"
        values = np.concatenate([np.atleast_1d(getattr(message, column)) for message in read])
        np.testing.assert_array_equal(tree[name][column], values)
    assert tree.attrs["files"]["scene.yaml"] == bag.scene_text


def run(bag: Path, form: str, out: Path, *more: str) -> str:
    """Export and return the path as text."""
    assert main(["export", str(bag), "--format", form, "--out", str(out), *more]) == 0
    return str(out)


def test_csv_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = run(bag, "csv", tmp_path / "run.csv")
    assert "missing: sensors/laser: 60 samples lost" in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert list(table) == ["time [s]", "stamp [ns]", "index", "support_displacement [m]", "beam_displacement [m]"]
    for place, name in enumerate(("support_displacement [m]", "beam_displacement [m]")):
        np.testing.assert_array_equal(table[name], expected(place))
    np.testing.assert_array_equal(table["stamp [ns]"], START + np.arange(560) * 1_000_000)
    assert "# lost: 60 samples from index 200 on" in Path(path).read_text().splitlines()
    events = pd.read_csv(tmp_path / "run.events.csv", comment="#")
    assert events["text"].item() == '60 lost, "here" #1'
    assert {item.name for item in tmp_path.iterdir()} == {
        "run.csv", "run.events.csv", "run.excitation.csv", "run.sensors_force.csv", "run.sensors_force_blocks.csv",
        "run.sensors_laser_blocks.csv",
    }  # fmt: skip


def test_a_table_is_taken_in_place_of_the_bag_by_the_commands_that_take_tables(tmp_path: Path) -> None:
    path = Path(run(BAG, "csv", tmp_path / "run.csv", "--topic", "/sensors/laser"))
    table, bag = (read_recording(source, "support_displacement", "beam_displacement") for source in (path, BAG))
    assert table.rate == pytest.approx(bag.rate, rel=1e-12)
    np.testing.assert_array_equal(table.beam, bag.beam)
    np.testing.assert_array_equal(np.asarray(table.support), np.asarray(bag.support))


def test_matlab_is_read_back_by_scipy_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    found = loadmat(run(bag, "mat", tmp_path / "run.mat"), simplify_cells=True)
    laser = found["sensors_laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], expected(1))
    np.testing.assert_array_equal(laser["stamp"], START + np.arange(560) * 1_000_000)
    assert laser["units"]["beam_displacement"] == "m"
    assert (laser["about_lost"], laser["about_gap_first_index"]) == (60, 200)
    assert found["sensors_force"]["about_rate"] == SLOW
    assert found["events"]["text"] == '60 lost, "here" #1'
    assert found["about"]["run_id"] == "numbers"


def test_uff_58_is_read_back_by_pyuff_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    sets = pyuff.UFF(run(bag, "uff", tmp_path / "run.uff")).read_sets()
    assert [one["type"] for one in sets] == [151, 164, *[58] * 6]
    records = [one for one in sets if one["type"] == 58]
    assert {one["func_type"] for one in records} == {1}
    support = [one for one in records if one["rsp_node"] == 1]
    beam = [one for one in records if one["rsp_node"] == 2]
    force = [one for one in records if one["rsp_node"] not in (1, 2)]
    assert ([len(one["data"]) for one in support], len(beam), len(force)) == ([200, 300], 3, 1)
    values = expected(1)
    for one, begin in zip(beam, (0, 58, 260), strict=True):
        np.testing.assert_array_equal(one["data"], values[begin : begin + len(one["data"])])
        assert one["abscissa_min"] == pytest.approx(begin / RATE, rel=1e-5)
        assert one["abscissa_inc"] == pytest.approx(1.0 / RATE)
        assert f"first index {begin}," in one["id4"]
        assert (one["ordinate_axis_units_lab"], one["ordinate_spec_data_type"], one["rsp_dir"]) == ("m", 8, 3)
    assert force[0]["ordinate_axis_units_lab"] == "N"


def test_parts_without_a_gap_across_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atpid_control.export.uff_file._ROWS", 4)
    generator = np.random.default_rng(2)
    for _ in range(50):
        values = np.where(generator.random(17) < 0.3, np.nan, 1.0)
        valid = np.flatnonzero(np.isfinite(values))
        found = list(runs(values))
        assert [place for begin, end in found for place in range(begin, end)] == list(valid)
        assert all(begin < end for begin, end in found)
        assert all(end < following for (_, end), (following, _) in pairwise(found))


def test_parquet_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: `make parquet` installs it")
    path = run(bag, "parquet", tmp_path / "run.parquet")
    table = pd.read_parquet(path)
    np.testing.assert_array_equal(table["beam_displacement"], expected(1))
    np.testing.assert_array_equal(table["stamp"], START + np.arange(560) * 1_000_000)
    schema = parquet.read_schema(path)
    assert schema.field("beam_displacement").metadata[b"units"] == b"m"
    about = json.loads(parquet.read_metadata(path).metadata[b"atpid"])
    assert (about["lost"], about["run"]["run_id"]) == (60, "numbers")
    assert pd.read_parquet(tmp_path / "run.events.parquet")["text"].item() == '60 lost, "here" #1'


def test_a_dataset_survives_a_round_trip_through_pandas(bag: Path) -> None:
    laser = open_bag(bag)["sensors/laser"].to_dataset()
    again = xr.Dataset.from_dataframe(laser.to_dataframe())
    np.testing.assert_array_equal(again["beam_displacement"], laser["beam_displacement"])


def test_a_part_and_one_topic(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = run(bag, "csv", tmp_path / "part.csv", "--topic", "/sensors/force", "--from", "0.1", "--to", "0.2")
    assert "part.csv: sensors/force, 33 rows" in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert (table["index"].iloc[0], table["index"].iloc[-1]) == (32, 64)
    assert {item.name for item in tmp_path.iterdir()} == {"part.csv", "part.sensors_force_blocks.csv"}


def test_a_bag_that_breaks_off_gives_what_is_there(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut"
    cut.mkdir()
    whole = (BAG / "bag_0.mcap").read_bytes()
    (cut / "bag_0.mcap").write_bytes(whole[: len(whole) // 2])
    shutil.copy(BAG / "metadata.yaml", cut)
    run(cut, "csv", tmp_path / "cut.csv")
    lines = capsys.readouterr().out.splitlines()
    rows = len(pd.read_csv(tmp_path / "cut.csv", comment="#"))
    assert 1000 < rows < 8000
    blocks = (8000 - rows) // 50
    assert any(line.startswith("missing: bag_0.mcap breaks off after") for line in lines)
    assert f"missing: /sensors/laser: {blocks} of 160 messages that metadata.yaml lists are missing" in lines
    kept, every = (open_bag(path)["sensors/laser"].to_dataset()["beam_displacement"] for path in (cut, BAG))
    np.testing.assert_array_equal(kept, every[:rows])


def test_a_stream_that_starts_anew_is_a_table_of_its_own_and_what_goes_back_is_left_out(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", new_run(run_id="anew", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    for number, first in enumerate((0, 50, 50, 100, 0, 50)):
        at = START + number * 50_000_000
        writer.write("/sensors/laser", block(first, samples(first + np.arange(50)), RATE, START), at, at)
    writer.close({"finished": "yes"})
    tree = open_bag(tmp_path / "run")
    assert tree["sensors/laser"].sizes["time"] == 150
    assert tree["sensors/laser_2"].sizes["time"] == 100
    assert "sensors/laser: 1 messages left out: a block goes back to index 50 after 99" in tree.attrs["missing"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{tmp}/none", "--format", "csv", "--out", "{tmp}/a.csv"], "no such bag"),
        (["{tmp}", "--format", "csv", "--out", "{tmp}/a.csv"], "not a bag, there is no .mcap file"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/a.mat"], "allowed with --format csv: a file that ends in .csv"),
        (["{bag}", "--format", "uff", "--topic", "/events", "--out", "{tmp}/a.uff"], "there are no samples"),
        (["{bag}", "--format", "mat", "--topic", "/force", "--out", "{tmp}/a.mat"], "given /force; in the bag"),
        (["{bag}", "--format", "csv", "--from", "100", "--out", "{tmp}/a.csv"], "no row from 100"),
        (["{bag}", "--format", "mat", "--from", "100", "--out", "{tmp}/a.mat"], "no row from 100"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/there.csv"], "exists already"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/half.csv"], "half.events.csv: exists already"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(
    bag: Path, tmp_path: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("there.csv", "half.events.csv"):
        (tmp_path / name).write_text("mine")
    assert main(["export", *(text.format(bag=bag, tmp=tmp_path) for text in arguments)]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert len(printed.err.splitlines()) == 1
    assert {item.name: item.read_text() for item in tmp_path.iterdir()} == {
        "there.csv": "mine", "half.events.csv": "mine",
    }  # fmt: skip


def test_without_pyarrow_one_line_says_what_to_install(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(bag), "--format", "parquet", "--out", str(tmp_path / "a.parquet")]) == 2
    assert "`make parquet` installs it" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_topic_that_is_not_there(bag: Path) -> None:
    with pytest.raises(ExportError, match="given /none; in the bag: /events, /excitation"):
        open_bag(bag, ["/none"])


@pytest.mark.slow
@pytest.mark.parametrize(("form", "most"), [("csv", 0.5), ("uff", 0.5), ("mat", 2.0)])
def test_memory_does_not_grow_with_the_length_of_the_bag(tmp_path: Path, form: str, most: float) -> None:
    """Of a bag three times as long at most `most` MB more: in MATLAB's format a column of 8 bytes a sample."""
    peaks = []
    for number, blocks in enumerate((40, 120)):
        bag = written(tmp_path / f"run{number}", blocks, size=1000)
        main(["export", str(bag), "--format", form, "--out", str(tmp_path / f"first{number}.{form}")])
        tracemalloc.start()
        main(["export", str(bag), "--format", form, "--out", str(tmp_path / f"again{number}.{form}")])
        peaks.append(tracemalloc.get_traced_memory()[1] * 1e-6)
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < most, peaks


#: Reads a bag with nothing but a public library, and prints how many messages and the sum of one channel.
_READERS = {
    "mcap": """
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
reader = make_reader(open(sys.argv[1] + "/bag_0.mcap", "rb"), decoder_factories=[DecoderFactory()])
blocks = [message for _, _, _, message in reader.iter_decoded_messages(topics=["/sensors/laser"])]
""",
    "rosbags": """
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as reader:
    chosen = [c for c in reader.connections if c.topic == "/sensors/laser"]
    blocks = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections=chosen)]
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("reader", list(_READERS))
def test_public_readers_open_the_bag_without_the_workspace(reader: str, tmp_path: Path) -> None:
    without_workspace = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    check = "import importlib.util, sys\nassert not importlib.util.find_spec('atpid_interfaces')\n"
    end = "print(len(blocks), sum(x for block in blocks for x in block.data[1::2]).hex())"
    command = [sys.executable, "-c", check + _READERS[reader] + end, str(BAG)]
    done = subprocess.run(command, cwd=tmp_path, env=without_workspace, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    total = 0.0
    for _, message in messages_of(BAG).messages("/sensors/laser"):
        for value in np.asarray(message.data)[1::2].tolist():
            total += value
    assert done.stdout.split() == ["160", total.hex()]


def test_the_pass_over_a_bag_can_be_used_alone(bag: Path) -> None:
    source = Source(bag)
    rows = {table.name: 0 for table in source.tables}
    for piece in source.pieces():
        rows[piece.table.name] = rows.get(piece.table.name, 0) + len(piece)
    assert rows["sensors/laser"] == 560
    assert {table.name: table.rows for table in source.tables} == rows
