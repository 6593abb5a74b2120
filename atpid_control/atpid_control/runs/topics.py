# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which topics a recorder subscribes to, never "everything there is", and the few fields it reads of their messages.

The stamp is read in place (XCDR1, little-endian, alignment counted after the 4-byte encapsulation header):
stamp.sec int32 at 4, stamp.nanosec uint32 at 8. The other fields are decoded.
"""

import struct
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from mcap.records import Schema

from atpid_control.runs.decode import Decoded, Decoder, message_type
from atpid_control.runs.errors import BagError, MessageError

BLOCK, TRUTH = "atpid_interfaces/msg/SampleBlock", "atpid_interfaces/msg/PlantTruth"
EVENT, _DIAGNOSTICS = "atpid_interfaces/msg/Event", "diagnostic_msgs/msg/DiagnosticArray"
_LOG, TRANSITION = "rcl_interfaces/msg/Log", "lifecycle_msgs/msg/TransitionEvent"
_SUPERVISOR = "atpid_interfaces/msg/SupervisorState"
_EXCITED_BY, _EXCITER = "atpid_interfaces/msg/ExcitationCommand", "atpid_interfaces/msg/ExcitationState"
#: Types of what is paced and stamped by the machine's clock and not by the run: left out in lockstep.
_BY_CLOCK = (_DIAGNOSTICS, _LOG, TRANSITION, _SUPERVISOR)
#: Everything the graph publishes, in the order in which messages of one stamp are written.
DEFAULT = (
    f"sensors/laser {BLOCK}",
    f"sensors/accelerometer {BLOCK}",
    f"plant/truth {TRUTH}",
    "excitation atpid_interfaces/msg/Excitation",
    "ceiling/command atpid_interfaces/msg/CeilingCommand",
    "ceiling/state atpid_interfaces/msg/CeilingState",
    f"excitation/command {_EXCITED_BY}",
    f"excitation/state {_EXCITER}",
    f"events {EVENT} transient_local",
    f"/diagnostics {_DIAGNOSTICS}",
    f"/rosout {_LOG} transient_local",
    f"supervisor/state {_SUPERVISOR}",
    f"motor_node/transition_event {TRANSITION}",
    f"excitation_node/transition_event {TRANSITION}",
    f"labjack_node/transition_event {TRANSITION}",
    f"ni_node/transition_event {TRANSITION}",
)
_OPTIONS = ("best_effort", "transient_local")


@dataclass(frozen=True)
class Topic:
    """One topic to record."""

    name: str
    type: str
    best_effort: bool = False
    transient_local: bool = False

    @property
    def in_loop(self) -> bool:
        """Whether it carries every stamp of a run, unlike an operator's commands, events, diagnostics and the log."""
        beside = (EVENT, _SUPERVISOR, _EXCITED_BY, _EXCITER)
        return self.type.startswith("atpid_interfaces/") and self.type not in beside


def parse(entries: list[str] | tuple[str, ...], lockstep: bool) -> list[Topic]:
    """Return the topics of "name type [best_effort] [transient_local]" entries; raise BagError for one that is not.

    In lockstep diagnostics, log and lifecycle transitions are left out: two runs would not give the same bag.
    """
    topics: dict[str, Topic] = {}
    for entry in entries:
        name, kind, *options = entry.split() if len(entry.split()) > 1 else (entry, "")
        unknown = [option for option in options if option not in _OPTIONS]
        if not kind or unknown or name in topics:
            problem = "given twice" if name in topics else f"given {entry!r}"
            allowed = f"'name pkg/msg/Type', then {' or '.join(_OPTIONS)} where needed"
            raise BagError(f"parameter topics: {problem}; allowed: {allowed}")
        message_type(kind)
        if not (lockstep and kind in _BY_CLOCK):
            topics[name] = Topic(name, kind, "best_effort" in options, "transient_local" in options)
    return list(topics.values())


_STAMP = struct.Struct("<iI")
_LITTLE_ENDIAN = 1


class _Sent(NamedTuple):
    """What kind of Event it is, and the node that published it."""

    kind: str
    node: str


class BlockShape(NamedTuple):
    """Which scans a SampleBlock holds."""

    first_index: int
    rate: float  # [Hz]
    scans: int


def stamp(data: bytes) -> int:
    """Return the stamp [ns] of a message whose first field is a Header; raise MessageError for a big-endian one."""
    if data[1] & 1 != _LITTLE_ENDIAN:
        raise MessageError("it is big-endian; this recorder reads little-endian CDR only")
    seconds, nanoseconds = _STAMP.unpack_from(data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def block_shape(data: bytes) -> BlockShape:
    """Return which scans an atpid_interfaces/msg/SampleBlock holds; raise MessageError for an invalid one."""
    block = _decoded(BLOCK, data)
    values, channels = len(block.data), len(block.channels)
    if not channels or values % channels:
        raise MessageError(f"{values} values for {channels} channels")
    return BlockShape(block.first_index, block.rate, values // channels)


def shape_of(kind: str, data: bytes) -> BlockShape | None:
    """Return which scans a message of type `kind` holds, None: it is none of samples; raise MessageError: invalid."""
    if kind == BLOCK:
        return block_shape(data)
    truth = _decoded(TRUTH, data) if kind == TRUTH else None
    return truth and BlockShape(truth.first_index, truth.rate, len(truth.support))


def event(data: bytes) -> _Sent:
    """Return kind and node of an atpid_interfaces/msg/Event; raise MessageError for an invalid one."""
    decoded = _decoded(EVENT, data)
    return _Sent(str(decoded.kind), str(decoded.node))


def _decoded(kind: str, data: bytes) -> Decoded:
    try:
        return decoder_of(kind).decode(0, data)
    except BagError:
        raise MessageError("its bytes do not fit its type") from None


@cache
def decoder_of(kind: str) -> Decoder:
    """Return what decodes messages of the installed type `kind`, as schema 0; raise TypeUnknownError."""
    decoder = Decoder()
    decoder.add(Schema(id=0, name=kind, encoding="ros2msg", data=message_type(kind).definition.encode()))
    return decoder
