# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of checks, how each is made, and what they found as a block to paste."""

import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path

from atpid_common.cli import load
from atpid_common.errors import AtpidError, one_line
from atpid_control.stand.findings import Finding, NotCheckedError, Subject, Verdict, judged

Checks = Mapping[str, tuple[str, str]]

_COMPUTER, _DEVICES, _SOFTWARE = (f"{__package__}.{name}" for name in ("computer", "devices", "software"))
#: By name: where a check is, as "module:function", and what mends it where its error has no remedy. A function takes
#: the Subject and yields what it finds. Each is imported when its turn comes: a package that is missing fails the
#: checks that need it, and no other. The clock is last: it is compared over all the others.
CHECKS: Checks = {
    "packages": (f"{_SOFTWARE}:packages", "make setup"),
    "workspace": (f"{_SOFTWARE}:workspace", "make setup, then . ros2_ws/activate"),
    "middleware": (f"{_SOFTWARE}:middleware", "unset ROS_DOMAIN_ID"),
    "nodes": (f"{_SOFTWARE}:nodes", ""),
    "scene": (f"{_SOFTWARE}:scene", "correct the scene (docs/scenes.md)"),
    "parameters": (f"{_SOFTWARE}:parameters", "correct the file (docs/parameters.md)"),
    "travel": (f"{_DEVICES}:travel", ""),
    "board": (f"{_DEVICES}:board", "docs/stand.md, Firmware"),
    "LabJack": (f"{_DEVICES}:labjack", "docs/stand.md, Software on the PC"),
    "NI": (f"{_DEVICES}:ni", "docs/stand.md, Software on the PC"),
    "calibrations": (f"{_DEVICES}:calibrations", "docs/stand.md, Calibration"),
    "ranges": (f"{_DEVICES}:ranges", ""),
    "real time": (f"{_COMPUTER}:real_time", ""),
    "USB": (f"{_COMPUTER}:usb", ""),
    "disk": (f"{_COMPUTER}:disk", ""),
    "clock": (f"{_COMPUTER}:clock", ""),
}
#: Group of the entry points by which an installed package adds checks; the value of one is such a table.
GROUP = "atpid.checks"
#: The check before which they are made: after those of the core's own devices.
_BEFORE = "calibrations"
_MEANING = {
    Verdict.RIGHT: "the stand can be started",
    Verdict.DEGRADED: "the stand can be started, with what is named",
    Verdict.WOULD_FAIL: "the stand would not start, or would end",
}


def all_checks() -> Checks:
    """Return every check there is, in the order in which they are made; those of other packages by the packages' names.

    A package's check of the same name replaces none. Raises AtpidError naming a package that cannot be loaded.
    """
    added: dict[str, tuple[str, str]] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        try:
            added |= entry.load()
        except ImportError as error:
            raise AtpidError(
                f"the checks of {entry.name} cannot be loaded: {one_line(str(error))}; install it again"
            ) from error
    found: dict[str, tuple[str, str]] = {}
    for name, check in CHECKS.items():
        if name == _BEFORE:
            found |= {other: place for other, place in added.items() if other not in CHECKS}
        found[name] = check
    return found


def examine(subject: Subject, checks: Checks) -> Iterator[Finding]:
    """Yield what the checks of a table find (`all_checks`), in their order."""
    for name, (place, mend) in checks.items():
        for finding in _tried(place, mend, subject):
            yield finding._replace(found=one_line(finding.found), check=name)


def _tried(place: str, mend: str, subject: Subject) -> Iterator[Finding]:
    """Yield what one check finds, up to the error that ends it."""
    try:
        yield from load(place)(subject)
    except AtpidError as error:  # a line of the part that would fail in the run, with what to do
        if str(error) in subject.reported:
            yield Finding(Verdict.NOT_CHECKED, "needs what would fail above")
            return
        subject.reported.add(str(error))
        yield judged(str(error), mend, fails=True)
    except ImportError as error:
        yield judged(str(error), "make setup", fails=True)
    except (NotCheckedError, OSError) as reason:
        yield Finding(Verdict.NOT_CHECKED, str(reason))
    except Exception as error:  # noqa: BLE001 - a check that fails leaves the others
        yield judged(f"the check itself failed: {type(error).__name__}: {error}", "report it", degrades=True)


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
