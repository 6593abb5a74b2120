# SPDX-License-Identifier: Apache-2.0
"""Many runs on all cores. The kernels release the interpreter's lock, so threads are enough."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from typing import TypeVar

from atpid_sim.scene import Scene
from atpid_sim.simulation.simulate import Result, simulate

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_all_cores(
    work: Callable[[Job], Answer], jobs: Iterable[Job], workers: int | None = None
) -> Iterator[tuple[Job, Answer]]:
    """Yield (job, answer) as they come, in any order; the first error ends the rest and is raised.

    The first job runs alone, so that kernels are compiled once and not by every thread.
    """
    waiting = iter(jobs)
    first = next(waiting, None)
    if first is None:
        return
    yield first, work(first)
    pool = ThreadPoolExecutor(workers or cores())
    try:
        futures: dict[Future[Answer], Job] = {pool.submit(work, job): job for job in waiting}
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def simulate_many(
    scenes: Iterable[Scene],
    fidelity: str = "auto",
    rtol: float | None = None,
    check: bool = True,
    progress: Callable[[int], None] | None = None,
) -> list[Result]:
    """Return the result of each scene, in order, computed on all cores; errors as `simulate`.

    `progress` is called with the number done after each.
    """
    numbered = list(enumerate(scenes))
    results: dict[int, Result] = {}
    for (index, _), result in on_all_cores(lambda job: simulate(job[1], fidelity, rtol, check=check), numbered):
        results[index] = result
        if progress is not None:
            progress(len(results))
    return [results[index] for index, _ in numbered]
