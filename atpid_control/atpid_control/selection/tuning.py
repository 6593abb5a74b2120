# SPDX-License-Identifier: Apache-2.0
"""Precise tuning of the PCA's height (thesis section 4.4, Fig. 4.33): down and up in ever smaller steps."""

from __future__ import annotations

from collections.abc import Callable

#: First step, as a share of the height, and how much smaller each change of direction makes it.
_SHARE, _DIVISOR = 0.10, 1.5

#: The search ends when successive heights change the amplitude by less than this share.
_DONE = 0.01

#: And no later than this many heights, or turns (the step is then half a percent): the thesis needed 16 heights.
_MOST, _TURNS = 24, 12

Probe = Callable[[float], float]


def tune(probe: Probe, height: float, amplitude: float, lowest: float, highest: float) -> tuple[float, float]:
    """Return the best height [m] and its amplitude [m], starting from a height whose amplitude [m] is known.

    probe: height [m] to amplitude [m]. Down by a tenth until the amplitude grows, then up by a tenth / 1.5 until it
    grows, then by a tenth / (1.5 n), n one more at each turn, until successive heights differ by less than 1 % and
    neither is worse than the best by more.
    """
    best = last = (amplitude, height)
    direction, turns = -1.0, 0
    for _ in range(_MOST):
        share = _SHARE / (_DIVISOR * turns) if turns else _SHARE
        here = min(max(last[1] * (1.0 + direction * share), lowest), highest)
        if here == last[1]:
            direction, turns = -direction, turns + 1
            continue
        value = probe(here)
        best = min(best, (value, here))
        small = abs(value - last[0]) < _DONE * last[0] and value <= (1.0 + _DONE) * best[0]
        if turns > _TURNS or (turns >= 2 and small):
            break
        if value > last[0]:
            direction, turns = -direction, turns + 1
        last = (value, here)
    return best[1], best[0]
