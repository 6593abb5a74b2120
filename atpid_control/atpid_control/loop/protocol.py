# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the control loop share: the answer to an estimate, and where a long computation runs.

A computation longer than a few milliseconds runs inline or in a thread beside the loop; both are executors of
`concurrent.futures`. Inline, a result is there when `submit` returns, so that a loop by stamps (lockstep, the pure
loop) is the same every time. In a thread, the loop goes on and takes the result later. The compiled kernels release the
interpreter lock; the thread has a lower priority than the loop, which preempts it.
"""

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

from atpid_common.vocabulary import Severity

P = ParamSpec("P")
T = TypeVar("T")
#: Nice value of a computing thread above that of the process: it still gets a third of a core beside a busy process.
_NICE = 5


@dataclass(frozen=True)
class HeightCommand:
    """The contents of a CeilingCommand, without its header."""

    sequence: int = 0
    height: float = math.nan
    excitation_amplitude: float = math.nan
    predicted_amplitude: float = math.nan
    method: str = ""
    reason: str = "no estimate yet"


@dataclass(frozen=True)
class LoopAnswer:
    """The command that answers one estimate and, where there is an event, its kind, text and quantity."""

    command: HeightCommand
    kind: str = ""  # refused, no_use, slow, step_back, drift or fallback; empty: no event
    text: str = ""
    value: float = math.nan
    severity: int = Severity.WARNING


class InlineExecutor(Executor):
    """Runs each call in `submit` itself; the future returned is done."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run the call; an exception it raises is the future's."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def threaded(name: str) -> ThreadPoolExecutor:
    """Return an executor of one thread called `name`: its calls run one after the other."""

    def lower() -> None:  # on Linux a nice value belongs to a thread
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), min(os.nice(0) + _NICE, 19))

    return ThreadPoolExecutor(1, thread_name_prefix=name, initializer=lower)
