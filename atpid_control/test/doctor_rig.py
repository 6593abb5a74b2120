# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stand on which everything is right: a machine's files, parameter files, calibrations, device, emulated board."""

import argparse
import datetime
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from atpid_common.cli import Parser
from atpid_control.commands.doctor import add_arguments
from atpid_control.stand.doctor.checks import CHECKS
from atpid_control.stand.doctor.findings import Finding, Subject, Verdict, examine
from atpid_driver.calibration.model import Calibration, save

#: What a machine's kernel shows where all is well.
MACHINE = {
    "proc/1/comm": "systemd",
    "sys/bus/usb-serial/devices/ttyUSB0/latency_timer": "1",
    "sys/class/net/lo/flags": "0x9",
    "sys/class/net/eth0/flags": "0x1003",
    "etc/udev/rules.d/90-labjack.rules": "",
    "run/systemd/timesync/synchronized": "",
}


def machine(root: Path, changed: Mapping[str, str | None] | None = None) -> Path:
    """Write a machine's files below `root`; `changed`: others, None: not there."""
    for name, text in (MACHINE | dict(changed or {})).items():
        if text is None:
            continue
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def calibration(folder: Path, channel: str, **changed: Any) -> str:
    """Write a calibration of today that sees ±1 m; return its file's name."""
    today = datetime.date.today()
    values: dict[str, Any] = {
        "channel": channel, "sensor": "laser", "serial": "A17", "date": today, "source": "readings", "unit": "m",
        "coefficients": (-1.5, 0.5), "limits_volts": (1.0, 5.0), "residual_std": 1e-4, "readings": 21,
    }  # fmt: skip
    save(Calibration(**values | changed), folder / f"{channel}.yaml")
    return f"{channel}.yaml"


class Stand:
    """A stand in a folder, where `change` makes one thing wrong and `verdicts` is what the checks find."""

    def __init__(self, folder: Path, scene: Path, library: Path, serial: int) -> None:
        self.folder, self.root = folder, machine(folder / "root")
        self.environment = os.environ
        self.options = self.parsed(str(scene), "--bag", str(folder / "bag"), "--hours", "0.1")
        names = [calibration(folder, name) for name in ("support_displacement", "beam_displacement")]
        self.values: dict[str, dict[str, Any]] = {
            "motor_node": {"port": str(folder / "board"), "identify_timeout": 2.0},
            "labjack_node": {"library": str(library), "serial": serial, "calibrations": names,
                             "calibration_folder": str(folder)},
            "supervisor_node": {"beam_displacement_abort": 0.9},
        }  # fmt: skip

    @staticmethod
    def parsed(*words: str) -> argparse.Namespace:
        """Return the options of a command line."""
        parser = Parser()
        add_arguments(parser)
        options: argparse.Namespace = parser.parse_args(list(words))
        return options

    def subject(self, **changed: Any) -> Subject:
        """Return what is checked, its parameters written."""
        file = self.folder / "parameters.yaml"
        file.write_text(yaml.dump({f"/**/{node}": {"ros__parameters": one} for node, one in self.values.items()}))
        self.options.params_file = file
        return Subject(self.options, self.root, **changed)

    def rows(self, *names: str, **changed: Any) -> list[Finding]:
        """Return what the checks of these names find; of none given, all."""
        chosen = {name: place for name, place in CHECKS.items() if not names or name in names}
        return list(examine(self.subject(**changed), chosen))


def problems(rows: list[Finding]) -> list[tuple[Verdict, str]]:
    """Return verdict and text of what is not right."""
    return [(row.verdict, row.found) for row in rows if row.verdict > Verdict.RIGHT]
