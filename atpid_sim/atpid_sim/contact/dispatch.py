# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The functions of the contact laws, chosen by the number of the law (`laws.py`); the engine calls these."""

from collections.abc import Callable

from numba import njit

from atpid_sim.contact.laws import LAWS
from atpid_sim.kernel import kernel


def _compiled(function: Callable[..., float], name: str) -> Callable[..., float]:
    """Compile a part of the kernels below, which are kept with it.

    The name is its own: numba merges functions of one name and one type of arguments that come from different files of
    the cache.
    """
    function.__qualname__ = name
    made: Callable[..., float] = njit(nogil=True, error_model="numpy")(function)
    return made


def _zero(*arguments):
    return 0.0


_ZERO = _compiled(_zero, "zero")


def _by_number(name: str) -> Callable[..., float]:
    """Return a function of the law's number and the arguments of the laws' function `name`; zero where one has none.

    It compares the number with that of each law in turn, which numba compiles to one jump.
    """
    first, *others = (getattr(law, name, _ZERO) for law in LAWS)

    def only(law, *arguments):
        return first(*arguments)

    chosen = _compiled(only, f"{name}_0")
    for number, function in enumerate(others, 1):
        chosen = _compiled(_either(number, function, chosen), f"{name}_{number}")
    return chosen


def _either(number: int, function: Callable[..., float], otherwise: Callable[..., float]) -> Callable[..., float]:
    def chosen(law, *arguments):
        return function(*arguments) if law == number else otherwise(law, *arguments)

    return chosen


_force = _by_number("force")
_detachment_velocity = _by_number("detachment_velocity")
_residual_overlap = _by_number("residual_overlap")
_energy = _by_number("energy")
_restitution = _by_number("restitution")


@kernel
def force(law, overlap, velocity, memory, p):
    """Contact force [N] at an overlap [m] and its velocity [m/s]; not clamped, positive pushes apart."""
    return _force(law, overlap, velocity, memory, p)


@kernel
def detachment_velocity(law, overlap, memory, p):
    """Overlap velocity [m/s] above which the force is positive at this overlap [m]."""
    return _detachment_velocity(law, overlap, memory, p)


@kernel
def residual_overlap(law, memory, p):
    """Overlap [m] that remains when the force has vanished: the dent of a hysteretic law, else 0."""
    return _residual_overlap(law, memory, p)


@kernel
def energy(law, overlap, memory, p):
    """Elastic energy [J] stored at this overlap [m], which the contact returns in unloading."""
    return _energy(law, overlap, memory, p)


@kernel
def restitution(law, speed, mass, p):
    """Restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    return _restitution(law, speed, mass, p)
