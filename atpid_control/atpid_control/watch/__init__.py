# SPDX-License-Identifier: Apache-2.0
"""Does the beam do what it should: rumble in the measured response, and drift against the prediction."""

from atpid_control.watch.drift import DriftAlarm, DriftSettings, DriftState
from atpid_control.watch.rumble import RumbleSettings, RumbleState, RumbleWatch
from atpid_control.watch.settings_error import WatchError
from atpid_control.watch.twin import SteadyTwin

__all__ = [
    "DriftAlarm",
    "DriftSettings",
    "DriftState",
    "RumbleSettings",
    "RumbleState",
    "RumbleWatch",
    "SteadyTwin",
    "WatchError",
]
