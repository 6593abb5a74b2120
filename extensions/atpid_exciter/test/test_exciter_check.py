# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exciter's check of `atpid doctor`: a T7 that drives an inverter, right, and with one thing wrong."""

import argparse
import os
from pathlib import Path
from typing import Any

import pytest
import yaml
from excitation_rigs import calibrate, calibrate_shaker, stand_in

from atpid_common.errors import AtpidError
from atpid_common.middleware import claimed
from atpid_control.stand.findings import NotCheckedError, Subject, Verdict
from atpid_control.stand.launching.options import add_devices, add_parameters
from atpid_driver.standins import build
from atpid_exciter.part import exciter

CONFIG = Path(__file__).resolve().parents[1] / "config/excitation.yaml"


def subject(folder: Path, config: str = "", **changed: Any) -> Subject:
    """Return the stand that is checked, its settings in a file of the user's, `changed` in the parameter file."""
    files = folder / "excitation.yaml", folder / "parameters.yaml"
    files[0].write_text(config or CONFIG.read_text().replace("backend: simulated", "backend: labjack_dac"))
    own = {"calibration": "output.yaml", "calibration_folder": str(folder)}
    values = own | {"library": str(build() / "libLabJackM.so")} | changed
    files[1].write_text(yaml.dump({"/**/excitation_node": {"ros__parameters": values}}))
    parser = argparse.ArgumentParser()
    add_devices(parser)
    add_parameters(parser)
    options = parser.parse_args(["--excitation-config", str(files[0]), "--params-file", str(files[1])])
    return Subject(argparse.Namespace(**vars(options), port=None, scene=None), folder)


def test_it_is_opened_and_closed_while_off_unless_it_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = stand_in(tmp_path, monkeypatch)
    calibrate(tmp_path, "drive_frequency", "Hz", [0.0, 2.0])
    at = subject(tmp_path)
    calibration, device = exciter(at)
    assert (calibration.verdict, device.verdict) == (Verdict.DEGRADED, Verdict.RIGHT)  # it has no readings
    assert "DAC0 answers" in device.found
    assert outputs.volts(0) == 0.0
    holder = claimed(f"{os.environ['ROS_DOMAIN_ID']}/excitation_node")
    assert holder is not None
    with holder, pytest.raises(NotCheckedError, match="excitation_node"):
        list(exciter(at))
    at.options.excitation_config = None
    with pytest.raises(NotCheckedError, match="--excitation-config"):
        list(exciter(at))


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ("calibration is empty", {"calibration": ""}),
        ("drive_amplitude.*labjack_dac", {}),
        ("0 < lowest < highest", {"lowest_frequency": 90.0}),
        ("lowest_frequency of excitation_node: .*-1", {"lowest_frequency": -1.0}),
        (r"lowest_frequency\?", {"lowest_frequncy": 1.0}),
        ("'highest_amplitude', 'low", {"config": "/**/excitation_node: {ros__parameters: {backend: simulated}}"}),
    ],
    ids=str,
)
def test_one_wrong_thing_is_named(tmp_path: Path, text: str, changed: dict[str, Any]) -> None:
    calibrate_shaker(tmp_path)
    with pytest.raises(AtpidError, match=text):
        list(exciter(subject(tmp_path, **changed)))
