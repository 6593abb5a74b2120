# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of faults through the real graph in lockstep, each judged by what has to hold whatever happens."""

import json
import math
import os
import shutil
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from atpid_common.injected_faults import FAULT_KINDS, KINDS, LOCKSTEP, Injected, overlapping
from atpid_common.vocabulary import Mode
from atpid_control.runs.check import check
from atpid_control.stand.errors import BenchError
from atpid_sim.system import Array
from studies.fault_matrix.run import Finished, different, run

#: When the first fault may begin, and when all have ended [s]; what is left is for the recovery.
EARLIEST, LATEST = 2.0, 8.0
#: How long a fault lasts [s], drawn evenly in its logarithm; and by which factor its value is off the usual one.
LASTS, VALUES = (0.02, 4.0), (0.3, 3.0)
#: After the last fault and the arming, the height may differ from that of the run without faults by this share.
SAME_END = 0.1
#: In which the ceiling has gone from one end of its range to the other [s].
_TAKEN_UP = 3.5
_JOURNAL, _LOGS = "sequences.jsonl", "log"
_MODES = [mode for mode in Mode if mode is not Mode.UNCONFIGURED]


@dataclass(frozen=True)
class Sequence:
    """One sequence: what was injected, and what went against the documentation, one line each."""

    number: int
    faults: tuple[Injected, ...]
    felt: int  # of the faults: while they were there their part gave something else than without faults
    problems: tuple[str, ...]


def drawn(seed: int, number: int, count: int) -> tuple[Injected, ...]:
    """Return the faults of sequence `number`: `count` of random part, kind, value, begin and duration.

    Parts may fail together; a part has one fault at a time.
    """
    random = np.random.default_rng([seed, number])
    found: list[Injected] = []
    while len(found) < count:
        part, kind = str(random.choice(LOCKSTEP)), str(random.choice(KINDS))
        length = math.exp(random.uniform(math.log(LASTS[0]), math.log(LASTS[1])))
        begin = random.uniform(EARLIEST, LATEST - length)
        fault = Injected(part, kind, round(begin, 3), round(begin + length, 3), _value(random, part, kind))
        if not overlapping([*found, fault]):
            found.append(fault)
    return tuple(sorted(found, key=lambda fault: fault.begin))


def _value(random: np.random.Generator, part: str, kind: str) -> float:
    meaning = FAULT_KINDS[part][kind]
    factor = math.exp(random.uniform(math.log(VALUES[0]), math.log(VALUES[1])))
    value = min(max(meaning.default * factor, meaning.low), meaning.high)
    return float(f"{value:.4g}") if meaning.unit else math.nan


def problems(faults: tuple[Injected, ...], finished: Finished, usual: Finished, findings: list[str]) -> list[str]:
    """Return what is wrong with a run, one line each; `usual`: the run without faults, `findings`: the checker's."""
    blocks, estimates, commands = finished.answered
    modes, bits = finished.states[:, 2], finished.states[:, 3]
    last, usual_last = finished.commands[-1, 1], usual.commands[-1, 1]
    end = float(finished.ceiling[-1])
    found = {
        f"the run ended early: {finished.error}": bool(finished.error),
        f"{blocks} blocks, {estimates} estimates, {commands} commands": not blocks == estimates == commands,
        f"{blocks} blocks, without faults {usual.answered[0]}": blocks != usual.answered[0],
        "the bag is not whole": not finished.whole,
        "a state that is not documented": not np.isin(modes, _MODES).all(),
        "a fault without a name": bool(np.any((modes == Mode.FAULT) & (bits == 0))),
        "a motor that goes on with a fault latched": bool(np.any((modes != Mode.FAULT) & (bits != 0))),
        "not armed again after the last fault": modes[-1] == Mode.FAULT,
        f"at the end {last:g} m commanded, without faults {usual_last:g} m":
            not abs(last - usual_last) <= SAME_END * usual_last,
        f"at the end the ceiling at {end:g} m, commanded {last:g} m": not abs(end - last) <= SAME_END * usual_last,
    }  # fmt: skip
    moved = _moved_while_off(faults, finished)
    found[f"the ceiling moved {moved:.4f} m with the motor off"] = moved > 0.0
    return [text for text, wrong in found.items() if wrong] + [f"check: {finding}" for finding in findings]


