# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the exciter's tests share: the calibration of a stand-in device's output, and the process that owns it."""

from contextlib import suppress
from pathlib import Path

import pytest

from atpid_driver.standins import Control, build
from atpid_driver.standins.device import Outputs, environment


def calibrate(folder: Path, channel: str, unit: str, coefficients: list[float]) -> None:
    """Write output.yaml; coefficients: of the polynomial in volts."""
    (folder / "output.yaml").write_text(
        f"channel: {channel}\nsensor: emulated\nserial: none\ndate: 2026-11-24\nsource: definition\nunit: {unit}\n"
        f"coefficients: {coefficients}\nlimits_volts: [0.0, 5.0]\n"
    )


def calibrate_shaker(folder: Path) -> None:
    """Write output.yaml for 0.02 m/V about 2.5 V."""
    calibrate(folder, "drive_amplitude", "m", [-0.05, 0.02])


def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Outputs:
    """Let both vendors' libraries be stand-ins whose files are in `folder`; return what their devices put out."""
    Control(folder / "control").close()
    files = {f"{name}_{what}": folder / what for name in ("ljm", "daqmx") for what in ("control", "output")}
    for name, value in environment(build(), **files).items():
        monkeypatch.setenv(name, value)
    return Outputs(folder / "output")


def output_process(folder: Path) -> int:
    """Return the number of the process of the output that has opened the device in `folder`; 0: there is none."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it ends just now
            command, maps = (process / "cmdline").read_bytes(), process / "maps"
            if b"excitation.outlet_process" in command and str(folder / "output") in maps.read_text():
                return int(process.name)
    return 0
