# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exciter of the emulated stand: the voltage of a stand-in device becomes the state that the plant follows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from atpid_interfaces.msg import ExcitationState
from rclpy.node import Node
from std_msgs.msg import Header

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import STATES, STEADY
from atpid_common.nodes.parameters import Entry
from atpid_common.vocabulary import Frame
from atpid_driver.calibration.convert import si_of
from atpid_driver.calibration.model import load
from atpid_driver.standins.outputs import Outputs

PARAMETERS = (
    Entry("output", "", "file of the outputs of the device that excites; empty: none does"),
    Entry("output_calibration", "", "calibration file of that output, drive_amplitude or drive_frequency"),
    Entry("disc", 0.0, "amplitude of an eccentric drive's disc, whose frequency the output is", "", 0.0, 1e6),
)
#: Between two states; what is looked at for each [s].
PERIOD, WINDOW = 0.05, 0.06
#: A tone below this share of the range is none.
_NOISE = 1e-4


class EmulatedExciter:
    """Publishes emulated/excitation/state: what DAC0, of a shaker over DAC1, really does, whatever the node says."""

    def __init__(self, node: Node, values: Mapping[str, Any], topic: str) -> None:
        """Open the output. Raises CalibrationError for an invalid calibration file."""
        self._node, self._disc = node, float(values["disc"])
        self._calibration = load(Path(values["output_calibration"]))
        self._outputs = Outputs(Path(values["output"]))
        self._frequency = 0.0  # of the node's last state [Hz]: the voltage's amplitude is fitted at it
        self._states = node.create_publisher(ExcitationState, topic, STATES)
        subscribe(node, ExcitationState, "excitation/state", self._on_state, STATES)
        node.create_timer(PERIOD, self._publish, clock=STEADY)

    def _on_state(self, state: ExcitationState) -> None:
        self._frequency = state.frequency or self._frequency

    def _publish(self) -> None:
        amplitude, frequency, volts = self._level() if self._disc else self._tone()
        running = ExcitationState.RUNNING if amplitude else ExcitationState.OFF
        header = Header(stamp=self._node.get_clock().now().to_msg(), frame_id=Frame.SUPPORT)
        self._states.publish(ExcitationState(
            header=header, mode=running, amplitude=amplitude, frequency=frequency, output=volts))  # fmt: skip

    def _level(self) -> tuple[float, float, float]:
        volts = self._outputs.volts(0)
        frequency = float(si_of(self._calibration, np.array([volts]))[0][0])
        return (self._disc, frequency, volts) if volts > 0.0 and frequency > 0.0 else (0.0, 0.0, volts)

    def _tone(self) -> tuple[float, float, float]:
        times, volts = self._outputs.recent(WINDOW)
        low, high = self._calibration.limits_volts
        peak = float(np.abs(volts).max())
        if peak < _NOISE * (high - low) or not self._frequency:
            return 0.0, 0.0, peak
        angle = 2.0 * np.pi * self._frequency * times
        parts = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle)], axis=1), volts, rcond=None)[0]
        return float(np.hypot(*parts) * self._calibration.coefficients[1]), self._frequency, peak
