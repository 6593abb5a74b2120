# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What describes a bag: the origin of the run (id, commit, configuration verbatim), and metadata.yaml.

metadata.yaml is version 9, required by rosbag2 of Jazzy, with quality of service by the names used there.
"""

import os
import platform
import secrets
import subprocess
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, count
from pathlib import Path

import yaml

from atpid_common.files import Document
from atpid_control.runs.errors import BagError

#: Names of the metadata records in the MCAP file.
RUN, RESULT = "atpid_run", "atpid_result"
#: What a bag was made of that was imported from files of another program, in its description.
IMPORTED = "imported"
#: Name of the attachment that holds the scene.
SCENE = "scene.yaml"


@dataclass(frozen=True)
class RunInfo:
    """What is written at the beginning of a bag, before any message."""

    id: str
    commit: str
    created: datetime
    facts: dict[str, str] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)  # attachments by name

    def record(self) -> dict[str, str]:
        """Return the metadata record, which metadata.yaml repeats as `custom_data`."""
        return {
            "run_id": self.id,
            "commit": self.commit,
            "created": self.created.isoformat(timespec="seconds"),
            **self.facts,
        }


def new_run(
    scene: Path | None = None, files: Iterable[Path] = (), run_id: str = "", commit: str = "", **facts: str
) -> RunInfo:
    """Return the description of a run that begins now; raise BagError for a file that cannot be read."""
    created = datetime.now(timezone.utc)
    attached: dict[str, bytes] = {}
    if scene is not None:
        attached[SCENE] = _read(scene)
        facts = {"scene": scene.name, **facts}
    for path in files:
        content = _read(path)
        if attached.get(path.name) != content:
            # numbered where a file of another folder already has the name
            names = chain([path.name], (f"{path.stem}-{number}{path.suffix}" for number in count(2)))
            attached[next(name for name in names if name not in attached)] = content
    identity = run_id or f"{created:%Y%m%dT%H%M%SZ}-{secrets.token_hex(3)}"
    machine = {"python": platform.python_version(), "machine": platform.machine()}
    return RunInfo(identity, commit or commit_of(Path(__file__)), created, {**facts, **machine}, attached)


def commit_of(path: Path) -> str:
    """Return `git describe` of the checkout `path` is in ("-dirty": with changes), else the installed version."""
    command = ["git", "-C", str(path.resolve().parent), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    with suppress(OSError, subprocess.TimeoutExpired):
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=False)
        if answer.returncode == 0:
            return answer.stdout.strip()
    try:
        return f"version {version('atpid_control')}"
    except PackageNotFoundError:
        return "unknown"


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        what = f"given as configuration to record, but cannot be read ({error.strerror}); give an existing file"
        raise BagError(f"{path}: {what}") from None


_FOREVER_NS = 9_223_372_036_854_775_807


@dataclass(frozen=True)
class Qos:
    """What a publisher offers."""

    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    deadline_ns: int = _FOREVER_NS
    lifespan_ns: int = _FOREVER_NS
    liveliness: str = "automatic"
    lease_ns: int = _FOREVER_NS

    def mapping(self) -> Document:
        """Return the entry of `offered_qos_profiles` in version 9."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _duration(self.deadline_ns),
            "lifespan": _duration(self.lifespan_ns),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _duration(self.lease_ns),
            "avoid_ros_namespace_conventions": False,
        }


def _duration(nanoseconds: int) -> dict[str, int]:
    nanoseconds = nanoseconds if 0 < nanoseconds < _FOREVER_NS else _FOREVER_NS
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


FILE_NAME = "metadata.yaml"


@dataclass
class TopicSummary:
    """One topic of a bag."""

    name: str
    type: str
    hash: str
    qos: list[Document]  # the entries of `offered_qos_profiles`
    count: int = 0


@dataclass
class _FileSummary:
    """One file of a bag."""

    name: str
    count: int = 0  # messages
    start_ns: int | None = None  # earliest log time [ns]
    end_ns: int = 0  # latest log time [ns]

    def add(self, log_ns: int) -> None:
        """Count one message."""
        self.count += 1
        self.start_ns = log_ns if self.start_ns is None else min(self.start_ns, log_ns)
        self.end_ns = max(self.end_ns, log_ns)

    def times(self) -> Document:
        """Return begin and duration as rosbag2 writes them."""
        start = self.start_ns or 0
        return {
            "starting_time": {"nanoseconds_since_epoch": start},
            "duration": {"nanoseconds": max(0, self.end_ns - start)},
        }


class BagSummary:
    """The contents of a bag's metadata.yaml: its topics, its files, and all of it together."""

    def __init__(self, file_name: str) -> None:
        """Begin with the first file."""
        self.topics: dict[str, TopicSummary] = {}
        self.files = [_FileSummary(file_name)]
        self.whole = _FileSummary("")

    def begin_file(self, name: str) -> None:
        """Count what follows as contents of another file."""
        self.files.append(_FileSummary(name))

    def add(self, topic: str, log_ns: int) -> None:
        """Count one message."""
        self.topics[topic].count += 1
        self.whole.add(log_ns)
        self.files[-1].add(log_ns)


def _mapping_of(summary: BagSummary, custom: Mapping[str, str]) -> Document:
    """Return the required mapping, in its order; `custom` is the run's id, commit and the like."""
    whole = summary.whole.times()
    topics = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type,
                "serialization_format": "cdr",
                "offered_qos_profiles": topic.qos,
                "type_description_hash": topic.hash,
            },
            "message_count": topic.count,
        }
        for topic in summary.topics.values()
    ]
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": whole["duration"],
        "starting_time": whole["starting_time"],
        "message_count": summary.whole.count,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in summary.files],
        "files": [{"path": file.name, **file.times(), "message_count": file.count} for file in summary.files],
        "custom_data": dict(custom),
        "ros_distro": "jazzy",
    }
    return {"rosbag2_bagfile_information": information}


def write(folder: Path, summary: BagSummary, custom: Mapping[str, str]) -> Path:
    """Write metadata.yaml whole or not at all; return its path. Raises OSError."""
    path, partial = folder / FILE_NAME, folder / f".{FILE_NAME}.partial"
    try:
        with partial.open("w", encoding="utf-8") as stream:
            yaml.safe_dump(_mapping_of(summary, custom), stream, sort_keys=False, allow_unicode=True)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path
