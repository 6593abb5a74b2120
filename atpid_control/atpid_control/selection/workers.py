# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Jobs shared by the calling thread and helpers: the next one free takes the next job, so that cost is shared."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from types import TracebackType
from typing import Any, Generic, TypeVar

Job = TypeVar("Job")
Answer = TypeVar("Answer")
_OPEN: Any = object()


class _Batch(Generic[Job, Answer]):
    """Jobs in work."""

    def __init__(self, work: Callable[[Job], Answer], jobs: list[Job]) -> None:
        self._work, self.jobs, self._next = work, jobs, count()
        self._answers: list[Any] = [_OPEN] * len(jobs)

    def take(self) -> None:
        """Do jobs until all have been begun; `next` of a count is one step of the interpreter."""
        while (k := next(self._next)) < len(self.jobs):
            self._do(k)

    def answers(self) -> list[Answer]:
        """Return all answers in the order of the jobs; raise the first error.

        What a helper has begun and not finished is done again here: on a busy machine the helper may have to wait for
        its processor, and the answer is the same.
        """
        for k in range(len(self.jobs)):
            if self._answers[k] is _OPEN:
                self._do(k)
        for answer in self._answers:
            if isinstance(answer, Exception):
                raise answer
        return self._answers

    def _do(self, k: int) -> None:
        try:
            self._answers[k] = self._work(self.jobs[k])
        except Exception as error:  # raised by `answers`, in the calling thread
            self._answers[k] = error


@contextmanager
def without_collection() -> Iterator[None]:
    """Postpone the collection of cyclic garbage: a full one takes 60 to 150 ms, longer than a selection.

    Where several threads do so at once, the first to begin ends it for all: then one selection may be late, no more.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class SelectionThreads:
    """Threads for a selection; `map` is a `Mapper` whose jobs may be done twice, so they must not change anything."""

    def __init__(self, number: int) -> None:
        """Take the number of threads, the calling one among them."""
        self._helpers = max(number - 1, 0)
        self._pool = ThreadPoolExecutor(self._helpers) if self._helpers else None

    def __enter__(self) -> SelectionThreads:
        """Return the workers."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the threads."""
        if self._pool:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def map(self, work: Callable[[Job], Answer], jobs: Iterable[Job]) -> list[Answer]:
        """Return the answer to each job, in order. Jobs that take long should come first."""
        batch = _Batch(work, list(jobs))
        if self._pool:
            for _ in range(min(self._helpers, len(batch.jobs) - 1)):
                self._pool.submit(batch.take)
        batch.take()
        return batch.answers()
