# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Between bags and rclpy: message classes by name, and quality of service."""

import importlib

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from atpid_control.runs.decode import split_name
from atpid_control.runs.metadata import Qos
from atpid_control.runs.topics import Topic

#: Messages kept per topic while the recorder is busy: 50 s of blocks at 20 a second.
DEPTH = 1000


def class_of(name: str) -> type:
    """Return the class of the message type "pkg/msg/Name"; raise TypeUnknownError for a name of another form."""
    package, message = split_name(name)
    found: type = getattr(importlib.import_module(f"{package}.msg"), message)
    return found


def subscription_qos(topic: Topic) -> QoSProfile:
    """Return the quality of service a recorder requests for `topic`."""
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if topic.best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local else DurabilityPolicy.VOLATILE,
    )


def qos_of(profile: QoSProfile) -> Qos:
    """Return a profile as a bag describes it; DDS does not announce history and depth: the recorder's are taken."""
    known = profile.history in (HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL)
    return Qos(
        depth=profile.depth or DEPTH,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        history=profile.history.short_key if known else "keep_last",
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.short_key,
        lease_ns=profile.liveliness_lease_duration.nanoseconds,
    )
