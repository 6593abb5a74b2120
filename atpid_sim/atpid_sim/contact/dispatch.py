# SPDX-License-Identifier: Apache-2.0
"""One call for every law: the kernels that steppers use, chosen by the law's number.

The error model is named, here and in every law: a function that names none takes it from whoever compiles it first, and
with Python's, which a call from outside brings, steps take 2.4 times as long (docs/decisions/0008-kernels.md).
"""

from __future__ import annotations

from numba import njit

from atpid_sim.contact import hertz, impact, kuwabara_kono, lee_herrmann, linear, tsuji, walton_braun
from atpid_sim.contact.ids import HERTZ, KUWABARA_KONO, LEE_HERRMANN, LINEAR, TSUJI, WALTON_BRAUN

_impact_force = impact.force
_linear_force = linear.force
_hertz_force = hertz.force
_lee_herrmann_force = lee_herrmann.force
_kuwabara_kono_force = kuwabara_kono.force
_tsuji_force = tsuji.force
_walton_braun_force = walton_braun.force
_impact_release_rate = impact.release_rate
_linear_release_rate = linear.release_rate
_hertz_release_rate = hertz.release_rate
_lee_herrmann_release_rate = lee_herrmann.release_rate
_kuwabara_kono_release_rate = kuwabara_kono.release_rate
_tsuji_release_rate = tsuji.release_rate
_walton_braun_release_rate = walton_braun.release_rate
_walton_braun_rest_overlap = walton_braun.rest_overlap
_impact_energy = impact.energy
_linear_energy = linear.energy
_hertz_energy = hertz.energy
_lee_herrmann_energy = lee_herrmann.energy
_kuwabara_kono_energy = kuwabara_kono.energy
_tsuji_energy = tsuji.energy
_walton_braun_energy = walton_braun.energy
_impact_restitution = impact.restitution
_linear_restitution = linear.restitution
_hertz_restitution = hertz.restitution
_lee_herrmann_restitution = lee_herrmann.restitution
_kuwabara_kono_restitution = kuwabara_kono.restitution
_tsuji_restitution = tsuji.restitution
_walton_braun_restitution = walton_braun.restitution


@njit(cache=True, error_model="numpy")
def force(law, overlap, rate, memory, p):  # type: ignore[no-untyped-def]
    """Contact force [N] for an overlap [m] and its rate [m/s]; not clamped, positive pushes apart."""
    if law == TSUJI:
        return _tsuji_force(overlap, rate, memory, p)
    if law == LINEAR:
        return _linear_force(overlap, rate, memory, p)
    if law == HERTZ:
        return _hertz_force(overlap, rate, memory, p)
    if law == LEE_HERRMANN:
        return _lee_herrmann_force(overlap, rate, memory, p)
    if law == KUWABARA_KONO:
        return _kuwabara_kono_force(overlap, rate, memory, p)
    if law == WALTON_BRAUN:
        return _walton_braun_force(overlap, rate, memory, p)
    return _impact_force(overlap, rate, memory, p)


@njit(cache=True, error_model="numpy")
def release_rate(law, overlap, memory, p):  # type: ignore[no-untyped-def]
    """Overlap rate [m/s] above which the force is positive at this overlap [m]."""
    if law == TSUJI:
        return _tsuji_release_rate(overlap, memory, p)
    if law == LINEAR:
        return _linear_release_rate(overlap, memory, p)
    if law == HERTZ:
        return _hertz_release_rate(overlap, memory, p)
    if law == LEE_HERRMANN:
        return _lee_herrmann_release_rate(overlap, memory, p)
    if law == KUWABARA_KONO:
        return _kuwabara_kono_release_rate(overlap, memory, p)
    if law == WALTON_BRAUN:
        return _walton_braun_release_rate(overlap, memory, p)
    return _impact_release_rate(overlap, memory, p)


@njit(cache=True, error_model="numpy")
def rest_overlap(law, memory, p):  # type: ignore[no-untyped-def]
    """Overlap [m] that a contact leaves behind when its force has vanished: the dent of a hysteretic law, else 0."""
    if law == WALTON_BRAUN:
        return _walton_braun_rest_overlap(memory, p)
    return 0.0


@njit(cache=True, error_model="numpy")
def energy(law, overlap, memory, p):  # type: ignore[no-untyped-def]
    """Energy [J] that the contact gives back when it is let go from this overlap [m]."""
    if law == TSUJI:
        return _tsuji_energy(overlap, memory, p)
    if law == LINEAR:
        return _linear_energy(overlap, memory, p)
    if law == HERTZ:
        return _hertz_energy(overlap, memory, p)
    if law == LEE_HERRMANN:
        return _lee_herrmann_energy(overlap, memory, p)
    if law == KUWABARA_KONO:
        return _kuwabara_kono_energy(overlap, memory, p)
    if law == WALTON_BRAUN:
        return _walton_braun_energy(overlap, memory, p)
    return _impact_energy(overlap, memory, p)


@njit(cache=True, error_model="numpy")
def restitution(law, speed, mass, p):  # type: ignore[no-untyped-def]
    """Restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    if law == TSUJI:
        return _tsuji_restitution(speed, mass, p)
    if law == LINEAR:
        return _linear_restitution(speed, mass, p)
    if law == HERTZ:
        return _hertz_restitution(speed, mass, p)
    if law == LEE_HERRMANN:
        return _lee_herrmann_restitution(speed, mass, p)
    if law == KUWABARA_KONO:
        return _kuwabara_kono_restitution(speed, mass, p)
    if law == WALTON_BRAUN:
        return _walton_braun_restitution(speed, mass, p)
    return _impact_restitution(speed, mass, p)
