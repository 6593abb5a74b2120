# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Direct selection: the whole range of heights simulated, from the state the damper is in, in less than a period.

The calling thread and helpers share the jobs: the next one free takes the next job. By a deadline, runs are begun only
while there is enough of it left for one.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import cached_property, partial
from itertools import count
from typing import Any, Generic, TypeVar

from atpid_control.selection.checks import response_at
from atpid_control.selection.margin import IRREGULAR, MarginBox, MarginSearch, Robust, UncertainSystem, systems_of
from atpid_control.selection.protocol import Excitation, Selection, SelectionError, SelectionStage
from atpid_sim.maps import FROM_CLOSED, Best, DamperResponse, Timing, best_height, travelled
from atpid_sim.maps.ratings import FLAT, Mapper
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import cores
from atpid_sim.simulation.quantities import efficiency

_Job = TypeVar("_Job")
_Answer = TypeVar("_Answer")
_OPEN: Any = object()


class _Batch(Generic[_Job, _Answer]):
    """Jobs in work."""

    def __init__(self, work: Callable[[_Job], _Answer], jobs: list[_Job]) -> None:
        self._work, self.jobs, self._next = work, jobs, count()
        self._answers: list[Any] = [_OPEN] * len(jobs)

    def take(self) -> None:
        """Do jobs until all have been begun; `next` of a count is one step of the interpreter."""
        while (k := next(self._next)) < len(self.jobs):
            self._do(k)

    def answers(self) -> list[_Answer]:
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
        return self

    def __exit__(self, *_error: object) -> None:
        if self._pool:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def map(self, work: Callable[[_Job], _Answer], jobs: Iterable[_Job]) -> list[_Answer]:
        """Return the answer to each job, in order. Jobs that take long should come first."""
        batch = _Batch(work, list(jobs))
        if self._pool:
            for _ in range(min(self._helpers, len(batch.jobs) - 1)):
                self._pool.submit(batch.take)
        batch.take()
        return batch.answers()


class OutOfTimeError(Exception):
    """A computation was ended, since its share of the time had passed."""


class Deadline:
    """A time from now on."""

    def __init__(self, seconds: float) -> None:
        """Take the time [s]; math.inf: there is no deadline. Raises SelectionError for an invalid one."""
        if not seconds > 0.0:
            raise SelectionError(f"deadline: given {seconds:g} s; allowed is a time above 0 s")
        self.seconds, self._begun = seconds, time.monotonic()
        self._asked = self._longest = 0.0  # when it was asked for last, and the longest time between two questions [s]

    @property
    def spent(self) -> float:
        """Time since the beginning [s]."""
        return time.monotonic() - self._begun

    def passed(self, share: float = 1.0) -> bool:
        """Whether a share of the time has passed."""
        return self.spent > share * self.seconds

    def near(self, share: float) -> bool:
        """Whether a share of the time will have passed after one more step, asked before every step.

        A step is taken to last as long as the longest so far: on a busy machine most of it is waiting for a processor.
        """
        now = self.spent
        self._longest, self._asked = max(self._longest, now - self._asked), now
        return now + self._longest > share * self.seconds

    def limited(self, mapper: Mapper, share: float) -> Mapper:
        """Return a mapper that raises OutOfTimeError in place of the first job near a share of the time."""
        if math.isinf(self.seconds):
            return mapper

        def limited_mapper(work: Callable[[_Job], _Answer], jobs: Iterable[_Job]) -> Iterable[_Answer]:
            def in_time(job: _Job) -> _Answer:
                if self.near(share):
                    raise OutOfTimeError
                return work(job)

            return mapper(in_time, jobs)

        return limited_mapper


#: Tolerance of the complete runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-5
#: Support amplitude of a first run that is made for its kernel's sake [m].
_SMALL = 1e-6
#: Speed of the ceiling where the scene gives none [m/s]: that of the thesis's bench in scenes/.
_SPEED = 0.3
#: A second travel starts this much later, in periods: what depends on the phase of the start is not reproducible.
_LATER = 0.37
#: Shares of the deadline after which no more run of the bare optimum is begun, and no more run at all. What is left is
#: for runs that have begun, and for threads that wait for their processor on a busy machine.
_BARE, _ALL = 0.5, 0.85
#: What lies between the systems of a margin may be so much worse: efficiency [-].
_UNSEEN = 0.02


