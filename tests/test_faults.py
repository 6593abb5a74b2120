# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults injected into the real graph are felt, end in their documented states, and cost nothing of the record."""

import contextlib
import io
import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
from graph_runs import in_real_time
from hypothesis import settings

from atpid_common.channel_monitor import ChannelState
from atpid_common.injected_faults import KINDS, LOCKSTEP, PARTS, FaultError, Injected, overlapping, parsed
from atpid_common.vocabulary import Mode
from atpid_control.cli import main as control
from atpid_control.loop.signal_watch import ClockWatch, SignalSettings, SignalWatch
from atpid_control.runs.check import check
from atpid_control.runs.recover import recover
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import NodeDiedError
from atpid_sim.plant.stream import ChannelFaults, stamp_shift
from atpid_sim.scene import SceneError, standard_bench
from atpid_sim.system import Array
from studies.cli import main
from studies.fault_matrix import command
from studies.fault_matrix.journal import Journal
from studies.fault_matrix.run import BEGIN, END, Finished, Row, different, problems, reference_of, row_of, rows, run

LONG = settings.get_current_profile_name() == "long"
#: How faults are detected, where that is more than the matrix itself requires: part, kind, event, latest [s].
ROWS = [
    ("support_laser", "off", "fault", 0.25),
    ("support_laser", "stuck", "fault", 0.25),
    ("support_laser", "garbage", "fault", 0.1),
    ("support_laser", "wrong", "drift", 3.0),
    ("beam_laser", "intermittent", "fault", 1.1),
    ("accelerometer", "wrong", "", math.nan),
    ("height_sensor", "off", "fault", 0.1),
    ("height_sensor", "stuck", "fault", 4.0),
    ("motor", "off", "fault", 4.0),
    ("motor", "wrong", "fault", 3.5),
    ("motor", "stuck", "fault", 5.0),
    ("clock", "off", "fault", 0.1),
]
FAULT = {"part": "support_laser", "kind": "off", "from": 1.0, "to": 2.0}
#: The part whose seven rows the command runs, once for all tests.
COMMANDED = "support_laser"
SETTINGS = SignalSettings(dead_time=0.2, frozen_time=0.2, largest_velocity=30.0, recovery_time=0.5, invalid_share=0.2)
RATE = 1000.0
TONE = 0.03 * np.sin(2.0 * np.pi * 5.47 * np.arange(6000) / RATE)


class Runs:
    """The runs of this module in a folder, those without a fault once each."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.printed: list[str] = []  # by the command
        self._usual: dict[tuple[Injected, ...], Finished] = {}

    def run(self, faults: tuple[Injected, ...], folder: Path, name: str) -> Finished:
        """Run as `studies.fault_matrix.run.run`; return the finished run again where nothing fails before its end."""
        made = self._usual.get(faults) or run(faults, folder, name)
        if faults in map(reference_of, LOCKSTEP):
            self._usual[faults] = made
        return made

    def reference(self, part: str) -> Finished:
        """Return the run without a fault that the part is compared with."""
        return self.run(reference_of(part), self.folder, f"without-{part}")

    def command(self, *arguments: str) -> int:
        """Run the command; keep what it prints."""
        with contextlib.redirect_stdout(io.StringIO()) as printed, pytest.MonkeyPatch.context() as patch:
            patch.setattr(command, "run_one", self.run)
            status = main(["faults", *arguments])
        self.printed = printed.getvalue().splitlines()
        return status

    def row(self, part: str, kind: str) -> Row:
        """Return a row of the matrix, the commanded part's from the journal of the command."""
        if part == COMMANDED:
            return Journal(self.folder / part).rows[part, kind]
        fault = Injected(part, kind, BEGIN, END)
        return row_of(fault, self.run((fault,), self.folder, f"{part}-{kind}"), self.reference(part))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    """The runs, after the command has run those of its part."""
    made = Runs(tmp_path_factory.mktemp("faults"))
    with own_domain(None):
        assert made.command("--out", str(made.folder / COMMANDED), "--part", COMMANDED) == 0
        yield made


