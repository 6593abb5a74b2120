# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many jobs, one way: on this machine's cores or on a Dask cluster, with progress, a journal, and an end by Ctrl-C."""

from __future__ import annotations

import asyncio
import fcntl
import importlib
import json
import os
import signal
import threading
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from atpid_common.errors import InputError, extras
from atpid_common.files import Document

Job = TypeVar("Job", bound=Hashable)
Answer = TypeVar("Answer")

#: Called with the number of jobs done.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Workers:
    """What computes a batch: threads or processes of this machine, or the workers of a Dask cluster."""

    count: int | None = None  # on this machine; None: one a core
    cluster: str | None = None  # address of the scheduler of a Dask cluster; None: this machine


HERE = Workers()


@dataclass(frozen=True)
class Batch(Generic[Job, Answer]):
    """Jobs, each different, and what computes the answer of one.

    Threads are enough for kernels, which release the interpreter's lock. What computes in Python takes `processes`;
    then, as for a cluster, work, jobs and answers are sent as pickles, and files have to be readable where it runs.
    """

    work: Callable[[Job], Answer]
    jobs: Sequence[Job]
    processes: bool = False

    def run(
        self, workers: Workers = HERE, progress: Progress | None = None, record: Record[Job, Answer] | None = None
    ) -> list[Answer]:
        """Return the answers in the order of the jobs; the first error ends the rest and is raised.

        Each worker takes the next job when it has done one: long jobs hold up no short ones. Raises ClusterError.
        record: the journal of what is done. A run that was killed goes on where it stopped; the journal is removed by
        `record.finish()`, once the caller has written what it makes of the answers. Ctrl-C ends the run with one line.
        """
        report = progress or (lambda _: None)
        done: dict[Job, Answer] = {}
        try:
            with ExitStack() as ends:
                journal = None
                if record is not None:
                    journal = ends.enter_context(closing(Journal(record.path, record.purpose)))
                    kept = {job: journal.points.get(record.key(job)) for job in self.jobs}
                    done = {job: record.back(answer) for job, answer in kept.items() if answer is not None}
                report(len(done))
                missing = [job for job in self.jobs if job not in done]
                if workers.cluster is not None:
                    computed = _on_cluster(workers.cluster, self.work, missing)
                else:
                    computed = (_in_processes if self.processes else on_all_cores)(self.work, missing, workers.count)
                for job, answer in ends.enter_context(closing(computed)):
                    done[job] = answer
                    if record is not None and journal is not None:
                        journal.record(record.key(job), record.plain(answer))
                    report(len(done))
        except KeyboardInterrupt:
            again = "" if record is None else f"; the same command goes on from them, kept in {record.path}"
            raise KeyboardInterrupt(f"interrupted: {len(done)} of {len(self.jobs)} done{again}") from None
        return [done[job] for job in self.jobs]


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_all_cores(
    work: Callable[[Job], Answer], jobs: Iterable[Job], workers: int | None = None
) -> Generator[tuple[Job, Answer], None, None]:
    """Yield (job, answer) as they come, in any order; the first error ends the rest and is raised.

    The first job runs alone, so that kernels are compiled once and not by every thread.
    """
    waiting = iter(jobs)
    first = next(waiting, None)
    if first is None:
        return
    yield first, work(first)
    yield from _submitted(ThreadPoolExecutor(workers or cores()), work, waiting)


def _in_processes(
    work: Callable[[Job], Answer], jobs: Sequence[Job], workers: int | None
) -> Generator[tuple[Job, Answer], None, None]:
    if not jobs:
        return
    # a fork would copy the locks of threads but not the threads
    pool = ProcessPoolExecutor(min(workers or cores(), len(jobs)), get_context("spawn"), _end_at_once)
    resource_tracker.ensure_running()  # a process of its own, which would unblock the signal
    yield from _submitted(pool, work, jobs)


def _end_at_once() -> None:
    """Let Ctrl-C end a worker process, without its traceback; until here the signal has waited."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Hold Ctrl-C until the block has ended; a process that is started in it begins with the signal blocked.

    A worker that is still loading, or has not got what it needs for that, would print a traceback.
    """
    came: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)


