# SPDX-License-Identifier: Apache-2.0
"""The contract of a height selector, for its tests: the built-in methods keep it, and a selector of your own has to."""

from __future__ import annotations

import math
from collections.abc import Iterator

from atpid_control.selection.protocol import HeightSelector, Selection, SelectionError

_IMPOSSIBLE = (math.nan, math.inf, 0.0, -0.01)


def violations(selector: HeightSelector, amplitude: float, closed: float) -> list[str]:
    """Return in one sentence each what the selector does not keep to; empty: nothing.

    amplitude: a support amplitude it has to select for [m]; closed: lowest height of the ceiling, the grain's diameter
    [m].
    """
    return [*_of_the_selector(selector), *_of_a_selection(selector, amplitude, closed), *_of_refusals(selector)]


def _of_the_selector(selector: HeightSelector) -> Iterator[str]:
    if not (isinstance(selector.method, str) and selector.method):
        yield f"method: {selector.method!r} is not a name"
    if not isinstance(selector.simulates, bool):
        yield f"simulates: {selector.simulates!r} is not a bool"


def _of_a_selection(selector: HeightSelector, amplitude: float, closed: float) -> Iterator[str]:
    bare = selector.select(amplitude)
    if not isinstance(bare, Selection):
        yield f"select: returns {type(bare).__name__}, not a Selection"
        return
    if bare.method != selector.method:
        yield f"select: the selection's method is {bare.method!r}, the selector's {selector.method!r}"
    if not (math.isfinite(bare.height) and bare.height >= closed):
        yield f"select: height {bare.height:g} m is not at least that of the closed damper, {closed:g} m"
    if bare.beam_amplitude <= 0.0 or bare.efficiency > 1.0:
        yield f"select: amplitude {bare.beam_amplitude:g} m and efficiency {bare.efficiency:g} cannot be; NaN: unknown"
    safe = selector.select(amplitude, 0.02 * amplitude, margin=2.0)
    if safe.height > bare.height * (1.0 + 1e-9):
        yield f"select: with a margin the height is {safe.height:g} m, above {bare.height:g} m without"


def _of_refusals(selector: HeightSelector) -> Iterator[str]:
    for given in _IMPOSSIBLE:
        try:
            chosen = selector.select(given)
        except SelectionError as error:
            if "\n" in str(error) or not str(error):
                yield f"select: the refusal of amplitude {given:g} m is not one line"
        else:
            yield f"select: amplitude {given:g} m gives {chosen.height:g} m; needed: SelectionError"
