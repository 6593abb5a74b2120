# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How every figure and page looks: the colours of a light and a dark scheme, and matplotlib's settings for one."""

from dataclasses import dataclass
from typing import Any

#: Size of the text [points].
SIZE = 9.5
#: Width of a picture of the documentation [in]: its text is then 11 pixels high on a page of 700.
WIDTH = 8.4


@dataclass(frozen=True)
class Palette:
    """Colours of one scheme: grey for the given excitation and the closed damper, blue for the damper.

    Orange is kept for the thesis's printed figures and for warnings. The contrast of text is at least 4.5 to 1.
    """

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
    green: str  # curves without a meaning of their own, after `own` and `accent`
    red: str
    violet: str


LIGHT = Palette(
    paper="#ffffff", ink="#1a1d21", muted="#5f6770", grid="#e7e9ec", given="#b4bac1", given_text="#6b727a",
    own="#0f6aa3", soft="#cfe3f0", accent="#b4540a", window="#f2f5f8",
    green="#2f7d4b", red="#b0304a", violet="#6f4fa0",
)  # fmt: skip
DARK = Palette(
    paper="#14171b", ink="#e9ebee", muted="#9aa2ab", grid="#2a2f36", given="#5b646e", given_text="#98a1ab",
    own="#62b2e6", soft="#1d3b50", accent="#eb9b57", window="#1b2026",
    green="#6cc08b", red="#ee7f95", violet="#b49be0",
)  # fmt: skip
#: Curves without a meaning of their own, in this order.
_CYCLE = (
    LIGHT.own, LIGHT.accent, LIGHT.green, LIGHT.red, LIGHT.violet, "#7a5c3e", "#c0468f", LIGHT.muted, "#93891c",
    "#1a8f9c",
)  # fmt: skip


def style(palette: Palette) -> Any:
    """Return matplotlib's settings for a palette."""
    return {
        "font.family": "DejaVu Sans", "font.size": SIZE, "axes.edgecolor": palette.grid, "axes.linewidth": 0.8,
        "axes.facecolor": palette.paper, "figure.facecolor": palette.paper, "savefig.facecolor": palette.paper,
        "axes.labelcolor": palette.muted, "text.color": palette.ink, "xtick.color": palette.muted,
        "ytick.color": palette.muted, "xtick.major.size": 0.0, "ytick.major.size": 0.0, "xtick.minor.size": 0.0,
        "ytick.minor.size": 0.0, "axes.grid": True, "grid.color": palette.grid, "grid.linewidth": 0.8,
        "axes.axisbelow": True, "axes.spines.top": False, "axes.spines.right": False, "axes.spines.left": False,
        "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.titlesize": SIZE + 0.5,
        "axes.prop_cycle": f"cycler(color={_CYCLE})", "legend.facecolor": palette.paper,
        "legend.edgecolor": "none", "legend.fontsize": SIZE - 1.5, "lines.solid_capstyle": "round",
    }  # fmt: skip
