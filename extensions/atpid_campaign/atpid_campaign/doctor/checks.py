# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of checks, and what they found as a block to paste."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from atpid_campaign.doctor.findings import Finding, Verdict

#: By name: where a check is, as "module:function" of this package, and what mends it where its error has no remedy.
#: A function takes the Subject and yields what it finds. Each is imported when its turn comes: a package that is
#: missing fails the checks that need it, and no other. The clock is last: it is compared over all the others.
CHECKS: Mapping[str, tuple[str, str]] = {
    "packages": ("software:packages", "make setup"),
    "workspace": ("software:workspace", "make setup, then . ros2_ws/activate"),
    "middleware": ("software:middleware", "unset ROS_DOMAIN_ID"),
    "nodes": ("software:nodes", ""),
    "scene": ("software:scene", "correct the scene (docs/scenes.md)"),
    "parameters": ("software:parameters", "correct the file (docs/parameters.md)"),
    "travel": ("devices:travel", ""),
    "board": ("devices:board", "docs/stand.md, Firmware"),
    "LabJack": ("devices:labjack", "docs/stand.md, Software on the PC"),
    "NI": ("devices:ni", "docs/stand.md, Software on the PC"),
    "exciter": ("devices:exciter", "docs/excitation_output.md"),
    "calibrations": ("devices:calibrations", "docs/stand.md, Calibration"),
    "ranges": ("devices:ranges", ""),
    "real time": ("computer:real_time", ""),
    "USB": ("computer:usb", ""),
    "disk": ("computer:disk", ""),
    "clock": ("computer:clock", ""),
}
_MEANING = {
    Verdict.RIGHT: "the stand can be started",
    Verdict.DEGRADED: "the stand can be started, with what is named",
    Verdict.WOULD_FAIL: "the stand would not start, or would end",
}


def verdict_of(findings: Iterable[Finding]) -> Verdict:
    """Return the worst verdict; what was not checked does not count."""
    return max([Verdict.RIGHT, *(finding.verdict for finding in findings)])


def block(findings: Sequence[Finding]) -> str:
    """Return plain text to paste into a report: nothing of the user's own but the names of files below ~."""
    lines = [f"atpid doctor: {platform.python_implementation()} {platform.python_version()}, {platform.platform()}"]
    for verdict, found, mend, check in findings:
        lines += [f"{verdict.word:11}  {check}: {found}", *([f"{'':11}  -> {mend}"] if mend else [])]
    counts = {verdict: sum(finding.verdict is verdict for finding in findings) for verdict in reversed(Verdict)}
    parts = [f"{count} {verdict.word}" for verdict, count in counts.items() if count]
    lines.append(f"{', '.join(parts)}: {_MEANING[verdict_of(findings)]}")
    return "\n".join(lines).replace(f"{Path.home()}/", "~/")
