# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a check finds, and what it looks at: a machine, whose files may be others, and a stand."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from atpid_common.cli import load
from atpid_common.errors import AtpidError, did_you_mean, one_line

if TYPE_CHECKING:
    from atpid_control.stand.parameters import Parameters
    from atpid_sim.scene import Scene


class Verdict(IntEnum):
    """Of one finding; of several the largest counts, which is the command's exit status."""

    NOT_CHECKED = -1
    RIGHT = 0
    DEGRADED = 1
    WOULD_FAIL = 2

    @property
    def word(self) -> str:
        """The verdict as it is printed."""
        return self.name.lower().replace("_", " ")


class Finding(NamedTuple):
    """What was found, how to mend it where that is needed, and by which check."""

    verdict: Verdict
    found: str
    mend: str = ""
    check: str = ""


def judged(found: str, mend: str = "", *, fails: bool = False, degrades: bool = False) -> Finding:
    """Return a finding: `fails` where it would keep a run from beginning or end it, `degrades` where it spoils one."""
    verdict = Verdict.WOULD_FAIL if fails else Verdict.DEGRADED if degrades else Verdict.RIGHT
    return Finding(verdict, found, mend if verdict else "")


class NotCheckedError(Exception):
    """What a check needs is not there."""


@dataclass
class Subject:
    """The machine and the stand that are checked; nothing is read before a check asks for it."""

    options: argparse.Namespace  # of `atpid doctor`
    root: Path = Path("/")  # of the files that describe the machine
    begun: tuple[int, int] = field(default_factory=lambda: (time.time_ns(), time.monotonic_ns()))  # wall, steady
    reported: set[str] = field(default_factory=set)  # errors that are among the findings

    def files(self, pattern: str) -> list[Path]:
        """Return the machine's files of a pattern."""
        return sorted(self.root.glob(pattern))

    def texts(self, pattern: str) -> Iterator[tuple[Path, str]]:
        """Yield those that can be read, with their text; that of a process that has ended cannot."""
        for path in self.files(pattern):
            with suppress(OSError):
                yield path, path.read_text().strip()

    @cached_property
    def scene(self) -> Scene:
        """The scene. Raises NotCheckedError: none was given; SceneError."""
        from atpid_sim.scene import load_scene

        if self.options.scene is None:
            raise NotCheckedError("no scene was given")
        return load_scene(self.options.scene)

    @cached_property
    def given(self) -> Parameters:
        """The values of the user's parameter file. Raises AtpidError."""
        from atpid_control.stand.parameters import read_parameters
        from atpid_control.stand.parts import NAMES

        return read_parameters(self.options.params_file, NAMES) if self.options.params_file else {}

    @cached_property
    def parameters(self) -> Parameters:
        """What the devices' nodes and the supervisor would start with. Raises AtpidError."""
        from atpid_control.stand.errors import BenchError
        from atpid_control.stand.parameters import combined
        from atpid_control.stand.parts import SUPERVISOR, devices_of

        usual = {part.name: part.configured() for part in (*devices_of(self.options), SUPERVISOR)}
        port = {"motor_node": {"port": self.options.port}} if self.options.port else {}
        for node, name, value in ((node, *item) for node, values in self.given.items() for item in values.items()):
            known = usual.get(node, {}).get(name, value)
            if type(value) is not type(known):  # rcl converts nothing: 100 is no number of type double
                raise BenchError(
                    f"{name} of {node}: given {value!r}; allowed: a {type(known).__name__}, like {known!r}"
                )
            if problem := _problem(node, name, value):
                raise BenchError(f"{name} of {node}: {problem}")
        return combined(usual, port, self.given)


def _problem(node: str, name: str, value: Any) -> str:
    """Return what the node would refuse, in words: a name it does not have, a value outside its range; else ""."""
    from atpid_common.nodes.node_main import PARAMETERS
    from atpid_control.nodes.parameter_tables import IDENTIFIER, SELECTOR, SUPERVISOR
    from atpid_control.nodes.recorder_parameters import OF_RCLPY
    from atpid_driver.nodes import excitation_node, motor_interface

    own = {"identifier_node": IDENTIFIER, "selector_node": SELECTOR, "supervisor_node": SUPERVISOR,
           "motor_node": motor_interface.TABLE, "excitation_node": excitation_node.TABLE}  # fmt: skip
    rows = {row.name: row for row in (*own.get(node, ()), *PARAMETERS)}
    if name in rows:
        return rows[name].problem(value)
    known = node not in own or name in OF_RCLPY or name.startswith(OF_RCLPY[-1])
    return "" if known else f"the node has none of this name{did_you_mean(name, rows)}"


def examine(subject: Subject, checks: Mapping[str, tuple[str, str]]) -> Iterator[Finding]:
    """Yield what the checks of a table find (`checks.CHECKS`), in their order."""
    for name, (place, mend) in checks.items():
        for finding in _tried(place, mend, subject):
            yield finding._replace(found=one_line(finding.found), check=name)


def _tried(place: str, mend: str, subject: Subject) -> Iterator[Finding]:
    """Yield what one check finds, up to the error that ends it."""
    try:
        yield from load(f"{__package__}.{place}")(subject)
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
