# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a check of `atpid doctor` finds, and what it looks at: a machine, whose files may be others, and a stand.

A package adds checks by an entry point of the group `atpid.checks`: a table like that of `atpid_campaign.doctor`.
"""

from __future__ import annotations

import argparse
import datetime
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from atpid_common.errors import did_you_mean

if TYPE_CHECKING:
    from atpid_control.stand.parameters import Parameters
    from atpid_driver.calibration.model import Calibration
    from atpid_sim.scene import Scene

T = TypeVar("T")


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
        from atpid_control.stand.parameters import BenchError, combined
        from atpid_control.stand.parts import SUPERVISOR, devices_of

        usual = {part.name: part.configured() for part in (*devices_of(self.options), SUPERVISOR)}
        port = {"motor_node": {"port": self.options.port}} if self.options.port else {}
        for node, name, value in ((node, *item) for node, values in self.given.items() for item in values.items()):
            known, given = usual.get(node, {}).get(name, value), f"{name} of {node}"
            if type(value) is not type(known):  # rcl converts nothing: 100 is no number of type double
                raise BenchError(f"{given}: given {value!r}; allowed: a {type(known).__name__}, like {known!r}")
            if problem := _problem(node, name, value):
                raise BenchError(f"{given}: {problem}")
        return combined(usual, port, self.given)

    def settings(self, kind: type[T], node: str) -> T:
        """Return a device's settings, an object of the dataclass `kind`, from the parameters of its node.

        Raises DriverError for an invalid one, BenchError where one is missing.
        """
        from atpid_control.stand.parameters import BenchError

        values, own = self.parameters[node], fields(kind)  # type: ignore[arg-type]
        try:
            return kind(**{one.name: values[one.name] for one in own if one.init and one.name in values})
        except TypeError as error:
            raise BenchError(f"{node}: {error}; give them in its parameter file") from None

    def running(self) -> list[str]:
        """Return the nodes of the stand that run already in this domain on this machine."""
        from atpid_common.middleware import claimed, named_domain
        from atpid_control.stand.parts import REAL_TIME_PARTS, devices_of

        found = []
        for name in dict.fromkeys(part.name for part in (*devices_of(self.options), *REAL_TIME_PARTS)):
            if (holder := claimed(f"{named_domain() or 0}/{name}")) is None:
                found.append(name)
            else:
                holder.close()
        return found


def _problem(node: str, name: str, value: object) -> str:
    """Return what the node would refuse, in words: a name it does not have, a value outside its range; else ""."""
    from atpid_common.nodes.node_main import PARAMETERS
    from atpid_control.nodes.parameter_tables import IDENTIFIER, SELECTOR
    from atpid_control.nodes.recorder_parameters import OF_RCLPY
    from atpid_control.stand.parts import EXCITER, table_of
    from atpid_control.supervision.limits import SUPERVISOR
    from atpid_driver.nodes import motor_interface

    own = {
        "identifier_node": IDENTIFIER,
        "selector_node": SELECTOR,
        "supervisor_node": SUPERVISOR,
        "motor_node": motor_interface.TABLE,
    }
    if node == EXCITER:
        own[node] = table_of(node)
    rows = {row.name: row for row in (*own.get(node, ()), *PARAMETERS)}
    if name in rows:
        return rows[name].problem(value)
    known = node not in own or name in OF_RCLPY or name.startswith(OF_RCLPY[-1])
    return "" if known else f"the node has none of this name{did_you_mean(name, rows)}"


#: A calibration is made anew after this many days; readings that one needs; its residual over its range [-].
_OLD, _READINGS, _RESIDUAL = 365, 7, 0.01
#: Units by the end of a channel's name.
_UNITS = {"displacement": "m", "acceleration": "m/s^2", "force": "N"}


def reach_of(one: Calibration) -> float:
    """Return half the range of a calibration, in its unit."""
    import numpy as np

    from atpid_driver.calibration.model import si_of

    low, high = si_of(one, np.array(one.limits_volts))[0]
    return abs(float(high - low)) / 2.0


def judged_calibration(one: Calibration) -> Finding:
    """Return what is found on a calibration: of the right unit, young, from readings."""
    unit = next((unit for end, unit in _UNITS.items() if one.channel.endswith(end)), one.unit)
    age, reach = (datetime.date.today() - one.date).days, reach_of(one)
    nominal, few = one.source.startswith("nominal"), one.readings < _READINGS
    problems = {
        f"needed: {unit}": unit != one.unit,
        "made in the future: one of the two dates is wrong": age < -1,
        f"{age} days old": age > _OLD,
        "nominal figures of the data sheet": nominal,
        "few or bad readings": not nominal and (few or (one.residual_std or 0.0) > _RESIDUAL * reach),
    }
    about = f"{one.sensor} {one.serial}, {one.date}, ±{reach:.3g} {one.unit}, {one.readings} readings"
    text = "; ".join([f"{one.channel}: {about}", *(name for name, there in problems.items() if there)])
    mend, fails = "atpid calibrate sensor (docs/stand.md, Calibration)", unit != one.unit or age < -1
    return judged(text, mend, fails=fails, degrades=any(problems.values()))
