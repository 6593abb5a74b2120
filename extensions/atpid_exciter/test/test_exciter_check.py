# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exciter's check of `atpid doctor`: a T7 that drives an inverter, right, and with one thing wrong."""

import argparse
import datetime
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from atpid_common.claim import claimed
from atpid_common.errors import AtpidError
from atpid_control.stand.findings import NotCheckedError, Subject, Verdict
from atpid_control.stand.launching.options import add_devices, add_parameters
from atpid_driver.calibration.model import Calibration, save
from atpid_driver.standins import Control, build
from atpid_driver.standins.control import SERIAL
from atpid_driver.standins.outputs import Outputs
from atpid_exciter.checks import exciter

CONFIG = Path(__file__).resolve().parents[1] / "config/excitation.yaml"


@pytest.fixture(autouse=True)
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Outputs]:
    control = Control(tmp_path / "device")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(control.path))
    monkeypatch.setenv("ATPID_LJM_OUTPUT", str(tmp_path / "output"))
    yield Outputs(tmp_path / "output")
    control.close()


def calibrated(folder: Path, channel: str, unit: str) -> None:
    """Write a calibration of today."""
    values: dict[str, Any] = {"channel": channel, "sensor": "inverter", "serial": "A17", "source": "readings"}
    values |= {"date": datetime.date.today(), "unit": unit, "coefficients": (0.0, 2.0), "limits_volts": (0.0, 5.0)}
    save(Calibration(**values, residual_std=1e-4, readings=21), folder / f"{channel}.yaml")


def subject(folder: Path, *, config: str | None = None, **changed: Any) -> Subject:
    """Return the stand that is checked, its settings in a file of the user's, `changed` in the parameter file."""
    (folder / "excitation.yaml").write_text(
        config or CONFIG.read_text().replace("backend: simulated", "backend: labjack_dac")
    )
    calibrated(folder, "drive_frequency", "Hz")
    calibrated(folder, "beam_displacement", "m")
    own = {"calibration": "drive_frequency.yaml", "calibration_folder": str(folder)}
    values = own | {"library": str(build() / "libLabJackM.so")} | changed
    (folder / "parameters.yaml").write_text(yaml.dump({"/**/excitation_node": {"ros__parameters": values}}))
    parser = argparse.ArgumentParser()
    add_devices(parser)
    add_parameters(parser)
    words = ["--excitation-config", str(folder / "excitation.yaml"), "--params-file", str(folder / "parameters.yaml")]
    return Subject(argparse.Namespace(**vars(parser.parse_args(words)), port=None, scene=None), folder)


def test_it_is_opened_and_closed_with_its_output_off_unless_it_runs(tmp_path: Path, device: Outputs) -> None:
    at = subject(tmp_path)
    found = list(exciter(at))
    assert [finding.verdict for finding in found] == [Verdict.RIGHT] * 2
    assert f"labjack:{SERIAL} DAC0" in found[1].found
    assert device.volts(0) == 0.0
    holder = claimed(f"{os.environ['ROS_DOMAIN_ID']}/excitation_node")
    assert holder is not None
    with holder, pytest.raises(NotCheckedError, match="excitation_node"):
        list(exciter(at))
    at.options.excitation_config = None
    with pytest.raises(NotCheckedError, match="--excitation-config"):
        list(exciter(at))


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"calibration": ""}, "calibration is empty"),
        ({"calibration": "beam_displacement.yaml"}, "beam_.*labjack_dac"),
        ({"lowest_frequency": 90.0}, "0 < lowest < highest"),
        ({"lowest_frequency": -1.0}, "lowest_frequency of excitation_node: .*-1"),
        ({"lowest_frequncy": 1.0}, r"lowest_frequency\?"),
        (
            {"config": "/**/excitation_node: {ros__parameters: {backend: simulated}}"},
            "'highest_amplitude', 'lowest_frequency', and 'highest_frequency'",
        ),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_one_wrong_thing_is_named(tmp_path: Path, changed: dict[str, Any], text: str) -> None:
    with pytest.raises(AtpidError) as error:
        list(exciter(subject(tmp_path, **changed)))
    assert re.search(text, str(error.value))
