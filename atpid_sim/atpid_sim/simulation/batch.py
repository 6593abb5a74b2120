# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many jobs, one way: on this machine's cores or on a Dask cluster, with progress, a journal, and an end by Ctrl-C."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from typing import Generic, TypeVar

from atpid_sim.simulation.cluster import on_cluster
from atpid_sim.simulation.journal import Journal, Record

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

    def computed(self, workers: Workers = HERE) -> Generator[tuple[Job, Answer], None, None]:
        """Yield (job, answer) as they come, in any order; the first error ends the rest and is raised.

        Each worker takes the next job when it has done one: long jobs hold up no short ones. Raises ClusterError.
        """
        if workers.cluster is not None:
            return on_cluster(workers.cluster, self.work, self.jobs)
        if self.processes:
            return _in_processes(self.work, self.jobs, workers.count)
        return on_all_cores(self.work, self.jobs, workers.count)

    def run(
        self,
        workers: Workers = HERE,
        progress: Progress | None = None,
        record: Record[Job, Answer] | None = None,
    ) -> list[Answer]:
        """Return the answers in the order of the jobs; raises as `computed`.

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
                    done = {job: record.back(journal.points[key]) for job in self.jobs
                            if (key := record.key(job)) in journal.points}  # fmt: skip
                report(len(done))
                missing = [job for job in self.jobs if job not in done]
                computed = Batch(self.work, missing, self.processes).computed(workers)
                for job, answer in ends.enter_context(closing(computed)):
                    done[job] = answer
                    if record is not None and journal is not None:
                        journal.record(record.key(job), record.plain(answer))
                    report(len(done))
        except KeyboardInterrupt:
            kept = "" if record is None else f"; the same command goes on from them, kept in {record.path}"
            raise KeyboardInterrupt(f"interrupted: {len(done)} of {len(self.jobs)} done{kept}") from None
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
