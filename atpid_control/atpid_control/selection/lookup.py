# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Heights not computed here: of a map made before (thesis section 4.2, first kind of control), or the scene's own."""

import math
import time

from atpid_control.selection.protocol import Excitation, Selection, SelectionError
from atpid_sim.maps import HeightMap, MapError
from atpid_sim.maps.response import LEAST_USE
from atpid_sim.scene import Scene


class FixedSelector:
    """Always the height the scene gives: for scenes whose ceiling no controller moves."""

    method, simulates = "fixed", False

    def __init__(self, height: float) -> None:
        """Take the height [m]."""
        self._height = height

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the height; see `HeightSelector.select`."""
        del excitation, margin, height
        return Selection(self._height, math.nan, math.nan, self.method)


class LookupSelector:
    """Reads heights off a map; for a margin it takes the lowest height over the amplitude's error bar."""

    method, simulates = "lookup", False

    def __init__(self, scene: Scene, height_map: HeightMap) -> None:
        """Raise MapError where the map was made for another system."""
        height_map.check(scene)
        self._map = height_map
        self._mass_fraction, self._natural = scene.grain.mass_fraction, scene.natural_frequency_hz
        self._frequency, self._unit = scene.frequency_hz, scene.driven_by.unit
        ratios = height_map.frequency_ratios
        #: Lowest and highest frequency of a map over several [Hz]; None: it holds for one.
        self.frequencies = None if ratios is None else (self._natural * ratios[0], self._natural * ratios[-1])

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the height of the map; see `HeightSelector.select`."""
        del height  # a map holds for any ceiling before; one for a single frequency is guarded by the hold
        begun = time.perf_counter()
        amplitude, frequency, spread = excitation.amplitude, excitation.frequency, excitation.spread(margin)
        ratio = (self._frequency if math.isnan(frequency) else frequency) / self._natural
        try:
            best = self._map.lookup(amplitude, self._mass_fraction, ratio)
            # the best height grows with the amplitude: that of the error bar's lower end is safe for all of it
            lower = max(amplitude - spread, float(self._map.amplitudes[0]))
            safe = self._map.lookup(lower, self._mass_fraction, ratio) if margin > 0.0 else best
        except MapError as error:
            raise SelectionError(str(error)) from None
        # the map holds the best height only, not the amplitude at another height
        price = math.nan if margin > 0.0 else 0.0
        wall = time.perf_counter() - begun
        no_use = "" if safe.efficiency >= LEAST_USE else self._of_no_use(amplitude, ratio)
        return Selection(
            safe.height, safe.amplitude, safe.efficiency, self.method, wall_s=wall, price=price, no_use=no_use
        )

    def _of_no_use(self, amplitude: float, ratio: float) -> str:
        where = f"{amplitude:.4g} {self._unit} and {ratio * self._natural:.4g} Hz"
        return f"the damper is of no use at {where}: no height of the map takes {100.0 * LEAST_USE:g} % off the beam"
