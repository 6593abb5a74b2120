# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks what is in a bag: every sample index, one answer to each block, stamps, heights and speeds, how it ended.

And whether it is whole as a file (`verify`), in the same pass: memory does not grow with its length.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata

from atpid_common.errors import AtpidError
from atpid_common.files import parse_yaml
from atpid_common.injected_faults import Injected
from atpid_common.message_checks import CHECKS, check_as
from atpid_common.vocabulary import EventKind, Severity
from atpid_control.runs import check_rules as rules
from atpid_control.runs.check_rules import Findings
from atpid_control.runs.decode import Decoded, scans_of, stamp_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import IMPORTED, RESULT, RUN, SCENE
from atpid_control.runs.read import kind_of
from atpid_control.runs.records import channel_of
from atpid_control.runs.verify import Pass, Verified, read_through
from atpid_control.runs.writer import LIBRARY
from atpid_sim.plant.stream import last_stamp_ns
from atpid_sim.scene import scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml

#: Answers to a block, by their place after it.
_PLACE = {"Excitation": 1, "CeilingCommand": 2}


@dataclass(frozen=True)
class Checked:
    """What the check of a bag showed."""

    verified: Verified  # the file
    findings: list[str]  # what breaks a rule, one line each
    counts: dict[str, int]  # of all findings, by kind
    events: list[str]  # warnings and alarms, one line for each kind
    lost: int  # scans, by index, reported or not
    blocks: int  # answered blocks
    line: str  # everything in one line


