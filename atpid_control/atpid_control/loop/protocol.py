# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a controller of the ceiling takes and gives: its settings, and the answer to an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from atpid_common.vocabulary import Severity
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import HoldSettings
from atpid_control.loop.step_back import StepBack


@dataclass(frozen=True)
class HeightCommand:
    """The contents of a CeilingCommand, without its header."""

    sequence: int = 0
    height: float = math.nan
    excitation_amplitude: float = math.nan
    predicted_amplitude: float = math.nan
    method: str = ""
    reason: str = "no estimate yet"


@dataclass(frozen=True)
class LoopAnswer:
    """The command that answers one estimate and, where there is an event, its kind, text and quantity."""

    command: HeightCommand
    kind: str = ""  # refused, no_use, slow, step_back, drift or fallback; empty: no event
    text: str = ""
    value: float = math.nan
    severity: int = Severity.WARNING


@dataclass(frozen=True)
class ControlSettings:
    """Settings that may change while the loop runs."""

    hold: HoldSettings
    step_back: StepBack
    drift: DriftSettings
    margin: float  # standard deviations of the amplitude the height must be safe for [-]
    fallback_count: int = 20  # estimates in a row without a height of the method, before the look-up answers
