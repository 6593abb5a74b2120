# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid doctor [SCENE]`: what would keep a stand from running, or make its runs worse, and how to mend it.

The table of checks, how each is made, and what they found as a block to paste.
"""

import argparse
import json
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from atpid_common.arguments import file_path, real, word
from atpid_common.cli import load
from atpid_common.entry_points import installed, loaded
from atpid_common.errors import AtpidError, one_line
from atpid_control.stand.findings import Finding, NotCheckedError, Subject, Verdict, judged
from atpid_control.stand.launching.options import add_devices, add_parameters

Checks = Mapping[str, tuple[str, str]]

_DEVICES, _MACHINE = (f"{__package__}.{name}" for name in ("devices", "machine"))
#: By name: where a check is, as "module:function", and what mends it where its error has no remedy. A function takes
#: the Subject and yields what it finds. Each is imported when its turn comes: a package that is missing fails the
#: checks that need it, and no other. The clock is last: it is compared over all the others.
CHECKS: Checks = {
    "packages": (f"{_MACHINE}:packages", "make setup"),
    "workspace": (f"{_MACHINE}:workspace", "make setup, then . ros2_ws/activate"),
    "middleware": (f"{_MACHINE}:middleware", "unset ROS_DOMAIN_ID"),
    "nodes": (f"{_MACHINE}:nodes", ""),
    "scene": (f"{_MACHINE}:scene", "correct the scene (docs/scenes.md)"),
    "parameters": (f"{_MACHINE}:parameters", "correct the file (docs/parameters.md)"),
    "travel": (f"{_DEVICES}:travel", ""),
    "board": (f"{_DEVICES}:board", "docs/stand.md, Firmware"),
    "LabJack": (f"{_DEVICES}:labjack", "docs/stand.md, Software on the PC"),
    "NI": (f"{_DEVICES}:ni", "docs/stand.md, Software on the PC"),
    "calibrations": (f"{_DEVICES}:calibrations", "docs/stand.md, Calibration"),
    "ranges": (f"{_DEVICES}:ranges", ""),
    "real time": (f"{_MACHINE}:real_time", ""),
    "USB": (f"{_MACHINE}:usb", ""),
    "disk": (f"{_MACHINE}:disk", ""),
    "clock": (f"{_MACHINE}:clock", ""),
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
    for point in installed(GROUP).values():
        added |= {name: check for name, check in loaded(point).items() if name not in CHECKS}
    own, place = list(CHECKS.items()), list(CHECKS).index(_BEFORE)
    return dict([*own[:place], *added.items(), *own[place:]])


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


EXAMPLE = "scenes/stand_realtime.yaml --port /dev/ttyACM0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, nargs="?", help="scene file of the run; not given: its checks are left out")
    add("--port", type=word, help="serial port of the board; default: that of the motor's parameters")
    add("--map", type=file_path, metavar="MAP.npz", help="height map of the run; not given: it is not checked")
    add_devices(parser)
    add_parameters(parser)
    add("--bag", type=file_path, help="folder of the bag to make: its disk is checked; default: this folder's")
    add("--hours", type=real(0.0, 1e5, "h", above=True), default=1.0, help="length of the recording; default: 1")
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Make the checks and print them; return 0, 1 where a run would be degraded, 2 where it would fail."""
    found = list(examine(Subject(args), all_checks()))
    status = verdict_of(found)
    plain = [finding._asdict() | {"verdict": finding.verdict.word} for finding in found]
    print(json.dumps({"verdict": status.word, "checks": plain}, indent=2) if args.json else block(found))
    return int(status)