def _submitted(
    pool: Executor, work: Callable[[Job], Answer], jobs: Iterable[Job]
) -> Generator[tuple[Job, Answer], None, None]:
    try:
        with _interrupt_held():
            futures: dict[Future[Answer], Job] = {pool.submit(work, job): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


#: How long a scheduler may take to answer [s].
_CONNECT_TIMEOUT = 10.0


class ClusterError(InputError):
    """A cluster that cannot be used; one line."""


def _on_cluster(
    address: str, work: Callable[[Job], Answer], jobs: Iterable[Job]
) -> Generator[tuple[Job, Answer], None, None]:
    """Yield (job, answer of `work`) as the workers of the scheduler at `address` deliver them.

    The cluster owns scheduling and retries: a job whose worker dies is done by another. Work, jobs and answers are sent
    as pickles; functions of the project by name, so that workers need it installed, and `dask[distributed]`.
    Raises ClusterError where dask is not installed, no scheduler answers, or every worker that tried a job has exited;
    what `work` raises is raised here. Jobs that wait when the caller ends are cancelled.
    """
    with extras("--cluster", ClusterError):
        distributed: Any = importlib.import_module("distributed")
    try:
        with ThreadPoolExecutor(1) as beside:  # where an event loop may run already, as in a notebook
            beside.submit(asyncio.run, _greeted(distributed, address)).result()
        client = distributed.Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        raise ClusterError(
            f"--cluster: given {address}; no Dask scheduler answers there ({type(error).__name__}); "
            "start one with `dask scheduler`, or leave the option out"
        ) from None
    with client:
        given = list(jobs)
        futures = dict(zip(client.map(work, given, pure=False), given, strict=True))
        try:
            for future in distributed.as_completed(list(futures), loop=client.loop):
                try:
                    yield futures[future], future.result()
                except distributed.scheduler.KilledWorker:
                    lost = f"--cluster: every worker that computed {futures[future]} exited; see their logs"
                    raise ClusterError(lost) from None
        finally:
            client.cancel(list(futures))


async def _greeted(distributed: Any, address: str) -> None:
    """Wait for a scheduler's greeting: a client would wait for it for ever where something else listens."""
    greeted = await asyncio.wait_for(distributed.comm.connect(address, timeout=_CONNECT_TIMEOUT), _CONNECT_TIMEOUT)
    await greeted.close()


#: Which job it is, in numbers and words; of a map: mass fraction [-], amplitude [m].
Point = tuple[object, ...]

#: Size of a journal at most [bytes]: a map of 100 000 amplitudes has 30 MB.
_MOST_BYTES = 500_000_000


class JournalError(InputError):
    """A journal that cannot be used; one line."""


@dataclass(frozen=True)
class Record(Generic[Job, Answer]):
    """What a batch keeps of its answers, and where."""

    path: Path
    purpose: Mapping[str, object]  # first line of the file: another system or other settings are refused
    key: Callable[[Job], Point]
    plain: Callable[[Answer], Mapping[str, object]]  # to what JSON has
    back: Callable[[Document], Answer]

    def finish(self) -> None:
        """Remove the journal: what the answers are for is written."""
        self.path.unlink(missing_ok=True)


def beside(out: Path) -> Path:
    """Return the journal's file for an output file."""
    return out.with_name(out.name + ".journal")


class Journal:
    """A file whose first line identifies system and settings, then one line a job, each on the disk before the next.

    An incomplete last line is dropped.
    """

    def __init__(self, path: Path, purpose: Mapping[str, object]) -> None:
        """Open or begin a journal; raise JournalError where it is another's, in use or cannot be written."""
        self.path = path
        self.points: dict[Point, Document] = {}
        try:
            self._file = self.path.open("a+b")
        except OSError as error:
            raise JournalError(f"{self.path}: cannot be written: {error.strerror}; choose another --out") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._resume(purpose)
        except OSError:
            self.close()
            problem = f"{self.path}: another run is writing it"
            raise JournalError(f"{problem}; wait for it or choose another --out") from None
        except JournalError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file, which stays for the next attempt."""
        self._file.close()

    def record(self, point: Point, values: Mapping[str, object]) -> None:
        """Put one answer on the disk."""
        self._append({"point": list(point), **values})

    def _resume(self, purpose: Mapping[str, object]) -> None:
        self._file.seek(0)
        if os.fstat(self._file.fileno()).st_size > _MOST_BYTES:
            raise JournalError(f"{self.path}: is no journal of this command; remove it or choose another --out")
        whole = self._file.read().rpartition(b"\n")[0]
        lines = whole.splitlines()
        try:
            first, rest = (json.loads(lines[0]), [_point(line) for line in lines[1:]]) if lines else (None, [])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            problem = f"{self.path}: is no journal of this command"
            raise JournalError(f"{problem}; remove it or choose another --out") from None
        if lines and first != json.loads(json.dumps(dict(purpose))):
            raise JournalError(f"{self.path}: begun for another system or tolerance; remove it or choose another --out")
        self._file.truncate(len(whole) + 1 if whole else 0)  # only now: until here it may be another's file
        self.points.update(rest)
        if not lines:
            self._append(dict(purpose))

    def _append(self, line: Document) -> None:
        try:
            self._file.write(json.dumps(line, default=_plain).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):  # without another attempt to write what is buffered
                self.close()
            raise JournalError(
                f"{self.path}: cannot be written: {error.strerror}; make room and give the same command: it goes on "
                "from what is in it"
            ) from None


def _plain(value: object) -> object:
    """Return numbers of numpy as Python's; raise TypeError for what JSON has not."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not for a journal")


def _point(line: bytes) -> tuple[Point, Document]:
    """Return which job a line is of and its answer; raise ValueError, TypeError or KeyError for another line."""
    values = dict(json.loads(line))
    point = values.pop("point")
    return tuple(value if isinstance(value, str) else float(value) for value in point), values
