# SPDX-License-Identifier: Apache-2.0
"""Proof by sample indices that nothing was lost: each block begins where the one before ended."""

from __future__ import annotations

from dataclasses import dataclass

from atpid_control.recording.cdr import BlockShape


@dataclass
class Continuity:
    """The scans of one stream."""

    next_index: int | None = None
    scans: int = 0  # received
    lost: int = 0  # missing between blocks
    gaps: int = 0  # times that scans were missing
    dropped: int = 0  # what the device itself says it lost

    def add(self, block: BlockShape) -> int:
        """Take the next block; return how many scans are missing before it (0: none)."""
        missing = 0 if self.next_index is None else max(0, block.first_index - self.next_index)
        self.next_index = block.first_index + block.scans
        self.scans += block.scans
        self.lost += missing
        self.gaps += missing > 0
        self.dropped = block.dropped
        return missing
