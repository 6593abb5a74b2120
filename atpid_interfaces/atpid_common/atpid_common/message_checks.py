# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a message must be like to be used at all, declared once for each type: finite rates, equal lengths, a time.

The limits of a quantity (a height, a speed) are not here: the node that acts on it has them. A message is looked at by
its fields alone, so that one decoded from a bag is checked as one that a node has received.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from atpid_common.vocabulary import ExciterKind, ExciterMode, Mode, Origin, Quality, RunState, Severity

if TYPE_CHECKING:
    from atpid_interfaces.msg import (
        CeilingState,
        Event,
        Excitation,
        ExcitationState,
        PlantTruth,
        RecorderStatus,
        SampleBlock,
        SupervisorState,
    )

#: Returns why a message cannot be used, in a few words; empty: it can.
Check = Callable[[Any], str]

_END_OF_TIME = 2**31 - 1  # last second a stamp can hold [s]
#: No displacement, energy or amplitude is larger, in SI units; sums and squares of such numbers stay finite.
_LARGEST = 1e100
#: Indices and rates [Hz] that have a place in time.
_LARGEST_INDEX = 2**62
_RATES = 1e-3, 1e7  # lowest, highest [Hz]


def check(message: object) -> str:
    """Return why a message of the project's own types cannot be used, in a few words; empty: it can."""
    return check_as(type(message).__name__, message)


def check_as(kind: str, message: Any) -> str:
    """Return why a message of type atpid_interfaces/msg/`kind` cannot be used, in a few words; empty: it can."""
    try:
        stamp = message.header.stamp
        if stamp.sec < 0 or stamp.nanosec >= 1_000_000_000:
            return f"its stamp is {stamp.sec} s {stamp.nanosec} ns, which is no time since 1970"
        return "" if getattr(message, "handshake", False) else CHECKS[kind](message)
    except (AttributeError, TypeError):  # of a bag with another definition of the type
        return "its definition lacks a field, or has one of another kind"


def time_out_of_range(last_index: int, rate: float) -> str:
    """Return why scans up to `last_index` at `rate` [Hz] have no place in time, in a few words; empty: they have."""
    if not _RATES[0] <= rate <= _RATES[1]:
        return f"its rate is {rate} Hz; {_RATES[0]:g} to {_RATES[1]:g}"
    return "" if last_index <= _LARGEST_INDEX else f"its last index is {last_index}; at most 2^62"


def _series(message: SampleBlock | PlantTruth, scans: int) -> str:
    """Return why the scans of a message cannot be placed in time; empty: they can."""
    if reason := time_out_of_range(message.first_index + scans, message.rate):
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
    too_large = np.abs(np.asarray(block.data, dtype=np.float64)) > _LARGEST  # NaN is not
    if too_large.any() or not np.isfinite(block.skew).all():
        return f"a value is above {_LARGEST:g}, or a delay is infinite"
    return _series(block, values // channels)


def _truth(truth: PlantTruth) -> str:
    lengths = {len(values) for values in (truth.support, truth.beam, truth.grain, truth.ceiling)}
    if len(lengths) > 1:
        return f"its series have {' and '.join(map(str, sorted(lengths)))} values"
    energies = (truth.input_energy, truth.beam_loss, truth.contact_loss, truth.ceiling_work, truth.stored_energy)
    # the plant computes all of them: NaN compares as false, too
    series = (energies, truth.support, truth.beam, truth.grain, truth.ceiling)
    if not all((np.abs(values) <= _LARGEST).all() for values in series):
        return f"a value is no number, or above {_LARGEST:g}"
    return _series(truth, lengths.pop())


def _excitation(excitation: Excitation) -> str:
    if excitation.quality > max(Quality) or excitation.origin > max(Origin):
        return f"its quality is {excitation.quality} and its origin {excitation.origin}; see Excitation.msg"
    values = {name: getattr(excitation, name) for name in ("amplitude", "amplitude_std", "frequency", "frequency_std")}
    wrong = [f"{name} {value}" for name, value in values.items() if value < 0.0 or value > _LARGEST]
    if not wrong and excitation.quality == Quality.STEADY:
        wrong = [f"{name} {values[name]}" for name in ("amplitude", "frequency") if math.isnan(values[name])]
    return f"its {wrong[0]} cannot be" if wrong else ""


def _state(state: CeilingState) -> str:
    if state.mode > max(Mode):
        return f"its mode is {state.mode}; see CeilingState.msg"
    return f"its height is {state.height}" if abs(state.height) > _LARGEST else ""


def _exciter(state: ExcitationState) -> str:
    if state.mode > max(ExciterMode) or state.kind > max(ExciterKind):
        return f"its mode is {state.mode} and its kind {state.kind}; see ExcitationState.msg"
    for name in ("amplitude", "frequency"):
        if not 0.0 <= getattr(state, name) <= _LARGEST:
            return f"its {name} is {getattr(state, name)}"
    return ""


def _event(event: Event) -> str:
    return "" if event.severity <= max(Severity) else f"its severity is {event.severity}; see Event.msg"


def _recorder(status: RecorderStatus) -> str:
    lengths = len(status.topics), len(status.received), len(status.written)
    return "" if len(set(lengths)) == 1 else f"{lengths[0]} topics, {lengths[1]} and {lengths[2]} counts"


def _supervisor(message: SupervisorState) -> str:
    if message.state > max(RunState):
        return f"its state is {message.state}; see SupervisorState.msg"
    if message.permit and message.stop:
        return "it permits motion and stops it"
    if len(message.nodes) != len(message.silence):
        return f"{len(message.nodes)} nodes and {len(message.silence)} times"
    return ""


CHECKS: Mapping[str, Check] = {
    "SampleBlock": _block,
    "PlantTruth": _truth,
    "Excitation": _excitation,
    # whatever its height is: the motor's node refuses what is outside its limits, with an event
    "CeilingCommand": lambda _command: "",
    "CeilingState": _state,
    # whatever its values are: the excitation node refuses what is outside its limits, with an event
    "ExcitationCommand": lambda _command: "",
    "ExcitationState": _exciter,
    "Event": _event,
    "RecorderStatus": _recorder,
    "SupervisorState": _supervisor,
}
