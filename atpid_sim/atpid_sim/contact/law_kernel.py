# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the contact laws, which numba compiles at their first use.

A law's file has the parameters that scenes read and the functions that the engine compiles; what reads a scene and
simulates nothing starts without numba, in half the time.
"""

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any


class kernel:  # noqa: N801 a decorator
    """A kernel of `atpid_sim.kernel`, made where Python or another kernel calls it first."""

    def __init__(self, function: Callable[..., float]) -> None:
        """Take the function that is compiled."""
        update_wrapper(self, function)
        self._function = function

    @cached_property
    def compiled(self) -> Any:
        """The kernel as numba has it."""
        from atpid_sim.kernel import kernel as at_once

        return at_once(self._function)

    @property
    def _numba_type_(self) -> object:
        return self.compiled._numba_type_

    def __call__(self, *arguments: object) -> float:
        """Return what the compiled function returns."""
        found: float = self.compiled(*arguments)
        return found
