# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection from half to twice the natural frequency; where the damper is of no use it stays closed.

Off resonance a thrown grain takes less and less off the beam: well below resonance the beam's acceleration does not
lift it, above it the open damper brings the beam without its grain into resonance (docs/selection.md).
"""

import math
from dataclasses import replace

from atpid_control.selection.checks import frequencies_of
from atpid_control.selection.protocol import Excitation, HeightSelector, Selection, SelectionError
from atpid_sim.maps import DamperResponse
from atpid_sim.maps.response import LEAST_USE
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene


class AnyFrequency:
    """A method that simulates, at any frequency of its range."""

    def __init__(self, selector: HeightSelector, scene: Scene) -> None:
        """Take the method and the scene it selects for."""
        self._selector, self._damper = selector, DamperResponse(scene)
        self._lowest, self._unit = scene.height_limits[0], scene.driven_by.unit
        self.method, self.simulates = selector.method, selector.simulates
        #: Lowest and highest frequency it selects for [Hz].
        self.frequencies = frequencies_of(scene)

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
        return replace(
            chosen, height=self._lowest, beam_amplitude=beam, efficiency=efficiency, price=0.0,
            no_use=f"{where}: {why}; {kept}",
        )  # fmt: skip
