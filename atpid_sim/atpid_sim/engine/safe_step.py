# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How far the motion may be advanced without passing a surface: lower bounds from a bounded third derivative."""

import math

from atpid_sim.kernel import kernel


@kernel
def _cubic(gap, velocity, acceleration, jerk, s):
    return gap + s * (velocity + s * (0.5 * acceleration - s * jerk * (1.0 / 6.0)))


@kernel
def safe_step(gap, velocity, acceleration, jerk, longest):
    """Largest step s <= longest [s] with gap + velocity s + acceleration s^2/2 - jerk s^3/6 surely not negative.

    `jerk` >= 0 bounds the third derivative of the gap, so no root of the gap itself lies before the step returned:
    the impact is approached from below, never passed. Newton's steps from the left keep that property where the
    cubic is convex; elsewhere the root is bracketed and the left end returned.
    """
    if gap <= 0.0:
        if velocity < 0.0 or (velocity == 0.0 and acceleration <= 0.0):
            return 0.0
        gap = 0.0
    left = 0.0
    if jerk <= 0.0:
        jerk = 1e-300
    if velocity < 0.0:
        close = _nearly(gap, velocity, acceleration, jerk)
        if close > 0.0:
            return min(close, longest)
    discriminant = acceleration * acceleration + 2.0 * jerk * velocity
    if velocity >= 0.0:
        left = max(0.0, (acceleration + math.sqrt(discriminant)) / jerk)
    elif discriminant >= 0.0:
        root = math.sqrt(discriminant)
        # lowest point of the cubic, in the form that does not cancel
        lowest = -2.0 * velocity / (acceleration + root) if acceleration > 0.0 else -1.0
        if lowest > 0.0:
            if _cubic(gap, velocity, acceleration, jerk, lowest) <= 0.0:
                return _newton(gap, velocity, acceleration, jerk, longest)
            left = (acceleration + root) / jerk
    if left >= longest:
        return longest
    return _bracketed(gap, velocity, acceleration, jerk, left, longest)


@kernel
def _nearly(gap, velocity, acceleration, jerk):
    """Root of the parabola that bounds the cubic from below, where that is within a tenth of the best; else 0.

    The parabola without jerk gives an upper bound S of the root; below S the cubic term is at least -jerk S s^2 / 6.
    """
    squared = velocity * velocity - 2.0 * acceleration * gap
    if squared < 0.0:
        return 0.0
    upper = 2.0 * gap / (math.sqrt(squared) - velocity)
    squared = velocity * velocity - 2.0 * (acceleration - jerk * upper * (1.0 / 3.0)) * gap
    lower = 2.0 * gap / (math.sqrt(squared) - velocity)
    return lower if lower >= 0.9 * upper else 0.0


@kernel
def _newton(gap, velocity, acceleration, jerk, longest):
    """Root of the convex, falling part, approached from the left."""
    s = 0.0
    for _ in range(6):
        value = _cubic(gap, velocity, acceleration, jerk, s)
        slope = velocity + s * (acceleration - 0.5 * jerk * s)
        if slope >= 0.0:
            break
        step = -value / slope
        s += step
        if s >= longest:
            return longest
        if step <= 1e-3 * s:
            break
    return s


@kernel
def _bracketed(gap, velocity, acceleration, jerk, left, longest):
    """Left end of a bracket around the root beyond `left`, where the cubic only falls."""
    if _cubic(gap, velocity, acceleration, jerk, longest) >= 0.0:
        return longest
    right = longest
    f_left = _cubic(gap, velocity, acceleration, jerk, left)
    f_right = _cubic(gap, velocity, acceleration, jerk, right)
    for _ in range(40):
        if right - left <= 1e-3 * right:
            break
        middle = right - f_right * (right - left) / (f_right - f_left)
        # keep the guess off the ends, and halve when the chord makes poor progress
        low = left + 0.05 * (right - left)
        high = right - 0.05 * (right - left)
        middle = min(max(middle, low), high)
        value = _cubic(gap, velocity, acceleration, jerk, middle)
        if value >= 0.0:
            left, f_left = middle, value
        else:
            right, f_right = middle, value
    return left


@kernel
def safe_velocity_step(margin, acceleration, jerk, longest):
    """Largest step for which a velocity that is `margin` [m/s] below its limit surely stays below it [s]."""
    if margin <= 0.0:
        return 0.0
    if jerk <= 0.0:
        return longest if acceleration <= 0.0 else min(longest, margin / acceleration)
    root = math.sqrt(acceleration * acceleration + 2.0 * jerk * margin)
    step = 2.0 * margin / (acceleration + root) if acceleration > 0.0 else (root - acceleration) / jerk
    return min(step, longest)
