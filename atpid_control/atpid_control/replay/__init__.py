# SPDX-License-Identifier: Apache-2.0
"""A recorded run once more through identifier and selector, with the parameters it was made with."""

from __future__ import annotations

from atpid_control.replay.agreement import Agreement, compare
from atpid_control.replay.files import ReplayFiles, write_replay_files

__all__ = ["Agreement", "ReplayFiles", "compare", "write_replay_files"]
