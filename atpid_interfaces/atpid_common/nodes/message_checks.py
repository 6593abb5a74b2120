# SPDX-License-Identifier: Apache-2.0
"""What a message must be like to be used at all, declared once for each type: finite rates, equal lengths, a time.

The limits of a quantity (a height, a speed) are not here: the node that acts on it has them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    Excitation,
    PlantTruth,
    RecorderStatus,
    SampleBlock,
)
from builtin_interfaces.msg import Time

from atpid_common.scans import misplaced

#: Returns why a message cannot be used, in a few words; empty: it can.
Check = Callable[[Any], str]

_END_OF_TIME = 2**31 - 1  # last second a stamp can hold [s]


def check(message: Any) -> str:
    """Return why a message of the project's own types cannot be used, in a few words; empty: it can."""
    reason = _stamp(message.header.stamp)
    if reason or getattr(message, "handshake", False):
        return reason
    return CHECKS[type(message)](message)


def _stamp(stamp: Time) -> str:
    if stamp.sec < 0 or stamp.nanosec >= 1_000_000_000:
        return f"its stamp is {stamp.sec} s {stamp.nanosec} ns, which is no time since 1970"
    return ""


def _series(message: SampleBlock | PlantTruth, scans: int) -> str:
    """Return why the scans of a message cannot be placed in time; empty: they can."""
    if reason := misplaced(message.first_index + scans, message.rate):
        return reason
    if not scans:
        return "it has no samples"
    return "" if message.header.stamp.sec + scans / message.rate < _END_OF_TIME else "it ends after 2038"


def _block(block: SampleBlock) -> str:
    channels, values = len(block.channels), len(block.data)
    if channels == 0 or len(set(block.channels)) < channels:
        return "its channels have no names, or one twice"
    if values % channels:
        return f"{values} values for {channels} channels"
    if len(block.units) not in (0, channels) or len(block.skew) not in (0, channels):
        return f"{len(block.units)} units and {len(block.skew)} delays for {channels} channels"
    if np.isinf(np.frombuffer(block.data, dtype=np.float64)).any() or not np.isfinite(block.skew).all():
        return "a value or a delay is infinite"
    return _series(block, values // channels)


def _truth(truth: PlantTruth) -> str:
    lengths = {len(values) for values in (truth.support, truth.beam, truth.grain, truth.ceiling)}
    if len(lengths) > 1:
        return f"its series have {' and '.join(map(str, sorted(lengths)))} values"
    return _series(truth, lengths.pop())


def _excitation(excitation: Excitation) -> str:
    if excitation.quality > Excitation.POOR or excitation.origin > Excitation.BEAM:
        return f"its quality is {excitation.quality} and its origin {excitation.origin}; see Excitation.msg"
    values = {name: getattr(excitation, name) for name in ("amplitude", "amplitude_std", "frequency", "frequency_std")}
    wrong = [f"{name} {value}" for name, value in values.items() if value < 0.0 or math.isinf(value)]
    if not wrong and excitation.quality == Excitation.STEADY:
        wrong = [f"{name} {values[name]}" for name in ("amplitude", "frequency") if math.isnan(values[name])]
    return f"its {wrong[0]} cannot be" if wrong else ""


def _state(state: CeilingState) -> str:
    if state.mode > CeilingState.FAULT:
        return f"its mode is {state.mode}; see CeilingState.msg"
    return "its height is infinite" if math.isinf(state.height) else ""


def _event(event: Event) -> str:
    return "" if event.severity <= Event.ALARM else f"its severity is {event.severity}; see Event.msg"


def _recorder(status: RecorderStatus) -> str:
    lengths = len(status.topics), len(status.received), len(status.written)
    return "" if len(set(lengths)) == 1 else f"{lengths[0]} topics, {lengths[1]} and {lengths[2]} counts"


def _command(_command: CeilingCommand) -> str:
    return ""  # whatever its height is: the motor's node refuses what is outside its limits, with an event


CHECKS: Mapping[type, Check] = {
    SampleBlock: _block,
    PlantTruth: _truth,
    Excitation: _excitation,
    CeilingCommand: _command,
    CeilingState: _state,
    Event: _event,
    RecorderStatus: _recorder,
}
