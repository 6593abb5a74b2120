# SPDX-License-Identifier: Apache-2.0
"""Hysteretic contact: linear loading and steeper linear unloading (Walton and Braun 1986).

F = min(k1 x, k2 (x - x0)), x0 = (1 - k1/k2) memory, memory the largest overlap of this contact so far. Parameters:
(k1 loading [N/m], k2 unloading [N/m]). What is lost is the area between the two lines, so the restitution is
sqrt(k1/k2) at every speed, and the grain detaches while still overlapped by x0.
"""

from __future__ import annotations

import math

from atpid_sim.kernel import kernel

DESCRIPTION = "linear loading, steeper linear unloading, Walton-Braun (hysteretic)"


@kernel
def _residual(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Overlap at which the force vanishes in unloading [m]."""
    return (1.0 - p[0] / p[1]) * max(memory, overlap, 0.0)


@kernel
def force(overlap, velocity, memory, p):  # type: ignore[no-untyped-def]
    """Contact force [N], not clamped."""
    return min(p[0] * overlap, p[1] * (overlap - _residual(overlap, memory, p)))


@kernel
def detachment_velocity(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Minus infinity above the overlap that remains, infinity below, at every velocity."""
    return -math.inf if overlap >= _residual(overlap, memory, p) else math.inf


@kernel
def residual_overlap(memory, p):  # type: ignore[no-untyped-def]
    """Overlap that remains when the force has vanished in unloading [m]: the dent."""
    return (1.0 - p[0] / p[1]) * max(memory, 0.0)


@kernel
def energy(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Elastic energy [J]: what unloading returns."""
    depth = max(0.0, overlap - _residual(overlap, memory, p))
    return 0.5 * p[1] * depth * depth


@kernel
def restitution(speed, mass, p):  # type: ignore[no-untyped-def]
    """Restitution [-], the same at every speed [m/s]."""
    return math.sqrt(p[0] / p[1])