def _moved_while_off(faults: tuple[Injected, ...], finished: Finished) -> float:
    """Return how far the ceiling moved at most between two reports of a latched fault [m]; 0: not at all."""
    times, modes = finished.states[:, 0], finished.states[:, 2]
    welded = [fault for fault in faults if fault.part == "motor" and fault.kind == "stuck"]
    # after a clock that was set back or stood, the simulated motor and then the ceiling take up the time that passed
    unclear = [replace(one, end=one.end + _TAKEN_UP) for one in faults if one.part == "clock"]
    unclear += [replace(one, end=one.end + 0.1) for one in welded]
    most = 0.0
    for begin, end, before, after in zip(times[:-1], times[1:], modes[:-1], modes[1:], strict=True):
        if before != Mode.FAULT or after != Mode.FAULT or any(one.begin <= end and begin <= one.end for one in unclear):
            continue
        path = _part(finished, begin, end)
        most = max(most, float(np.ptp(path)) if path.size else 0.0)
    return most if most > 1e-9 else 0.0


def _part(finished: Finished, begin: float, end: float) -> Array:
    found: Array = finished.ceiling[round(begin * finished.rate) : round(end * finished.rate)]
    return found


class Sequences:
    """The sequences of one seed in a folder: a journal of those that were run, and what those that failed left."""

    def __init__(self, folder: Path, seed: int, count: int) -> None:
        """Take up the journal in `folder`. Raises BenchError where it is one of other sequences."""
        self.folder, self.seed, self.count = folder, seed, count
        self.done: dict[int, list[str]] = {}
        self.felt = 0
        self._usual: Finished | None = None
        self._journal = folder / _JOURNAL
        given = {"seed": seed, "faults": count}
        if not self._journal.exists():
            self._write(given)
            return
        begun, *lines = (json.loads(line) for line in self._journal.read_text(encoding="utf-8").splitlines())
        if begun != given:
            raise BenchError(f"--out: given {folder}, which has sequences of {begun}; give another folder")
        passed = [line for line in lines if not line["problems"]]  # those that failed are run again
        self.done = {line["number"]: line["problems"] for line in passed}
        self.felt = sum(line["felt"] for line in passed)

    def run(self, total: int, shown: Callable[[int], None]) -> Iterator[Sequence]:
        """Run those of the first `total` sequences that have not passed yet, and yield each."""
        logs = self.folder / _LOGS
        logs.mkdir(exist_ok=True)
        os.environ["ROS_LOG_DIR"] = str(logs)
        for number in range(total):
            shown(number + 1)
            if number not in self.done:
                sequence = self._one(number)
                self.done[number] = list(sequence.problems)
                self.felt += sequence.felt
                self._write({"number": number, "felt": sequence.felt, "problems": sequence.problems})
                yield sequence

    def _write(self, line: Mapping[str, object]) -> None:
        with self._journal.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def _one(self, number: int) -> Sequence:
        if self._usual is None:
            shutil.rmtree(self.folder / "without", ignore_errors=True)
            self._usual = run((), self.folder, "without")
        faults, name = drawn(self.seed, number, self.count), f"sequence-{number:04d}"
        bag = self.folder / name
        shutil.rmtree(bag, ignore_errors=True)  # of a run that was interrupted
        logged, felt = _tracebacks(self.folder / _LOGS), 0
        try:
            finished = run(faults, self.folder, name)
            felt = sum(different(fault, finished, self._usual) for fault in faults)
            found = problems(faults, finished, self._usual, check(bag).findings)
            found += [] if felt else ["no fault was felt"]
        except Exception:  # noqa: BLE001  # whatever it is, it is what is looked for: kept with its seed, and the next sequence follows
            found = [f"traceback: {traceback.format_exc()}"]
        if more := _tracebacks(self.folder / _LOGS) - logged:
            found.append(f"{more} tracebacks in {self.folder / _LOGS}")
        if not found:
            shutil.rmtree(bag)
            (self.folder / f"{name}.yaml").unlink()
        return Sequence(number, faults, felt, tuple(found))


def _tracebacks(logs: Path) -> int:
    return sum(file.read_text(errors="replace").count("Traceback (most recent") for file in logs.iterdir())
