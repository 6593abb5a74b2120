# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which topics a recorder subscribes to: a fixed list, never "everything there is"."""

from dataclasses import dataclass

from atpid_control.runs.definitions import message_type
from atpid_control.runs.errors import BagError

BLOCK, TRUTH = "atpid_interfaces/msg/SampleBlock", "atpid_interfaces/msg/PlantTruth"
EVENT, DIAGNOSTICS = "atpid_interfaces/msg/Event", "diagnostic_msgs/msg/DiagnosticArray"
LOG, TRANSITION = "rcl_interfaces/msg/Log", "lifecycle_msgs/msg/TransitionEvent"
SUPERVISOR = "atpid_interfaces/msg/SupervisorState"
EXCITED_BY, EXCITER = "atpid_interfaces/msg/ExcitationCommand", "atpid_interfaces/msg/ExcitationState"
#: Types of what is paced and stamped by the machine's clock and not by the run: left out in lockstep.
BY_CLOCK = (DIAGNOSTICS, LOG, TRANSITION, SUPERVISOR)
#: Everything the graph publishes, in the order in which messages of one stamp are written.
DEFAULT = (
    f"sensors/laser {BLOCK}",
    f"sensors/accelerometer {BLOCK}",
    f"plant/truth {TRUTH}",
    "excitation atpid_interfaces/msg/Excitation",
    "ceiling/command atpid_interfaces/msg/CeilingCommand",
    "ceiling/state atpid_interfaces/msg/CeilingState",
    f"excitation/command {EXCITED_BY}",
    f"excitation/state {EXCITER}",
    f"events {EVENT} transient_local",
    f"/diagnostics {DIAGNOSTICS}",
    f"/rosout {LOG} transient_local",
    f"supervisor/state {SUPERVISOR}",
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
    def has_header(self) -> bool:
        """Whether its messages begin with a std_msgs/Header."""
        return message_type(self.type).has_header

    @property
    def has_handshake(self) -> bool:
        """Whether its messages carry the field `handshake` after the header."""
        return message_type(self.type).has_handshake

    @property
    def in_loop(self) -> bool:
        """Whether it carries every stamp of a run, unlike an operator's commands, events, diagnostics and the log."""
        beside = (EVENT, SUPERVISOR, EXCITED_BY, EXCITER)
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
            raise BagError(
                f"parameter topics: {problem}; allowed: 'name pkg/msg/Type', then {' or '.join(_OPTIONS)} where needed"
            )
        message_type(kind)
        if not (lockstep and kind in BY_CLOCK):
            topics[name] = Topic(name, kind, "best_effort" in options, "transient_local" in options)
    return list(topics.values())
