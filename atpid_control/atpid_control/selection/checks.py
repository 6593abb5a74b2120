# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks of a request and of the height, and selection at any frequency from half to twice the natural one.

Off resonance a thrown grain takes less and less off the beam: well below resonance the beam's acceleration does not
lift it, above it the open damper brings the beam without its grain into resonance (docs/selection.md). Where the damper
is of no use it stays closed.
"""

import math
from dataclasses import dataclass, replace

from atpid_control.identification import Estimate
from atpid_control.selection.protocol import Excitation, HeightSelector, Selection, SelectionError
from atpid_sim.maps import DamperResponse
from atpid_sim.maps.response import HIGHEST_RATIO, LEAST_USE, LOWEST_RATIO
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError

#: A measured frequency this close to the scene's is the scene's: resonance is 2 % wide [relative].
_SAME = 1e-3
#: A height this close to the end of the range, in clearances, was stopped there: of heights equally good the lowest
#: is taken.
_AT_THE_END = 0.02


def response_at(damper: DamperResponse, scene: Scene, frequency: float, rtol: float) -> DamperResponse:
    """Return the damper's response, or that of the same system at another frequency [Hz]; NaN: the scene's own."""
    if math.isnan(frequency) or abs(frequency / damper.frequency - 1.0) < _SAME:
        return damper
    if not scene.excitation.is_tone:
        raise SelectionError("frequency: heights are selected for a tone; the scene's excitation has no amplitude")
    try:
        return DamperResponse(scene.with_(frequency=frequency), rtol)
    except SceneError as error:
        raise SelectionError(str(error)) from None


def range_warnings(scene: Scene, chosen: Selection) -> list[str]:
    """Return what the range of a controlled ceiling does to a selected height: a line, or nothing."""
    if not scene.ceiling.controlled:
        return []
    low, high = scene.ceiling.range
    height, allowed = f"height: {chosen.height:.4f} m", f"ceiling.range ({low:g} to {high:g} m)"
    nearest = min(max(chosen.height, low), high)
    if nearest != chosen.height:
        return [f"{height} is beyond {allowed}; the loop would send the ceiling to {nearest:g} m"]
    stopped = high - chosen.height <= _AT_THE_END * (high - 2.0 * scene.grain.radius)
    if chosen.method in ("direct", "pca") and stopped:
        where = f"in which `{chosen.method}` selects"
        return [f"{height} lies at the end of {allowed}, {where}; a greater height may do better"]
    return []


#: Most standard deviations of a margin [-].
_MOST_MARGIN = 100.0


@dataclass(frozen=True)
class HeightRequest:
    """An excitation, and the margin the height must have."""

    amplitude: float  # [m, of a force N]; 0: that of the latest steady estimate, with its error bar and frequency
    amplitude_std: float = 0.0  # likewise
    frequency: float = 0.0  # [Hz]; 0: that of the scene, resonance of the closed damper where it gives none
    margin: float = 0.0  # standard deviations [-]


@dataclass(frozen=True)
class Resonance:
    """The frequencies heights are valid for."""

    frequency: float  # of the scene [Hz]
    tolerance: float  # relative, of a method that selects at that frequency alone [-]
    reach: tuple[float, float] | None = None  # of a method that selects at others, too [Hz]

    @property
    def allowed(self) -> str:
        """The frequencies in words."""
        if self.reach is not None:
            return f"{self.reach[0]:.4g} to {self.reach[1]:.4g} Hz, or 0 for {self.frequency:.4g} Hz"
        return f"{self.frequency:.4g} Hz within {100.0 * self.tolerance:g} %, or 0 for that resonance"

    def holds(self, frequency: float) -> bool:
        """Whether heights are valid for a frequency [Hz]."""
        if self.reach is not None:
            return self.reach[0] <= frequency <= self.reach[1] or frequency == self.frequency
        return abs(frequency / self.frequency - 1.0) <= self.tolerance


def resolved(request: HeightRequest, latest: Estimate | None, resonance: Resonance) -> HeightRequest:
    """Return the request with amplitude and frequency filled in.

    latest: the latest steady estimate of the excitation; None: there is none yet. Raises SelectionError, which states
    what was given and what is allowed.
    """
    _check("amplitude", request.amplitude, "", "above 0, or 0 for the latest steady estimate")
    _check("amplitude_std", request.amplitude_std, "", "0 or above")
    _check("margin", request.margin, "", f"0 to {_MOST_MARGIN:g} standard deviations", _MOST_MARGIN)
    _check("frequency", request.frequency, " Hz", resonance.allowed)
    if request.amplitude == 0.0:
        if latest is None:
            raise SelectionError("amplitude: given 0 and no steady estimate yet; allowed: above 0")
        request = HeightRequest(latest.amplitude, latest.amplitude_std, latest.frequency, request.margin)
    frequency = request.frequency or resonance.frequency
    if not resonance.holds(frequency):
        raise SelectionError(f"frequency: given {frequency:g} Hz; allowed: {resonance.allowed}")
    return HeightRequest(request.amplitude, request.amplitude_std, frequency, request.margin)


def _check(name: str, given: float, unit: str, allowed: str, most: float = math.inf) -> None:
    """Raise SelectionError unless `given` is finite and from 0 to `most`."""
    if not (math.isfinite(given) and 0.0 <= given <= most):
        raise SelectionError(f"{name}: given {given:g}{unit}; allowed: {allowed}")


class AnyFrequency:
    """A method that simulates, at any frequency of its range."""

    def __init__(self, selector: HeightSelector, scene: Scene) -> None:
        self._selector, self._damper = selector, DamperResponse(scene)
        self._lowest, self._unit = scene.height_limits[0], scene.driven_by.unit
        self.method, self.simulates = selector.method, selector.simulates
        #: Lowest and highest frequency it selects for [Hz].
        self.frequencies = LOWEST_RATIO * scene.natural_frequency_hz, HIGHEST_RATIO * scene.natural_frequency_hz

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the best height, or that of the closed damper where it is of no use; see `HeightSelector.select`."""
        excitation.spread(margin)  # refuses a margin that is none
        amplitude, frequency = excitation.amplitude, excitation.frequency
        damper = self._damper
        if not math.isnan(frequency):
            self._check_frequency(frequency)
            damper = damper.at_frequency(frequency)
        try:
            resting = damper.rests(amplitude)
        except NumericalFailure as error:
            raise SelectionError(f"{self.method}: {error}") from error
        if resting:
            lifts = f"the closed beam's acceleration, {damper.closed_over_gravity(amplitude):.2f} g, does not lift it"
            return self._closed(damper, amplitude, Selection(math.nan, math.nan, math.nan, self.method), lifts)
        chosen = self._selector.select(excitation, margin, height)
        if not chosen.efficiency < LEAST_USE:
            return chosen
        found = f"the best height found, {chosen.height:.4f} m, takes {100.0 * chosen.efficiency:.1f} % off the beam"
        return self._closed(damper, amplitude, chosen, found)

    def _check_frequency(self, frequency: float) -> None:
        low, high = self.frequencies
        # that of a scene which is itself beyond them was asked for
        if not (low <= frequency <= high or frequency == self._damper.frequency):
            allowed = f"{low:.4g} to {high:.4g} Hz, half to twice the natural frequency"
            raise SelectionError(f"frequency: given {frequency:g} Hz; allowed: {allowed}")

    def _closed(self, damper: DamperResponse, amplitude: float, chosen: Selection, why: str) -> Selection:
        """Return the selection of the ceiling's lowest height, with the reason."""
        shut = self._lowest <= damper.diameter * (1.0 + 1e-9)
        kept = "it stays closed" if shut else f"the ceiling stays at its lowest, {self._lowest:g} m"
        where = f"the damper is of no use at {amplitude:.4g} {self._unit} and {damper.frequency:.4g} Hz"
        beam = damper.closed_amplitude(amplitude) if shut or damper.rests(amplitude) else math.nan
        efficiency = 0.0 if math.isfinite(beam) else math.nan
        no_use = f"{where}: {why}; {kept}"
        return replace(
            chosen, height=self._lowest, beam_amplitude=beam, efficiency=efficiency, price=0.0, no_use=no_use
        )
