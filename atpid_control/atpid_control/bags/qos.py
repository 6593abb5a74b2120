# SPDX-License-Identifier: Apache-2.0
"""Quality of service as rosbag2 writes it: by names, with seconds and nanoseconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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


def as_yaml(profiles: tuple[Qos, ...]) -> str:
    """Return the list of `profiles` as the YAML text that an MCAP channel's own metadata holds."""
    text: str = yaml.safe_dump([profile.mapping() for profile in profiles], sort_keys=False)
    return text


def from_yaml(text: str) -> tuple[Qos, ...]:
    """Return what `as_yaml` wrote; nothing for an empty text."""
    return tuple(_from_mapping(entry) for entry in yaml.safe_load(text) or [])


def _from_mapping(entry: Mapping[str, Any]) -> Qos:
    return Qos(
        depth=int(entry["depth"]),
        reliability=str(entry["reliability"]),
        durability=str(entry["durability"]),
        history=str(entry["history"]),
        deadline_ns=_nanoseconds(entry["deadline"]),
        lifespan_ns=_nanoseconds(entry["lifespan"]),
        liveliness=str(entry["liveliness"]),
        lease_ns=_nanoseconds(entry["liveliness_lease_duration"]),
    )


def _nanoseconds(entry: Mapping[str, int]) -> int:
    return int(entry["sec"]) * 1_000_000_000 + int(entry["nsec"])


def _duration(nanoseconds: int) -> dict[str, int]:
    if nanoseconds <= 0 or nanoseconds >= _FOREVER_NS:
        return dict(_FOREVER)
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}
