# SPDX-License-Identifier: Apache-2.0
"""No selection: the height the scene gives. The bench uses it for scenes whose ceiling no controller moves."""

from __future__ import annotations

import math

from atpid_control.selection.protocol import Selection


class FixedSelector:
    """Always the same height."""

    method, simulates = "fixed", False

    def __init__(self, height: float) -> None:
        """Take the height [m]."""
        self._height = height

    def select(
        self,
        amplitude: float,
        amplitude_std: float = 0.0,
        frequency: float = math.nan,
        *,
        margin: float = 0.0,
        height: float = math.nan,
    ) -> Selection:
        """Return the height; see `HeightSelector.select`."""
        del amplitude, amplitude_std, frequency, margin, height
        return Selection(self._height, math.nan, math.nan, self.method)
