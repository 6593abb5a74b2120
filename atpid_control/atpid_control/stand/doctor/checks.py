# SPDX-License-Identifier: Apache-2.0
"""The table of checks, and what they found as a table and as a block to paste."""

import platform
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from atpid_control.stand.doctor.findings import Checks, Row, Verdict

_COMPUTER, _SOFTWARE, _DEVICES = (f"atpid_control.stand.doctor.{name}" for name in ("computer", "software", "devices"))

#: Clock last: it compares two clocks over all the others.
CHECKS: Checks = {
    "Software": {
        "packages": (f"{_SOFTWARE}:packages", "make setup"),
        "workspace": (f"{_SOFTWARE}:workspace", "make setup, then . ros2_ws/activate"),
        "kernels": (f"{_COMPUTER}:kernels", ""),
    },
    "ROS": {
        "middleware": (f"{_SOFTWARE}:middleware", "unset ROS_DOMAIN_ID"),
        "nodes": (f"{_SOFTWARE}:nodes", ""),
    },
    "Stand": {
        "scene": (f"{_SOFTWARE}:scene", "correct the scene (docs/scenes.md)"),
        "parameters": (f"{_SOFTWARE}:parameters", "correct the file (docs/parameters.md)"),
        "board": (f"{_DEVICES}:board", "docs/stand.md, Firmware"),
        "LabJack": (f"{_DEVICES}:labjack", "docs/stand.md, Software on the PC"),
        "NI": (f"{_DEVICES}:ni", "docs/stand.md, Software on the PC"),
        "calibrations": (f"{_DEVICES}:calibrations", "docs/stand.md, Calibration"),
    },
    "Computer": {
        "processor": (f"{_COMPUTER}:processor", ""),
        "memory": (f"{_COMPUTER}:memory", ""),
        "real time": (f"{_COMPUTER}:real_time", ""),
        "USB": (f"{_COMPUTER}:usb", ""),
        "disk": (f"{_COMPUTER}:disk", ""),
        "clock": (f"{_COMPUTER}:clock", ""),
    },
}


def verdict_of(rows: Iterable[Row]) -> Verdict:
    """Return the worst verdict; what was not checked does not count."""
    return max((row.finding.verdict for row in rows), default=Verdict.RIGHT, key=int)


def summary(rows: Sequence[Row]) -> str:
    """Return the findings in one line, counted by verdict."""
    counts = {verdict: sum(row.finding.verdict is verdict for row in rows) for verdict in Verdict}
    parts = [f"{counts[verdict]} {verdict.word}" for verdict in sorted(Verdict, reverse=True) if counts[verdict]]
    return f"{', '.join(parts)}: {_MEANING[max(verdict_of(rows), Verdict.RIGHT)]}"


_MEANING = {
    Verdict.RIGHT: "the stand can be started",
    Verdict.DEGRADED: "the stand can be started, with what is named",
    Verdict.WRONG: "the stand would not start, or would end",
}


def block(rows: Sequence[Row]) -> str:
    """Return plain text to paste into a report: nothing of the user's own but the names of files below ~."""
    about = f"atpid doctor: {platform.python_implementation()} {platform.python_version()}, {platform.platform()}"
    lines = [about, *(f"[{row.finding.verdict.word}] {row.name}: {_told(row)}" for row in rows), summary(rows)]
    return "\n".join(lines).replace(f"{Path.home()}/", "~/")


def _told(row: Row) -> str:
    return row.finding.found + (f" -> {row.finding.mend}" if row.finding.mend else "")


def table(rows: Sequence[Row]) -> Any:
    """Return the same as a table for the terminal."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    styles = {Verdict.RIGHT: "green", Verdict.DEGRADED: "yellow", Verdict.WRONG: "bold red", Verdict.NOT_CHECKED: "dim"}
    made = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("", "check", "found", "mend"):
        made.add_column(name, overflow="fold")
    for row in rows:
        found, word = row.finding, Text(row.finding.verdict.word, style=styles[row.finding.verdict])
        made.add_row(word, Text(row.name), Text(found.found), Text(found.mend))
    return made