class _Check(Pass):
    """The state of one pass over a bag."""

    def __init__(self, path: Path) -> None:
        super().__init__(strict=True)
        self.path = path
        self.findings, self.answers = Findings(), rules.AnswerMatching()
        self.limits = rules.AllowedCeiling()
        self.scans: dict[str, rules.NoGaps] = {}
        self.stamps: dict[str, rules.RisingStamps] = {}
        self.run: dict[str, str] = {}
        self.result: dict[str, str] = {}
        self.events: dict[str, tuple[int, str]] = {}  # by kind: how many, and the first
        self.ended = ""
        self.foreign = False  # recorded by another program, which keeps no result
        self.finished_ns: int | None = None
        self._ceiling: rules.CeilingWithinLimits | None = None
        self._injected: tuple[Injected, ...] = ()  # on purpose: what they alone explain is no finding
        #: Where a clock failed on purpose: the blocks, in whose order by index the rules are then applied.
        self._unordered: list[tuple[str, int, str, int, Decoded]] | None = None

    @property
    def ceiling(self) -> rules.CeilingWithinLimits:
        """The rules of the ceiling; made when the run's description and files, which stand first, have been read."""
        if self._ceiling is None:
            self._ceiling = rules.CeilingWithinLimits(self.limits, self.run.get("clock") == "lockstep", self._injected)
        return self._ceiling

    def attached(self, name: str, data: bytes) -> None:
        """Take the limits of the ceiling from a file kept in the bag, where it has some."""
        try:
            if name == SCENE:
                scene = scene_from_mapping(read_yaml(data.decode(), name), source=name, folder=self.path)
                if scene.ceiling.controlled:
                    self.limits.narrow(*scene.ceiling.range, scene.ceiling.speed)
                self._injected = scene.injected
                if any(fault.part == "clock" for fault in scene.injected):
                    self._unordered, self.answers.shared_stamps = [], True
            elif name.endswith((".yaml", ".yml")):
                self._of_node(parse_yaml(data))
        except (AtpidError, UnicodeDecodeError) as error:
            self.findings.add("file", f"{name}: {str(error).splitlines()[0]}")

    def _of_node(self, document: object) -> None:
        for key, block in document.items() if isinstance(document, Mapping) else ():
            given = block.get("ros__parameters") if isinstance(block, Mapping) else None
            if str(key).rsplit("/", 1)[-1] == "motor_node" and isinstance(given, Mapping):
                self.limits.narrow(*(_number(given.get(name)) for name in ("lowest", "highest", "speed")))

    def take(self, record: McapRecord, place: int) -> bool:
        """Take a record; of those that are no messages what they state of the run."""
        if isinstance(record, Header):
            self.foreign |= record.library != LIBRARY
        elif isinstance(record, Attachment):
            self.attached(record.name, record.data)
        elif isinstance(record, Metadata):
            {RUN: self.run, RESULT: self.result}.get(record.name, {}).update(record.metadata)
        try:
            return super().take(record, place)
        except BagError as error:
            if not isinstance(record, Message):
                raise
            self.findings.add("message", f"{channel_of(record, self.channels).topic}: {error}")
            return False

    def decoded(self, channel: Channel, message: Decoded) -> None:
        """Take a message; a handshake carries nothing, nor do diagnostics and the log."""
        kind = kind_of(self.decoder.name(channel.schema_id))
        if kind in CHECKS and not getattr(message, "handshake", False):
            self.message(channel.topic, kind, message)

    def message(self, topic: str, kind: str, message: Decoded) -> None:
        """Take a message of atpid_interfaces/msg/`kind`."""
        reason = check_as(kind, message)
        if reason:
            self.findings.add("message", f"{topic}: {reason}")
            return
        stamp = stamp_of(message)
        if kind == "Event":
            self._event(stamp, message)
            return
        if topic not in self.stamps:
            self.stamps[topic] = rules.RisingStamps(topic, strictly=kind != "CeilingState")
        if self._unordered is None:
            self.stamps[topic].add(stamp, self.findings)
        if kind in ("SampleBlock", "PlantTruth") and self._unordered is not None:
            self._unordered.append((topic, int(message.first_index), kind, stamp, message))
        elif kind in ("SampleBlock", "PlantTruth"):
            self._block(topic, kind, stamp, message)
        elif kind in _PLACE:
            self.answers.add(_PLACE[kind], stamp, self.findings)
            if kind == "CeilingCommand":
                self.ceiling.command(stamp, message.height, self.findings)
        elif kind == "CeilingState":
            self.ceiling.state(stamp, message.height, message.target, self.findings)

    def _block(self, topic: str, kind: str, stamp: int, block: Decoded) -> None:
        first, scans = int(block.first_index), scans_of(block)
        if first == 0:
            self.ceiling.begin = stamp * 1e-9
        stream = self.scans.setdefault(topic, rules.NoGaps(topic))
        stream.add(first, scans, int(getattr(block, "dropped", 0)), self.findings)
        if kind == "PlantTruth":
            self.ceiling.truth(stamp, first, block.rate, np.asarray(block.ceiling), self.findings)
        elif topic.endswith("laser"):
            self.answers.add(0, last_stamp_ns(stamp, first, scans, block.rate), self.findings)

    def _event(self, stamp: int, event: Decoded) -> None:
        if event.severity >= Severity.WARNING:
            count, first = self.events.get(event.kind, (0, f"{rules.seconds(stamp)}, {event.text}"))
            self.events[event.kind] = count + 1, first
        if event.kind in (EventKind.FINISHED, EventKind.FAILED):
            self.ended = f"{self.ended}; {event.text}" if self.ended else f"{event.kind}: {event.text}"
            self.finished_ns = stamp

    def judged(self, verified: Verified) -> Checked:
        """Judge what is left."""
        if verified.problem:
            self.findings.add("file", verified.problem)
        for topic, _, kind, stamp, block in sorted(self._unordered or [], key=lambda one: one[:2]):
            self._block(topic, kind, stamp, block)
        self.answers.end(self.findings, self.finished_ns)
        if self.foreign and not self.result:
            self.ended += f"{self.ended and '; '}recorded by another program: there is no result in it"
        elif not self.result:
            self.findings.add("end", "the recording was not closed; `atpid bag recover` makes a whole bag of it")
        elif IMPORTED in self.run:
            self.ended = f"imported from {self.run[IMPORTED]}: no loop ran"
        elif not self.ended:
            self.ended = "stopped before a source had finished"
        for name, stream in self.scans.items():
            counted = self.result.get(f"lost_scans {name}", str(stream.lost))
            if counted != str(stream.lost):
                text = f"{name}: the recorder counted {counted} lost scans, the indices {stream.lost}"
                self.findings.add("lost", text)
        if not self.answers.answered and not self.findings.counts and IMPORTED not in self.run:
            self.findings.add("end", "there is no answered block in this bag")
        events = [f"{kind}: {count}, the first at {first}" for kind, (count, first) in sorted(self.events.items())]
        lost = sum(stream.lost for stream in self.scans.values())
        found, answered = self.findings, self.answers.answered
        return Checked(verified, found.lines(), dict(found.counts), events, lost, answered, self._line(lost))

    def _line(self, lost: int) -> str:
        ceiling, limits = self.ceiling, self.limits
        scans = sum(stream.scans for stream in self.scans.values())
        moved = f"ceiling {ceiling.low:g} to {ceiling.high:g} m" if math.isfinite(ceiling.low) else "no ceiling"
        allowed = f"allowed {limits.lowest:g} to {limits.highest:g} m, {limits.speed:g} m/s"
        allowed = "its limits are not in the bag" if math.isnan(limits.lowest + limits.speed) else allowed
        found = sum(self.findings.counts.values())
        return (
            f"{self.path}: {found or 'no'} findings; {self.answers.answered} blocks answered, {scans} scans, "
            f"{lost} lost; {moved} ({allowed}); {sum(count for count, _ in self.events.values())} warnings; "
            f"{self.ended or 'not closed'}"
        )


def check(path: Path) -> Checked:
    """Check the run in a bag. Raises BagError where the file cannot be read to its end."""
    state = _Check(path)
    return state.judged(read_through(path, state))


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
