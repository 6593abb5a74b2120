# SPDX-License-Identifier: Apache-2.0
"""The controller of a scene whose ceiling nothing selects: it sends the heights the scene prescribes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from atpid_control.identification import Estimate
from atpid_control.loop.protocol import Answer, Command, ControlSettings


class ProfileController:
    """Sends the heights a scene prescribes, for scenes whose ceiling no controller moves."""

    def on_event(self, kind: str) -> None:
        """Nothing moves this ceiling but the scene."""

    def configure(self, settings: ControlSettings) -> None:
        """Nothing moves this ceiling but the scene."""

    def __init__(self, heights: tuple[tuple[float, float], ...]) -> None:
        """Take the points (t [s], h [m]), straight in between."""
        self._times, self._heights = zip(*heights, strict=True)
        self._command = Command(method="fixed")

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """See `Controller.answer`."""
        del estimate, height
        target = float(np.interp(time, self._times, self._heights))
        if target != self._command.height:
            self._command = replace(
                self._command, sequence=self._command.sequence + 1, height=target, reason="prescribed by the scene"
            )
        return Answer(self._command)
