# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""SIGINT, SIGTERM and SIGHUP of a process that must end in order, and the entry point of a node's executable."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from atpid_common.errors import DONE, AtpidError, extras

#: What asks a process to end. SIGHUP: the terminal was closed or the connection to it broke, while a motor may move.
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupt:
    """Handles SIGINT, SIGTERM and SIGHUP while it is entered; a SIGHUP that `nohup` had ignored stays ignored.

    At first a signal raises KeyboardInterrupt, so that loading and compiling can be stopped; after `defer` it only
    sets `received`, so that neither the loop nor an orderly end is torn.

    A process may be started with them blocked, as the launch files start nodes, so that none arrives before there is a
    handler. Entering unblocks them; one that was pending then only sets `received`.
    """

    def __init__(self) -> None:
        # Whether a signal has come; not a threading.Event: a signal in the middle of its `set` would wait for itself.
        self.received = False
        #: Whether one has raised KeyboardInterrupt, which Python or a library may have turned into another error.
        self.raised = False
        self._deferred = False
        self._before: list[Callable[[int, FrameType | None], object] | int | None] = []
        self._hook_before = sys.unraisablehook

    def defer(self) -> None:
        """From now on a signal only sets `received`."""
        self._deferred = True

    def ignore_further(self) -> None:
        """Ignore them from now on and after leaving: one that arrives while Python ends would change the status."""
        self._before = [signal.SIG_IGN for _ in ENDING_SIGNALS]
        for number in ENDING_SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        already, self.received = self.received, True
        if not self._deferred and not already:
            # what is torn while it is made, such as a compiler's object, may fail when it is deleted
            sys.unraisablehook = lambda _: None
            self.raised = True
            raise KeyboardInterrupt

    def __enter__(self) -> Interrupt:
        self._before = [signal.getsignal(number) for number in ENDING_SIGNALS]
        for number, before in zip(ENDING_SIGNALS, self._before, strict=True):
            if number != signal.SIGHUP or before != signal.SIG_IGN:
                signal.signal(number, self._handle)
        self._deferred, deferred = True, self._deferred
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)
        self._deferred = deferred
        return self

    def __exit__(self, *_: object) -> None:
        sys.unraisablehook = self._hook_before
        for number, before in zip(ENDING_SIGNALS, self._before, strict=True):
            signal.signal(number, before)


@contextmanager
def waking(wake: Callable[[], None]) -> Iterator[None]:
    """Call `wake`, in another thread, at each signal: Python's handlers wait for the main thread, which waits in C.

    Elsewhere than in the main thread, which alone handles signals, nothing is called.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    thread = threading.Thread(target=_wake_by, args=(read, wake), name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(write)
        thread.join()
        os.close(read)


def _wake_by(read: int, wake: Callable[[], None]) -> None:
    while os.read(read, 64):
        wake()


def run_executable(module: str) -> int:
    """Import a node's `module`, which takes seconds, and run its `main`; return the exit status.

    An interrupt while loading ends with status 0.
    """
    with Interrupt() as interrupt:
        try:
            if interrupt.received:
                return DONE
            with extras():
                loaded = importlib.import_module(module)
            # the exception is lost where it is raised in a callback of the interpreter, such as a finaliser
            return DONE if interrupt.received else int(loaded.main())
        except AtpidError as error:
            print(f"error: {error}", file=sys.stderr)
            return error.status
        except BaseException:
            # a library that is being loaded may turn KeyboardInterrupt into an error of its own
            if interrupt.received:
                return DONE
            raise
        finally:
            interrupt.ignore_further()