#: A twelfth of the others, beside those of the command. `python -m studies faults` acts them all.
OTHERS = sorted({*rows()} - {(part, kind) for part, kind, *_ in ROWS})
SOME = OTHERS if LONG else [one for one in OTHERS if one[0] != COMMANDED][::12]


@pytest.mark.parametrize(("part", "kind"), SOME)
def test_a_fault_is_felt(part: str, kind: str, runs: Runs) -> None:
    assert problems(runs.row(part, kind)) == []


@pytest.mark.parametrize(("part", "kind", "event", "latest"), ROWS)
def test_a_fault_is_felt_and_ends_as_documented(part: str, kind: str, event: str, latest: float, runs: Runs) -> None:
    row = runs.row(part, kind)
    assert problems(row) == []
    assert (row.detected.kind if row.detected else "") == event
    assert row.detected is None or row.detected.time - BEGIN <= latest
    assert math.isfinite(row.recovery)


def test_a_fault_that_is_not_acted_is_noticed(runs: Runs) -> None:
    usual = runs.reference("support_laser")
    (problem,) = problems(row_of(Injected("support_laser", "off", BEGIN, END), usual, usual))
    assert {"support_laser", "off:", "not", "felt"} <= set(problem.split())


def test_the_command_runs_a_part_of_the_matrix(
    runs: Runs, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [line.split()[1] for line in runs.printed[:7]] == list(KINDS)
    monkeypatch.setattr(command, "run_one", unused)  # what was run is not run again
    assert main(["faults", "--out", str(runs.folder / COMMANDED), "--part", COMMANDED]) == 0
    assert capsys.readouterr().out.splitlines() == runs.printed
    (tmp_path / "notes.txt").touch()
    assert main(["faults", "--out", str(tmp_path)]) == 2


def drawn(seed: int, count: int) -> tuple[Injected, ...]:
    """Return faults of random part, kind, begin and duration; parts may fail together, each by one fault at a time."""
    random, found = np.random.default_rng(seed), list[Injected]()
    while len(found) < count:
        part, kind = str(random.choice(LOCKSTEP)), str(random.choice(KINDS))
        length = math.exp(random.uniform(math.log(0.02), math.log(4.0)))
        begin = random.uniform(2.0, 8.0 - length)
        fault = Injected(part, kind, round(begin, 3), round(begin + length, 3))
        if not overlapping([*found, fault]):
            found.append(fault)
    return tuple(sorted(found, key=lambda fault: fault.begin))


@pytest.mark.parametrize("seed", range(1, 21 if LONG else 2))
def test_a_random_sequence_ends_in_documented_states(seed: int, runs: Runs, tmp_path: Path) -> None:
    usual = runs.reference("support_laser")
    faults = drawn(seed, 8)
    finished = run(faults, tmp_path, "sequence")
    assert sum(different(fault, finished, usual) for fault in faults) >= 4  # others are too short to be felt
    assert check(tmp_path / "sequence").findings == []
    assert (finished.error, finished.whole) == ("", True)
    assert set(finished.answered) == {usual.answered[0]}
    modes, latched = finished.states[:, 2], finished.states[:, 3] != 0
    assert np.isin(modes, [mode for mode in Mode if mode is not Mode.UNCONFIGURED]).all()
    assert np.array_equal(modes == Mode.FAULT, latched)  # a fault has a name, and no motor goes on with one
    assert modes[-1] != Mode.FAULT  # a person has armed it after the last fault
    assert finished.commands[-1, 1] == pytest.approx(usual.commands[-1, 1], rel=0.1)
    assert finished.ceiling[-1] == pytest.approx(usual.commands[-1, 1], rel=0.1)


@pytest.mark.parametrize(
    ("part", "command", "way"),
    [
        ("serial_link", "bench", "serial"),
        ("serial_link", "bench --real-time", "--emulated-stand"),
        ("recorder", "bench", "process"),
        ("support_laser", "stand", "stand"),
    ],
)
def test_what_cannot_be_acted_is_refused_by_name(
    part: str, command: str, way: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
    scene = standard_bench(ceiling=ceiling, duration=4.0, faults=[FAULT | {"part": part}])
    (tmp_path / "scene.yaml").write_text(scene.to_yaml(), encoding="utf-8")
    name, *more = command.split()
    out = ["--out", str(tmp_path / "out")] if name == "bench" else []
    assert control([name, str(tmp_path / "scene.yaml"), *out, *more]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert part in line
    assert way in line


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        ([{"part": "accelerometer"}], "sensors.accelerometer"),
        ([{"from": 2.0, "to": 1.0}], "rising"),
        ([{"value": 1.0}], "none"),
        ([{"kind": "broken"}], "allowed"),
        ([{}, {"from": 1.5, "to": 3.0}], "one"),
        ([{"from": 100.0, "to": 101.0}], "end"),
        ([{"part": "motor"}], "controller"),
    ],
)
def test_a_fault_that_cannot_be_is_one_line(faults: list[dict[str, object]], reason: str) -> None:
    with pytest.raises(SceneError, match=rf"^[^\n]*\b{reason}\b[^\n]*$"):
        standard_bench(faults=[FAULT | fault for fault in faults]).require_faults_fit()


def test_the_text_of_a_fault_is_read_back() -> None:
    for part, kind in product(PARTS, KINDS):
        fault = Injected(part, kind, 1.5, 2.25)
        again = parsed([str(fault)], PARTS, "a test")
        assert str(again[0]) == str(fault)
    assert overlapping(parsed(["motor off 1 2", "motor off 2 3"], PARTS, "a test")) is None
    for line in ("support_laser off", "support_laser off a b", "support_laser off 1 nan", "x off 1 2"):
        with pytest.raises(FaultError):
            parsed([line], PARTS, "a test")


def acted(fault: Injected, block: int) -> Array:
    """Return the tone with a fault, acted block by block."""
    faults = ChannelFaults("support_laser", RATE, 1)
    starts = range(0, TONE.size, block)
    return np.concatenate([faults.act([fault], first, TONE[first : first + block]) for first in starts])


@pytest.mark.parametrize("kind", KINDS)
def test_a_channel_is_as_without_the_fault_before_and_after(kind: str) -> None:
    out = acted(Injected("support_laser", kind, 2.0, 3.0), 70)
    assert np.array_equal(out[:2000], TONE[:2000])
    assert np.array_equal(out[3000:], TONE[3000:])
    assert not np.array_equal(out[2000:3000], TONE[2000:3000], equal_nan=True)


def test_closed_forms_of_the_kinds() -> None:
    def acted_on(kind: str, value: float = math.nan) -> Array:
        return acted(Injected("support_laser", kind, 2.0, 5.0, value), 50)

    assert np.all(np.isnan(acted_on("off")[2000:5000]))
    assert np.all(acted_on("stuck")[2000:5000] == TONE[1999])
    assert np.array_equal(acted_on("delayed", 0.1)[2000:5000], TONE[1900:4900])
    assert np.array_equal(acted_on("wrong", 0.5)[2000:5000], 0.5 * TONE[2000:5000])
    # a first-order lag passes 1 / sqrt(1 + (omega tau)^2) of a tone
    lagging = acted_on("slow", 0.05)[4000:5000]
    assert np.ptp(lagging) / np.ptp(TONE) == pytest.approx(1.0 / math.hypot(1.0, 2.0 * math.pi * 5.47 * 0.05), rel=0.01)
    assert np.isnan(acted_on("intermittent", 0.1)[2000:5000]).mean() == pytest.approx(0.5, abs=0.02)


def test_stamps_of_a_faulty_clock() -> None:
    assert stamp_shift([Injected("clock", "wrong", 1.0, 2.0)], 0.5, 500_000_000, 1) == 0
    assert stamp_shift([Injected("clock", "wrong", 1.0, 2.0)], 1.5, 1_500_000_000, 1) == 3600 * 10**9
    assert stamp_shift([Injected("clock", "off", 1.0, 2.0)], 1.5, 1_500_000_000, 1) == -1_500_000_000
    assert stamp_shift([Injected("clock", "slow", 1.0, 2.0, 0.1)], 1.5, 1_500_000_000, 1) == -50_000_000


def states(readings: Array) -> list[tuple[int, ChannelState]]:
    watch, found = SignalWatch(SETTINGS), []
    for first in range(0, readings.size, 50):
        changed = watch.push(RATE, readings[first : first + 50])
        if changed is not None:
            found.append((first + 50, changed.state))
    return found


def test_a_tone_is_plausible_and_so_is_a_structure_that_comes_to_rest() -> None:
    assert states(TONE) == []
    ended = TONE * np.clip(np.linspace(3.0, -2.0, TONE.size), 0.0, 1.0)  # constant at zero for the last 2.4 s
    assert np.ptp(ended[-2000:]) == 0.0
    assert states(ended) == []
    assert states(np.zeros(3000)) == []  # a support that never moves


def test_a_stop_in_mid_motion_is_found_whatever_its_phase() -> None:
    for phase in range(2000, 2190, 13):
        stuck = TONE.copy()
        stuck[phase:4000] = TONE[phase]
        (at, found), (again, ended) = states(stuck)
        assert (found, ended) == (ChannelState.FROZEN, ChannelState.PLAUSIBLE)
        assert at <= phase + 250
        assert 4500 <= again <= 4600


def test_dead_impossible_and_intermittent_channels() -> None:
    dead, jumping, gaps = TONE.copy(), TONE.copy(), TONE.copy()
    dead[2000:3000] = np.nan
    jumping[2000:3000] = np.random.default_rng(1).uniform(-0.15, 0.15, 1000)
    gaps[2000:4000].reshape(-1, 100)[:, 50:] = np.nan
    found = [[state for _, state in states(readings)] for readings in (dead, jumping, gaps)]
    expected = (ChannelState.INVALID, ChannelState.IMPOSSIBLE, ChannelState.INTERMITTENT)
    assert found == [[state, ChannelState.PLAUSIBLE] for state in expected]


def test_stamps_and_indices_count_the_same_time() -> None:
    watch = ClockWatch(0.1)
    assert [watch.push(100.0 + index / RATE, index, RATE) for index in range(0, 500, 50)] == [None] * 10
    assert watch.push(200.0, 500, RATE) is True
    assert watch.push(100.55, 550, RATE) is False
    assert watch.push(300.0, 0, RATE) is None  # another stream begins


def test_the_bench_spoils_the_recorders_disk_and_kills_it_from_outside(tmp_path: Path) -> None:
    of_disk, death = ({"part": "recorder", "kind": kind, "from": begin, "to": begin + 1.0}
                      for kind, begin in (("garbage", 0.5), ("off", 1.5)))  # fmt: skip
    (tmp_path / "scene.yaml").write_text(standard_bench(faults=[of_disk, death]).to_yaml(), encoding="utf-8")
    with pytest.raises(NodeDiedError, match=r"recorder_node .*-9.*SIGKILL"):
        in_real_time(tmp_path / "scene.yaml", tmp_path / "out")
    recovered = recover(tmp_path / "out" / "bag", tmp_path / "recovered")
    assert len(recovered.lost) > 3, recovered.lost
    # and the recorder itself has no such parameter
    parameters = yaml.safe_load((tmp_path / "out" / "parameters.yaml").read_text(encoding="utf-8"))
    assert not [name for name in parameters["/**/recorder_node"]["ros__parameters"] if "fault" in name]


def unused(*_: object) -> Finished:
    pytest.fail("a run that is kept is not made again")
