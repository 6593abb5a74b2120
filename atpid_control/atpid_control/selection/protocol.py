# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The role of a height selector, from an excitation to the best ceiling height, and its contract for tests."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from atpid_common.errors import InputError


class SelectionError(InputError):
    """No height can be selected for this excitation; the ceiling should stay where it is."""


@dataclass(frozen=True)
class Excitation:
    """The drive's tone as it was identified. Raises SelectionError, in one line, for numbers without a height."""

    amplitude: float  # [m, of a force N]
    amplitude_std: float = 0.0  # its standard deviation, likewise
    frequency: float = math.nan  # [Hz], NaN: that of the scene

    def __post_init__(self) -> None:
        stays, amplitude, std = "the ceiling stays", self.amplitude, self.amplitude_std
        if not (math.isfinite(amplitude) and amplitude > 0.0):
            raise SelectionError(f"amplitude: given {amplitude:g}; allowed is a number above 0; {stays}")
        if not (math.isfinite(std) and std >= 0.0):
            raise SelectionError(f"amplitude_std: given {std:g}; allowed is a number from 0; {stays}")
        if not (math.isnan(self.frequency) or 0.0 < self.frequency < math.inf):
            allowed = "allowed is a number above 0, or NaN for the scene's"
            raise SelectionError(f"frequency: given {self.frequency:g} Hz; {allowed}")

    def spread(self, margin: float) -> float:
        """Return `margin` standard deviations of the amplitude [m]; raise SelectionError for a margin below 0."""
        if not (math.isfinite(margin) and margin >= 0.0):
            raise SelectionError(f"margin: given {margin:g}; allowed is a number of standard deviations from 0")
        return margin * self.amplitude_std


@dataclass(frozen=True)
class SelectionStage:
    """One step of a selection."""

    name: str  # as the thesis calls it: SM, PM1, CM1, ..., tuning 1, ...
    height: float  # [m], NaN: none yet
    amplitude: float  # of the beam there [m], NaN: not computed
    note: str  # the result of the step


@dataclass(frozen=True)
class Selection:
    """A height, and what is expected there."""

    height: float  # [m]
    beam_amplitude: float  # half peak-to-peak expected there [m], NaN: unknown
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-], NaN: unknown
    method: str
    evaluations: int = 0  # simulations it took
    wall_s: float = 0.0  # [s]
    price: float = 0.0  # efficiency given up for the margin [-], NaN: unknown
    stages: tuple[SelectionStage, ...] = ()  # every iteration, where the method has any
    structure_s: float = 0.0  # how long the ceiling was moved and the structure watched [s]
    no_use: str = ""  # why the damper is of no use here, one line; empty: it is of use
    note: str = ""  # what the selection holds for, and what it fell short of
    late: bool = False  # it took longer than the time it was given, or left its search unfinished for it
    box: Mapping[str, float] = field(default_factory=dict)  # how far each quantity may be off, of a margin; empty: none


def box_in_words(box: Mapping[str, float]) -> str:
    """Return how far each quantity of a margin's box may be off, relative but for the ceiling's position."""
    shares = [f"{name} ± {100.0 * value:g} %" for name, value in box.items() if name != "resolution"]
    return ", ".join([*shares, f"ceiling ± {1e3 * box['resolution']:g} mm"])


@dataclass(frozen=True)
class Options:
    """What some methods take beside the scene: the same names and defaults in commands, nodes and Python."""

    stiffness_uncertainty: float = 0.02  # relative error of the model's stiffness, in the margin of `direct` [-]
    deadline: float = math.inf  # time in which a selection of `direct` with a margin ends [s]
    gravity: bool = True  # of the models of `pca`


#: The options that a built-in method takes; one that is not named takes none.
TAKES: Mapping[str, tuple[str, ...]] = {"direct": ("stiffness_uncertainty", "deadline"), "pca": ("gravity",)}


class HeightSelector(Protocol):
    """One method of selection.

    Who adds one implements `method`, `simulates` and `select`, and names a function `(scene, height map or None) ->
    selector` in the entry-point group `atpid.selectors`; `violations` is its contract test.

    A method that selects at other frequencies than the scene's has `frequencies`, the lowest and the highest of them
    [Hz]; one without is asked for heights at the scene's alone (`frequency_tolerance` of selector.yaml).
    """

    @property
    def method(self) -> str:
        """Name in the registry, or of the entry point."""

    @property
    def simulates(self) -> bool:
        """Whether a selection is computed by simulation, which takes longer than the loop can wait."""

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the best height for an excitation.

        margin: standard deviations of the amplitude the height must be safe for [-]; height: where the ceiling is [m],
        NaN: unknown. Raises SelectionError, in one line, where no height can be given.
        """


def reach_of(selector: HeightSelector) -> tuple[float, float] | None:
    """Return the frequencies a method selects at [Hz]; None: at its scene's alone."""
    reach: tuple[float, float] | None = getattr(selector, "frequencies", None)
    return reach


def violations(selector: HeightSelector, amplitude: float, closed: float) -> list[str]:
    """Return in one sentence each what the selector does not keep to; empty: nothing.

    amplitude: a support amplitude it has to select for [m]; closed: lowest height of the ceiling, the grain's diameter
    [m].
    """
    found = []
    if not (isinstance(selector.method, str) and selector.method):
        found.append(f"method: {selector.method!r} is not a name")
    if not isinstance(selector.simulates, bool):
        found.append(f"simulates: {selector.simulates!r} is not a bool")
    return [*found, *_of_a_selection(selector, amplitude, closed)]


def _of_a_selection(selector: HeightSelector, amplitude: float, closed: float) -> Iterator[str]:
    bare = selector.select(Excitation(amplitude))
    if not isinstance(bare, Selection):
        yield f"select: returns {type(bare).__name__}, not a Selection"
        return
    if bare.method != selector.method:
        yield f"select: the selection's method is {bare.method!r}, the selector's {selector.method!r}"
    if not (math.isfinite(bare.height) and bare.height >= closed):
        yield f"select: height {bare.height:g} m is not at least that of the closed damper, {closed:g} m"
    if bare.beam_amplitude <= 0.0 or bare.efficiency > 1.0:
        yield f"select: amplitude {bare.beam_amplitude:g} m and efficiency {bare.efficiency:g} cannot be; NaN: unknown"
    safe = selector.select(Excitation(amplitude, 0.02 * amplitude), margin=2.0)
    if safe.height > bare.height * (1.0 + 1e-9):
        yield f"select: with a margin the height is {safe.height:g} m, above {bare.height:g} m without"
