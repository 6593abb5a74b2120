# SPDX-License-Identifier: Apache-2.0
"""Colours of all pictures: grey for the given excitation and the closed damper, blue for the damper.

Orange is kept for the thesis's printed figures and for warnings. The contrast of text is at least 4.5 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Palette:
    """Colours of one scheme."""

    paper: str
    ink: str
    muted: str  # axes, captions
    grid: str
    given: str  # the closed damper, the true excitation, the command
    given_text: str  # the same where it is text
    own: str  # the damper, the estimate, the ceiling
    soft: str  # the same, as an area
    accent: str  # the thesis's figures, warnings
    window: str  # where a stage is measured


LIGHT = Palette(
    paper="#ffffff", ink="#1a1d21", muted="#5f6770", grid="#e7e9ec", given="#b4bac1", given_text="#6b727a",
    own="#0f6aa3", soft="#cfe3f0", accent="#b4540a", window="#f2f5f8",
)  # fmt: skip
DARK = Palette(
    paper="#14171b", ink="#e9ebee", muted="#9aa2ab", grid="#2a2f36", given="#5b646e", given_text="#98a1ab",
    own="#62b2e6", soft="#1d3b50", accent="#eb9b57", window="#1b2026",
)  # fmt: skip
SCHEMES = {"light": LIGHT, "dark": DARK}