class DirectSelector:
    """Computes the optimum on all cores; with a margin, by a deadline, the height that is best in the worst case."""

    method, simulates = "direct", True

    def __init__(
        self, scene: Scene, uncertainty: MarginBox | None = None, workers: int | None = None, deadline: float = math.inf
    ) -> None:
        """Take the system of a scene, and the ceiling's range and speed where it is controlled.

        deadline: time in which a selection with a margin ends with what it has found [s]; by default none, so that it
        verifies every system and does not depend on how busy the machine is. With one, what a margin needs is made
        here, so that the first selection with a margin is as fast as the next.
        """
        self._scene, self._workers, self._deadline = scene, workers or cores(), Deadline(deadline).seconds
        self._limits = scene.height_limits
        self._speed = _SPEED if math.isnan(scene.ceiling.speed) else scene.ceiling.speed
        self._uncertainty = uncertainty or MarginBox()
        self._damper = DamperResponse(scene, _RTOL)
        # compiled now, or loaded from the cache, so that the first selection is as fast as the next
        for level in (self._damper.sufficient(_SMALL, math.inf), self._damper):
            with suppress(NumericalFailure):
                level.follow_on(_SMALL, level.closed_state(_SMALL), ((0.0, 4.0 * level.diameter),), Timing(1.0, 4.0))
        if math.isfinite(self._deadline):
            _ = self._systems

    @cached_property
    def _systems(self) -> list[UncertainSystem]:
        made = systems_of(self._scene, self._damper, self._uncertainty)
        # so that no full collection is due at the end of the next selection, before its answer is out
        gc.collect()
        return made

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the best height reached from `height` [m], or from closed; see `HeightSelector.select`."""
        spread = excitation.spread(margin)
        if margin > 0.0:
            _ = self._systems  # before the time begins to run
        deadline = Deadline(self._deadline if margin > 0.0 else math.inf)
        damper = response_at(self._damper, self._scene, excitation.frequency, _RTOL)
        approaches = FROM_CLOSED
        if height > damper.diameter * (1.0 + 1e-6):
            approaches = travelled(height, self._speed), travelled(height, self._speed, _LATER * damper.period)
        bare = partial(best_height, damper, excitation.amplitude, limits=self._limits, approaches=approaches)
        try:
            with without_collection(), SelectionThreads(self._workers) as workers:
                if margin > 0.0:
                    given = Excitation(excitation.amplitude, spread, damper.frequency)
                    return self._with_margin(damper, given, bare, workers.map, deadline)
                best = bare(mapper=workers.map)
        except NumericalFailure as error:
            raise SelectionError(f"direct: {error}") from error
        search = _searched(best)
        disagreed = search.note if best.disagreement > FLAT else ""
        chosen = best.height, best.amplitude, best.efficiency, self.method, best.evaluations, deadline.spent
        return Selection(*chosen, stages=(search,), note=disagreed)

    def _with_margin(
        self, damper: DamperResponse, given: Excitation, bare: Callable[..., Best], mapper: Mapper, deadline: Deadline
    ) -> Selection:
        """Return the height that is best in the worst case.

        given: with the margin's whole error bar as its deviation; bare: computes the bare optimum, given a mapper.
        """
        try:
            best: Best | None = bare(mapper=deadline.limited(mapper, _BARE))
        except OutOfTimeError:
            best = None  # as where many motions are irregular: the margin begins with a first look instead
        begin = math.nan if best is None else best.height
        late = partial(deadline.near, _ALL)
        found = MarginSearch(self._systems, given, self._limits, mapper, late).found(begin)
        reduction = efficiency(found.amplitude, damper.closed_amplitude(given.amplitude))
        unfinished = (
            f"of the bare optimum not ended within {_BARE * self._deadline:g} s: the price of the margin is unknown"
        )
        searched = _searched(best) if best else SelectionStage("search", math.nan, math.nan, unfinished)
        held = guaranteed(found, deadline)
        # begun with a first look alone the height may be far from the best: not to be stated among the stages only
        note = held.note if best else f"the search {searched.note}; {held.note}"
        runs = found.evaluations + (best.evaluations if best else 0)
        price = best.efficiency - reduction if best else math.nan
        chosen = found.height, found.amplitude, reduction, self.method, runs, deadline.spent, price, (searched, held)
        overdue = deadline.passed() or best is None
        return Selection(*chosen, note=note, late=overdue, box=asdict(self._uncertainty))


def guaranteed(found: Robust, deadline: Deadline) -> SelectionStage:
    """Return what a margin holds for: a bound only where each system was verified and the motion is regular in all."""
    late = f"; late: {deadline.spent:.3f} s of {deadline.seconds:g} s" if deadline.passed() else ""
    every = found.verified == found.sampled
    least = math.floor(1e3 * (found.least - _UNSEEN)) / 1e3  # a bound is not rounded up
    if every and not found.irregular:
        held = f"least efficiency {least:.3f} in {found.verified} of {found.sampled} sampled systems"
    else:
        held = f"least efficiency of those looked at {least:.3f}, no bound: verified"
        held += f" in {found.verified} of {found.sampled} sampled systems, irregular in {found.irregular} of them"
    if every and found.irregular:
        none = f"no lower height that leaves less than {IRREGULAR:g} times this beam is regular in all of them"
        held = f"{none}: {held}"
    return SelectionStage("margin", found.height, found.worst, held + late)


def _searched(best: Best) -> SelectionStage:
    if best.searched == best.checked:
        return SelectionStage("search", best.height, best.amplitude, f"with {best.checked}, which leaves out nothing")
    if best.disagreement == 0.0:
        text = f"with {best.searched}, rated with {best.checked}: not compared, what is reached depends on the path"
    elif best.disagreement <= FLAT:
        text = f"with {best.searched}; {best.checked} agrees within {best.disagreement:.1e}"
    else:
        text = f"with {best.searched}; {best.checked} differs by {best.disagreement:.1e}, so searched on with it"
    return SelectionStage("search", best.height, best.amplitude, text)
