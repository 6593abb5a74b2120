# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The constants of the messages, for code without ROS; a test holds them to the .msg files, which explain each."""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple


class Mode(IntEnum):
    """CeilingState.mode: what the motor does."""

    UNCONFIGURED = 0
    DISARMED = 1
    HOMING = 2
    HOLDING = 3
    MOVING = 4
    FAULT = 5


class ExciterMode(IntEnum):
    """ExcitationState.mode: what the exciter's output does."""

    UNCONFIGURED = 0
    OFF = 1
    RAMPING = 2
    RUNNING = 3
    STOPPING = 4
    FAULT = 5


class ExciterKind(IntEnum):
    """ExcitationCommand.kind: what is put out."""

    OFF = 0
    SINE = 1
    SWEEP = 2
    RANDOM = 3
    RECORDED = 4


class Quality(IntEnum):
    """Excitation.quality: whether an estimate can be acted on."""

    NONE = 0
    STEADY = 1
    TRANSIENT = 2
    POOR = 3

    @classmethod
    def _missing_(cls, _value: object) -> Quality:
        """Return POOR for the value of a message that has none of these."""
        return cls.POOR


class Origin(IntEnum):
    """Excitation.origin: which signal an estimate comes from."""

    SUPPORT = 0
    BEAM = 1


class Drive(NamedTuple):
    """What drives a structure: its name, the sensor's channel, and the unit of that and of every amplitude of it."""

    name: str
    channel: str
    unit: str


#: By the word of a scene's `drive`. Messages of an excitation have no unit: theirs is that of the channel.
DRIVES: Final = {"support": Drive("support", "support_displacement", "m"), "force": Drive("force", "drive_force", "N")}


class Severity(IntEnum):
    """Event.severity."""

    INFO = 0
    WARNING = 1
    ALARM = 2


class RunState(IntEnum):
    """SupervisorState.state: the state of a supervised run."""

    STARTING = 0
    READY = 1
    DEGRADED = 2
    FAULT = 3
    SAFE = 4
    SHUTDOWN = 5


class Frame:
    """Frames of `header.frame_id` (REP 105), z up; the stand's origin is the container's floor at rest."""

    STAND: Final = "stand"
    SUPPORT: Final = "support"
    BEAM: Final = "beam"
    CEILING: Final = "ceiling"


class EventKind:
    """Event.kind."""

    STARTED: Final = "started"
    FINISHED: Final = "finished"
    FAILED: Final = "failed"
    BEHIND: Final = "behind"
    EXCITATION_CHANGED: Final = "excitation_changed"
    RUMBLE: Final = "rumble"
    CALM: Final = "calm"
    STEP_BACK: Final = "step_back"
    DRIFT: Final = "drift"
    FALLBACK: Final = "fallback"
    SLOW: Final = "slow"
    MOVED: Final = "moved"
    STALE: Final = "stale"
    RESUMED: Final = "resumed"
    QOS: Final = "qos"
    DROPPED: Final = "dropped"
    NO_USE: Final = "no_use"
    TWO_TONES: Final = "two_tones"
    REFUSED: Final = "refused"
    LINK: Final = "link"
    FAULT: Final = "fault"
    RECOVERED: Final = "recovered"
    TRIGGER: Final = "trigger"
    DUPLICATE: Final = "duplicate"
    SUPERVISION: Final = "supervision"
    LIMIT: Final = "limit"
    ABORT: Final = "abort"
    STOPPED: Final = "stopped"
    NOTE: Final = "note"
    PARAMETER: Final = "parameter"
    HANDSHAKE: Final = "handshake"
