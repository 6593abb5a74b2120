# SPDX-License-Identifier: Apache-2.0
"""The functions of the contact laws, chosen by the number of the law (`ids.py`); the engine calls these."""

from __future__ import annotations

from atpid_sim.contact import hertz, impact, kuwabara_kono, lee_herrmann, linear, tsuji, walton_braun
from atpid_sim.contact.ids import HERTZ, KUWABARA_KONO, LEE_HERRMANN, LINEAR, TSUJI, WALTON_BRAUN
from atpid_sim.kernel import kernel


@kernel
def force(law, overlap, velocity, memory, p):  # type: ignore[no-untyped-def]
    """Contact force [N] at an overlap [m] and its velocity [m/s]; not clamped, positive pushes apart."""
    if law == TSUJI:
        return tsuji.force(overlap, velocity, memory, p)
    if law == LINEAR:
        return linear.force(overlap, velocity, memory, p)
    if law == HERTZ:
        return hertz.force(overlap, velocity, memory, p)
    if law == LEE_HERRMANN:
        return lee_herrmann.force(overlap, velocity, memory, p)
    if law == KUWABARA_KONO:
        return kuwabara_kono.force(overlap, velocity, memory, p)
    if law == WALTON_BRAUN:
        return walton_braun.force(overlap, velocity, memory, p)
    return impact.force(overlap, velocity, memory, p)


@kernel
def detachment_velocity(law, overlap, memory, p):  # type: ignore[no-untyped-def]
    """Overlap velocity [m/s] above which the force is positive at this overlap [m]."""
    if law == TSUJI:
        return tsuji.detachment_velocity(overlap, memory, p)
    if law == LINEAR:
        return linear.detachment_velocity(overlap, memory, p)
    if law == HERTZ:
        return hertz.detachment_velocity(overlap, memory, p)
    if law == LEE_HERRMANN:
        return lee_herrmann.detachment_velocity(overlap, memory, p)
    if law == KUWABARA_KONO:
        return kuwabara_kono.detachment_velocity(overlap, memory, p)
    if law == WALTON_BRAUN:
        return walton_braun.detachment_velocity(overlap, memory, p)
    return impact.detachment_velocity(overlap, memory, p)


@kernel
def residual_overlap(law, memory, p):  # type: ignore[no-untyped-def]
    """Overlap [m] that remains when the force has vanished: the dent of a hysteretic law, else 0."""
    if law == WALTON_BRAUN:
        return walton_braun.residual_overlap(memory, p)
    return 0.0


@kernel
def energy(law, overlap, memory, p):  # type: ignore[no-untyped-def]
    """Elastic energy [J] stored at this overlap [m], which the contact returns in unloading."""
    if law == TSUJI:
        return tsuji.energy(overlap, memory, p)
    if law == LINEAR:
        return linear.energy(overlap, memory, p)
    if law == HERTZ:
        return hertz.energy(overlap, memory, p)
    if law == LEE_HERRMANN:
        return lee_herrmann.energy(overlap, memory, p)
    if law == KUWABARA_KONO:
        return kuwabara_kono.energy(overlap, memory, p)
    if law == WALTON_BRAUN:
        return walton_braun.energy(overlap, memory, p)
    return impact.energy(overlap, memory, p)


@kernel
def restitution(law, speed, mass, p):  # type: ignore[no-untyped-def]
    """Restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    if law == TSUJI:
        return tsuji.restitution(speed, mass, p)
    if law == LINEAR:
        return linear.restitution(speed, mass, p)
    if law == HERTZ:
        return hertz.restitution(speed, mass, p)
    if law == LEE_HERRMANN:
        return lee_herrmann.restitution(speed, mass, p)
    if law == KUWABARA_KONO:
        return kuwabara_kono.restitution(speed, mass, p)
    if law == WALTON_BRAUN:
        return walton_braun.restitution(speed, mass, p)
    return impact.restitution(speed, mass, p)
