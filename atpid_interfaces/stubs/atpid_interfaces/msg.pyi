# SPDX-License-Identifier: Apache-2.0
# Made by `python tests/message_stubs.py` from the definitions; a test compares.
from array import array
from collections.abc import Sequence
from typing import Final

from std_msgs.msg import Header


class CeilingCommand:
    def __init__(self, *, header: Header = ..., handshake: bool = ..., sequence: int = ..., height: float = ..., excitation_amplitude: float = ..., predicted_amplitude: float = ..., method: str = ..., reason: str = ...) -> None: ...
    header: Header
    handshake: bool
    sequence: int
    height: float
    excitation_amplitude: float
    predicted_amplitude: float
    method: str
    reason: str


class CeilingState:
    UNCONFIGURED: Final = 0
    DISARMED: Final = 1
    HOMING: Final = 2
    HOLDING: Final = 3
    MOVING: Final = 4
    FAULT: Final = 5
    def __init__(self, *, header: Header = ..., handshake: bool = ..., mode: int = ..., homed: bool = ..., faults: int = ..., fault: str = ..., height: float = ..., target: float = ..., velocity: float = ..., speed: float = ..., sequence: int = ...) -> None: ...
    header: Header
    handshake: bool
    mode: int
    homed: bool
    faults: int
    fault: str
    height: float
    target: float
    velocity: float
    speed: float
    sequence: int


class Event:
    INFO: Final = 0
    WARNING: Final = 1
    ALARM: Final = 2
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
    def __init__(self, *, header: Header = ..., handshake: bool = ..., node: str = ..., severity: int = ..., kind: str = ..., value: float = ..., text: str = ...) -> None: ...
    header: Header
    handshake: bool
    node: str
    severity: int
    kind: str
    value: float
    text: str


class Excitation:
    NONE: Final = 0
    STEADY: Final = 1
    TRANSIENT: Final = 2
    POOR: Final = 3
    SUPPORT: Final = 0
    BEAM: Final = 1
    def __init__(self, *, header: Header = ..., handshake: bool = ..., device: str = ..., last_index: int = ..., quality: int = ..., origin: int = ..., changed: bool = ..., amplitude: float = ..., amplitude_std: float = ..., frequency: float = ..., frequency_std: float = ..., phase: float = ..., phase_std: float = ..., offset: float = ..., window: float = ..., residual: float = ..., harmonics: float = ..., used: int = ..., lost: int = ..., beam_amplitude: float = ...) -> None: ...
    header: Header
    handshake: bool
    device: str
    last_index: int
    quality: int
    origin: int
    changed: bool
    amplitude: float
    amplitude_std: float
    frequency: float
    frequency_std: float
    phase: float
    phase_std: float
    offset: float
    window: float
    residual: float
    harmonics: float
    used: int
    lost: int
    beam_amplitude: float


class ExcitationCommand:
    OFF: Final = 0
    SINE: Final = 1
    SWEEP: Final = 2
    RANDOM: Final = 3
    RECORDED: Final = 4
    def __init__(self, *, header: Header = ..., sequence: int = ..., kind: int = ..., hold: bool = ..., amplitude: float = ..., frequency: float = ..., end_frequency: float = ..., duration: float = ..., seed: int = ..., file: str = ...) -> None: ...
    header: Header
    sequence: int
    kind: int
    hold: bool
    amplitude: float
    frequency: float
    end_frequency: float
    duration: float
    seed: int
    file: str


class ExcitationState:
    UNCONFIGURED: Final = 0
    OFF: Final = 1
    RAMPING: Final = 2
    RUNNING: Final = 3
    STOPPING: Final = 4
    FAULT: Final = 5
    def __init__(self, *, header: Header = ..., mode: int = ..., fault: str = ..., kind: int = ..., sequence: int = ..., held: bool = ..., amplitude: float = ..., frequency: float = ..., measured_amplitude: float = ..., measured_frequency: float = ..., output: float = ...) -> None: ...
    header: Header
    mode: int
    fault: str
    kind: int
    sequence: int
    held: bool
    amplitude: float
    frequency: float
    measured_amplitude: float
    measured_frequency: float
    output: float


