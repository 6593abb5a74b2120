# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whole bags whose index jumps, whose rates or stamps cannot be: every reader ends, and names what is left out."""

import functools
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import settings
from mcap.records import Schema
from recorded import block
from rewritten import BAG, Change, jumps, rewritten

from atpid_control.cli import main
from atpid_control.runs.decode import Decoder
from atpid_control.runs.definitions import message_type
from atpid_control.runs.segments import LONGEST_GAP, Segments
from atpid_control.stand.summary import stage_table, summary_of, write_summary
from atpid_control.views.report.view import view_of

HOUR = 3_600_000  # of scans
BLOCKS = ("/sensors/laser", "/plant/truth")


def several(topic: str, place: int, message: Any) -> None:
    if topic in BLOCKS:
        message.first_index += (0, 2**30, 5, 2**50, HOUR)[place // 32]


def hole(topic: str, place: int, _message: Any) -> bool:
    return not (topic in BLOCKS and 60 <= place < 120)


def rates(topic: str, place: int, message: Any) -> None:
    if topic in BLOCKS and place % 10 == 3:
        message.rate = (math.nan, 0.0, -1000.0, math.inf, 1e-9)[place // 10 % 5]


def stamps(_topic: str, place: int, message: Any) -> None:
    if place > 50 and hasattr(message, "header"):
        message.header.stamp.sec += 5000 if place < 100 else -20


CHANGES: dict[str, Change] = {
    "early": jumps(40, 2**40), "late": jumps(120, 2**61), "laser only": jumps(60, 2**40, truth=False),
    "largest": jumps(80, 2**63 - 1), "one block": jumps(80, 2**61, length=1), "back": jumps(80, -4000),
    "hour": jumps(80, HOUR), "half a minute": jumps(80, 30_000), "several": several, "hole": hole, "rates": rates,
    "stamps": stamps,
}  # fmt: skip
#: Words of the line that names what happened; a gap is filled and counted.
NAMED = {
    "stamps": "its stamp is",
    "hole": "3000 samples lost in 1 gaps",
    "half a minute": "30000 samples lost",
    "rates": "its rate is",
    "largest": "its last index is",
}


#: Of each kind of table one: beside another of its own index, with rows filled in, of several parts, with blocks left
#: out by their index, rate or stamp. The long profile takes all: what is beyond a table is another number only.
READ = (
    CHANGES
    if settings.get_current_profile_name() == "long"
    else ("laser only", "largest", "half a minute", "several", "rates", "stamps")
)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return what gives the bag with a change, written once."""
    folder = tmp_path_factory.mktemp("jumps")
    return functools.cache(lambda name: rewritten(folder / name, CHANGES[name]))


@pytest.mark.parametrize("name", CHANGES)
def test_a_report_and_the_summary_of_a_bench(name: str, bags: Callable[[str], Path], tmp_path: Path) -> None:
    """Each stage is there, null where it has no sample."""
    view = view_of(bags(name), closed=lambda _scene, times: np.sin(times))
    scene = view.run.scene
    assert scene is not None
    summary = summary_of(view, scene, "lockstep")
    write_summary(summary, tmp_path / "summary.json")
    kept = json.loads((tmp_path / "summary.json").read_text())
    time = view.run.motion.time
    assert [stage["amplitude"] is None for stage in kept["stages"]] == [
        not np.isfinite(view.beam[(time >= begin) & (time <= end)]).any() for begin, end in view.windows
    ]
    stage_table(view.stages, None, "m")
    assert np.isfinite(view.run.motion.beam).sum() <= 8000
    assert view.run.duration < 8.1 + (30.0 if name == "half a minute" else 0.0)
    assert kept["missing"]


@pytest.mark.parametrize("name", READ)
def test_every_reader_ends_and_names_it(
    name: str, bags: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = bags(name)
    monkeypatch.setattr("atpid_control.commands.analyse.panels", lambda _found: ())  # drawn in the test of commands
    out = tmp_path / "out"
    for form in ("csv", "mat", "uff"):
        assert main(["bag", "export", str(folder), "--format", form, "--out", str(out / f"a.{form}")]) == 0
        said = capsys.readouterr().out
        assert NAMED.get(name, "its index") in said
        assert len(said.splitlines()) < 25
    rows = sum(len(pd.read_csv(path, comment="#")) for path in out.glob("*.csv"))
    assert rows < 22_000 * (1 if name != "half a minute" else 5)
    assert main(["bag", "analyse", str(folder), "--out", str(out / "analysis")]) == 0
    assert main(["bag", "traces", str(folder), "--out", str(out / "traces.mcap")]) == 0


def gap_and_jump(topic: str, place: int, message: Any) -> bool:
    """A table with a gap of 1.5 s that is filled, and after it another of its own."""
    if topic in BLOCKS and place >= 120:
        message.first_index += 2**50
    return not (topic in BLOCKS and 60 <= place < 90)


@pytest.mark.slow
def test_the_commands_that_draw_and_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = str(rewritten(tmp_path / "bag", gap_and_jump)), tmp_path / "out"
    commands = {
        "analyse": ["bag", "analyse", folder], "report": ["bag", "report", folder],
        "compare-bags": ["bag", "compare", folder, str(BAG)],
        "validate": ["bag", "validate", folder],
    }  # fmt: skip
    for command, words in commands.items():
        begun = time.process_time()
        status = main([*words, "--out", str(out / command)])
        said = capsys.readouterr()
        assert status == 0 or "error: " in said.err, said
        assert time.process_time() - begun < 60.0
        assert "a table of its own: its index goes from" in said.out + said.err


def test_a_later_segment_keeps_its_place_in_the_run(bags: Callable[[str], Path]) -> None:
    run = view_of(bags("early"), closed=lambda _scene, times: np.sin(times)).run
    whole = view_of(BAG, closed=lambda _scene, times: np.sin(times)).run
    np.testing.assert_allclose(run.motion.time, whole.motion.time[2000:], atol=1e-9)
    np.testing.assert_array_equal(run.motion.beam, whole.motion.beam[2000:])
    assert run.start_ns == whole.start_ns


@pytest.fixture(scope="module")
def made() -> Callable[..., Any]:
    """Return what makes a decoded block of the laser."""
    decoder = Decoder()
    decoder.add(Schema(1, message_type("atpid_interfaces/msg/SampleBlock").definition.encode(), "ros2msg",
                       "atpid_interfaces/msg/SampleBlock"))  # fmt: skip

    def make(index: int, at: float, scans: int = 100) -> Any:
        data = block(index, np.zeros((scans, 2)), start_ns=round((at - index / 1000.0) * 1e9))
        return decoder.decode(1, data)

    return make


def test_what_is_one_segment_and_what_is_another(made: Callable[..., Any]) -> None:
    longest = round(LONGEST_GAP * 1000)
    for ahead, same in ((0, True), (1, True), (longest, True), (longest + 1, False), (2**40, False), (-150, False)):
        found = Segments()
        first, second = found.place(made(100, 1.0)), found.place(made(200 + ahead, 2.0))
        assert not isinstance(second, str)
        assert (first is second) == same
        assert second.lost == (ahead if same else 0)
        assert second.jump == ("" if same else f"its index goes from 199 to {200 + ahead}, at 1000 Hz")


def test_blocks_among_others_are_no_end_of_a_segment(made: Callable[..., Any]) -> None:
    found = Segments()
    for number in range(30):
        ahead = 2**50 if number % 3 == 1 else 0
        found.place(made(number * 100 + ahead, number * 0.1))
    assert [(one.scans, one.lost) for one in found.all] == [(2000, 1000), (1000, 1800)]


def test_gaps_of_a_segment_do_not_outgrow_its_samples(made: Callable[..., Any]) -> None:
    """However many jumps of less than a minute there are, the rows of a bag are a multiple of its samples."""
    found = Segments()
    for number in range(200):
        found.place(made(number * 59_000, number * 59.0))
    rows = sum(one.scans + one.lost for one in found.all)
    assert rows < 20 * (LONGEST_GAP * 1000 + 11 * 20_000)
