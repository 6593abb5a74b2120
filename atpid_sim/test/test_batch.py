# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many runs on all cores give what one after the other gives; interrupted ones go on where they stopped."""

import json
import re
import signal
import subprocess
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from sim_program import PROGRAM
from sim_refusals import has_parts, refused

from atpid_common.testing import PATIENCE
from atpid_sim.simulation.batch import Batch, JournalError, Record, Workers, cores, on_all_cores

SCENE = Path(__file__).parents[2] / "scenes" / "standard.yaml"
#: Starts a program that Ctrl-C ends: a shell's background job, which these tests may be, ignores it.
START = ["env", "--default-signal=INT"]


def test_the_first_error_ends_the_rest() -> None:
    done = []

    def work(job: int) -> int:
        if job == 2:
            raise ArithmeticError("two")
        done.append(job)
        return job

    with pytest.raises(ArithmeticError):
        list(on_all_cores(work, range(1000), workers=2))
    assert len(done) < 1000


def test_each_core_gets_work() -> None:
    meeting = threading.Barrier(2, timeout=PATIENCE)
    jobs = dict(on_all_cores(lambda job: job == 0 or meeting.wait() >= 0, range(3), workers=2))
    assert jobs == {0: True, 1: True, 2: True}
    assert cores() >= 1
    assert list(on_all_cores(lambda job: job, [])) == []


def _record(path: Path, seed: int = 1) -> Record[int, int]:
    return Record(path, {"squares": seed}, lambda job: (job,), lambda answer: {"is": answer}, lambda kept: kept["is"])


def test_a_batch_that_was_interrupted_goes_on_where_it_stopped(tmp_path: Path) -> None:
    record, computed = _record(tmp_path / "squares.journal"), []

    def square(job: int) -> int:
        computed.append(job)
        return job * job

    def stop(done: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as ended:
        Batch(square, range(100)).run(Workers(1), stop, record)
    has_parts(str(ended.value), ("3", "100", str(record.path)))
    # those that were taken up as done, in the order in which the pool reports them
    kept_jobs = {int(json.loads(line)["point"][0]) for line in record.path.read_text().splitlines()[1:]}
    assert len(kept_jobs) == 3
    computed.clear()
    seen: list[int] = []
    assert Batch(square, range(10)).run(Workers(2), seen.append, record) == [job * job for job in range(10)]
    assert sorted(computed) == sorted(set(range(10)) - kept_jobs)
    assert seen == list(range(10 - len(computed), 11))
    with refused(JournalError, "squares.journal", "another"):
        Batch(square, range(10)).run(record=_record(record.path, 2))
    record.finish()
    assert not list(tmp_path.iterdir())


def test_processes_give_what_threads_give() -> None:
    jobs = list(range(-3, 4))
    assert Batch(abs, jobs, processes=True).run(Workers(2)) == Batch(abs, jobs).run(Workers(2)) == list(map(abs, jobs))
    assert Batch(abs, [], processes=True).run() == []


def test_ctrl_c_ends_a_map_in_one_line(tmp_path: Path) -> None:
    command = "map {scene} --amplitudes 0.01:0.04:2001 --mass-fractions 0.1 --out {}/map.npz"
    given = [part.format(tmp_path, scene=SCENE) for part in command.split()]
    journal = tmp_path / "map.npz.journal"
    with subprocess.Popen(
        [*START, *PROGRAM, *given], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 3):
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.005)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate()
    assert process.returncode == 130
    assert re.search(rf"\d+ of \d+ .*{journal}", printed.splitlines()[-1])
    assert "Traceback" not in printed
