# SPDX-License-Identifier: Apache-2.0
"""Bags that `ros2 bag` reads, written without rosbag2: definitions, metadata, writer, order, proof of completeness."""

from __future__ import annotations

from atpid_control.recording.errors import BagError, TypeUnknownError
from atpid_control.recording.qos import Qos
from atpid_control.recording.run_info import RunInfo, new_run
from atpid_control.recording.verify import Verified, repair, verify
from atpid_control.recording.writer import BagWriter, check_new

__all__ = [
    "BagError",
    "BagWriter",
    "Qos",
    "RunInfo",
    "TypeUnknownError",
    "Verified",
    "check_new",
    "new_run",
    "repair",
    "verify",
]
