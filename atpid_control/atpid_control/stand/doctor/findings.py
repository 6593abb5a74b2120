# SPDX-License-Identifier: Apache-2.0
"""What a check finds, and what it looks at: a machine, whose folders and variables may be others, and a stand."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from atpid_common.cli import load
from atpid_common.errors import AtpidError, one_line

if TYPE_CHECKING:
    from atpid_sim.scene import Scene


class Verdict(IntEnum):
    """Of one finding; of several the largest counts. Of `DEGRADED` and `WRONG` it is the command's exit status."""

    NOT_CHECKED = -1
    RIGHT = 0
    DEGRADED = 1
    WRONG = 2

    @property
    def word(self) -> str:
        """The verdict as it is printed."""
        return ("right", "degraded", "would fail", "not checked")[self]


class Finding(NamedTuple):
    """What was found, and how to mend it where that is needed."""

    verdict: Verdict
    found: str
    mend: str = ""


def judged(found: str, mend: str = "", *, fails: bool = False, degrades: bool = False) -> Finding:
    """Return a finding: `fails` where it would keep a run from beginning or end it, `degrades` where it spoils one."""
    verdict = Verdict.WRONG if fails else Verdict.DEGRADED if degrades else Verdict.RIGHT
    return Finding(verdict, found, mend if verdict else "")


class NotCheckedError(Exception):
    """What a check needs is not there, which another check reports."""


@dataclass
class Subject:
    """The machine and the stand that are checked; nothing is read before a check asks for it."""

    options: argparse.Namespace  # of `atpid doctor`
    root: Path = Path("/")  # of the files that describe the machine
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ)
    begun: tuple[int, int] = field(default_factory=lambda: (time.time_ns(), time.monotonic_ns()))  # wall, steady

    def text(self, path: str) -> str:
        """Return a file of the machine without the blanks around it; "" where there is none."""
        try:
            return (self.root / path).read_text(errors="replace").strip()
        except OSError:
            return ""

    def has(self, path: str) -> bool:
        """Return whether a file of the machine is there."""
        return (self.root / path).exists()

    def files(self, pattern: str) -> list[Path]:
        """Return the machine's files of a pattern."""
        return sorted(self.root.glob(pattern))

    def read_scene(self) -> Scene | None:
        """Read the scene; None: none was given. Raises SceneError."""
        from atpid_sim.scene import load_scene

        return load_scene(self.options.scene) if self.options.scene else None

    def read_parameters(self) -> dict[str, dict[str, Any]]:
        """Read what the devices' nodes would start with. Raises AtpidError."""
        from atpid_control.stand.parameters import combined, read_parameters
        from atpid_control.stand.parts import NAMES, SUPERVISOR, devices_of

        given = read_parameters(self.options.params_file, NAMES) if self.options.params_file else {}
        usual = {part.name: part.configured() for part in (*devices_of(self.options), SUPERVISOR)}
        port = {"motor_node": {"port": self.options.port}} if self.options.port else {}
        return combined(usual, port, given)

    @cached_property
    def scene(self) -> Scene:
        """The scene. Raises NotCheckedError."""
        with suppress(AtpidError):
            if (found := self.read_scene()) is not None:
                return found
        raise NotCheckedError("no scene was given, or it cannot be read")

    @cached_property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Parameters by node. Raises NotCheckedError."""
        with suppress(AtpidError):
            return self.read_parameters()
        raise NotCheckedError("the parameters cannot be read")


class Row(NamedTuple):
    """A finding, with the name of its check and of the group that belongs to."""

    group: str
    name: str
    finding: Finding


#: The checks by group and name: where each is, as "module:function", and what mends it where its error has no remedy.
#: A function takes the Subject and yields what it finds. Each is imported when its turn comes: a package that is
#: missing fails the checks that need it, and no other.
Checks = Mapping[str, Mapping[str, tuple[str, str]]]


def examine(subject: Subject, checks: Checks) -> Iterator[Row]:
    """Yield what the checks find, in their order."""
    for group, named in checks.items():
        for name, (place, mend) in named.items():
            yield from (Row(group, name, found._replace(found=one_line(found.found)))
                        for found in _tried(place, mend, subject))  # fmt: skip


def _tried(place: str, mend: str, subject: Subject) -> Iterable[Finding]:
    """Return what one check finds, up to the error that ends it."""
    found: list[Finding] = []
    try:
        found.extend(load(place)(subject))
    except AtpidError as error:  # a line of the part that would fail in the run, with what to do
        found.append(judged(str(error), mend, fails=True))
    except ImportError as error:
        found.append(judged(str(error), "make setup", fails=True))
    except (NotCheckedError, OSError) as reason:
        found.append(Finding(Verdict.NOT_CHECKED, str(reason)))
    return found