class PlantTruth:
    def __init__(self, *, header: Header = ..., handshake: bool = ..., first_index: int = ..., rate: float = ..., excitation_amplitude: float = ..., excitation_frequency: float = ..., impacts: int = ..., input_energy: float = ..., beam_loss: float = ..., contact_loss: float = ..., ceiling_work: float = ..., stored_energy: float = ..., support: Sequence[float] = ..., beam: Sequence[float] = ..., grain: Sequence[float] = ..., ceiling: Sequence[float] = ...) -> None: ...
    header: Header
    handshake: bool
    first_index: int
    rate: float
    excitation_amplitude: float
    excitation_frequency: float
    impacts: int
    input_energy: float
    beam_loss: float
    contact_loss: float
    ceiling_work: float
    stored_energy: float
    @property
    def support(self) -> array[float]: ...
    @support.setter
    def support(self, value: Sequence[float]) -> None: ...
    @property
    def beam(self) -> array[float]: ...
    @beam.setter
    def beam(self, value: Sequence[float]) -> None: ...
    @property
    def grain(self) -> array[float]: ...
    @grain.setter
    def grain(self, value: Sequence[float]) -> None: ...
    @property
    def ceiling(self) -> array[float]: ...
    @ceiling.setter
    def ceiling(self, value: Sequence[float]) -> None: ...


class RecorderStatus:
    def __init__(self, *, header: Header = ..., recording: bool = ..., bag: str = ..., topics: Sequence[str] = ..., received: Sequence[int] = ..., written: Sequence[int] = ...) -> None: ...
    header: Header
    recording: bool
    bag: str
    @property
    def topics(self) -> list[str]: ...
    @topics.setter
    def topics(self, value: Sequence[str]) -> None: ...
    @property
    def received(self) -> array[int]: ...
    @received.setter
    def received(self, value: Sequence[int]) -> None: ...
    @property
    def written(self) -> array[int]: ...
    @written.setter
    def written(self, value: Sequence[int]) -> None: ...


class SampleBlock:
    def __init__(self, *, header: Header = ..., handshake: bool = ..., device: str = ..., first_index: int = ..., rate: float = ..., dropped: int = ..., backlog: int = ..., channels: Sequence[str] = ..., units: Sequence[str] = ..., skew: Sequence[float] = ..., data: Sequence[float] = ...) -> None: ...
    header: Header
    handshake: bool
    device: str
    first_index: int
    rate: float
    dropped: int
    backlog: int
    @property
    def channels(self) -> list[str]: ...
    @channels.setter
    def channels(self, value: Sequence[str]) -> None: ...
    @property
    def units(self) -> list[str]: ...
    @units.setter
    def units(self, value: Sequence[str]) -> None: ...
    @property
    def skew(self) -> array[float]: ...
    @skew.setter
    def skew(self, value: Sequence[float]) -> None: ...
    @property
    def data(self) -> array[float]: ...
    @data.setter
    def data(self, value: Sequence[float]) -> None: ...


class SupervisorState:
    STARTING: Final = 0
    READY: Final = 1
    DEGRADED: Final = 2
    FAULT: Final = 3
    SAFE: Final = 4
    SHUTDOWN: Final = 5
    def __init__(self, *, header: Header = ..., state: int = ..., permit: bool = ..., stop: bool = ..., reason: str = ..., nodes: Sequence[str] = ..., silence: Sequence[float] = ...) -> None: ...
    header: Header
    state: int
    permit: bool
    stop: bool
    reason: str
    @property
    def nodes(self) -> list[str]: ...
    @nodes.setter
    def nodes(self, value: Sequence[str]) -> None: ...
    @property
    def silence(self) -> array[float]: ...
    @silence.setter
    def silence(self, value: Sequence[float]) -> None: ...
