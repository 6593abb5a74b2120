# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml, version 9, required by rosbag2 of Jazzy, and quality of service by the names used there."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

_FOREVER_NS = 9_223_372_036_854_775_807
_FOREVER = {"sec": 9_223_372_036, "nsec": 854_775_807}


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

    def mapping(self) -> dict[str, Any]:
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
    if nanoseconds <= 0 or nanoseconds >= _FOREVER_NS:
        return dict(_FOREVER)
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


FILE_NAME = "metadata.yaml"


@dataclass
class TopicSummary:
    """One topic of a bag."""

    name: str
    type: str
    hash: str
    qos: list[dict[str, Any]]  # the entries of `offered_qos_profiles`
    count: int = 0


@dataclass
class BagSummary:
    """The contents of a bag's metadata.yaml."""

    file_name: str
    topics: dict[str, TopicSummary] = field(default_factory=dict)
    start_ns: int | None = None  # earliest log time [ns]
    end_ns: int = 0  # latest log time [ns]

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(topic.count for topic in self.topics.values())

    def add(self, topic: str, log_ns: int) -> None:
        """Count one message."""
        self.topics[topic].count += 1
        self.start_ns = log_ns if self.start_ns is None else min(self.start_ns, log_ns)
        self.end_ns = max(self.end_ns, log_ns)


def mapping_of(summary: BagSummary, custom: Mapping[str, str]) -> dict[str, Any]:
    """Return the required mapping, in its order; `custom` is the run's id, commit and the like."""
    start = summary.start_ns or 0
    starting, duration = {"nanoseconds_since_epoch": start}, {"nanoseconds": max(0, summary.end_ns - start)}
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
        "duration": duration,
        "starting_time": starting,
        "message_count": summary.count,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [summary.file_name],
        "files": [
            {
                "path": summary.file_name,
                "starting_time": dict(starting),
                "duration": dict(duration),
                "message_count": summary.count,
            }
        ],
        "custom_data": dict(custom),
        "ros_distro": "jazzy",
    }
    return {"rosbag2_bagfile_information": information}


def write(folder: Path, summary: BagSummary, custom: Mapping[str, str]) -> Path:
    """Write metadata.yaml whole or not at all; return its path. Raises OSError."""
    path, partial = folder / FILE_NAME, folder / f".{FILE_NAME}.partial"
    with partial.open("w", encoding="utf-8") as stream:
        yaml.safe_dump(mapping_of(summary, custom), stream, sort_keys=False, allow_unicode=True)
        stream.flush()
        os.fsync(stream.fileno())
    partial.replace(path)
    return path
