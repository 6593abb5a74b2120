# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Interpolation between the ends of a step, from displacements, velocities and accelerations."""

from atpid_sim.kernel import kernel


@kernel
def hermite(s, h, x0, v0, a0, x1, v1, a1):
    """Quintic through position, velocity and acceleration at both ends of a step h, at the fraction s in [0, 1]."""
    p0, q0 = h * v0, 0.5 * h * h * a0
    p1, q1 = h * v1, 0.5 * h * h * a1
    d = x1 - x0
    c3 = 10.0 * d - 6.0 * p0 - 4.0 * p1 - 3.0 * q0 + q1
    c4 = -15.0 * d + 8.0 * p0 + 7.0 * p1 + 3.0 * q0 - 2.0 * q1
    c5 = 6.0 * d - 3.0 * (p0 + p1) - q0 + q1
    return x0 + s * (p0 + s * (q0 + s * (c3 + s * (c4 + s * c5))))


@kernel
def hermite_velocity(s, h, x0, v0, a0, x1, v1, a1):
    """Velocity of the same quintic."""
    p0, q0 = h * v0, 0.5 * h * h * a0
    p1, q1 = h * v1, 0.5 * h * h * a1
    d = x1 - x0
    c3 = 10.0 * d - 6.0 * p0 - 4.0 * p1 - 3.0 * q0 + q1
    c4 = -15.0 * d + 8.0 * p0 + 7.0 * p1 + 3.0 * q0 - 2.0 * q1
    c5 = 6.0 * d - 3.0 * (p0 + p1) - q0 + q1
    return (p0 + s * (2.0 * q0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h


@kernel
def cubic(s, h, x0, v0, x1, v1):
    """Cubic through position and velocity at both ends of a step h, at the fraction s.

    For overlaps: their accelerations are small differences of large forces.
    """
    d = x1 - x0 - h * v0
    e = h * (v1 - v0) - 2.0 * d
    return x0 + s * (h * v0 + s * (d - e + s * e))


@kernel
def cubic_velocity(s, h, x0, v0, x1, v1):
    """Velocity of the same cubic."""
    d = x1 - x0 - h * v0
    e = h * (v1 - v0) - 2.0 * d
    return v0 + s * (2.0 * (d - e) + 3.0 * s * e) / h
