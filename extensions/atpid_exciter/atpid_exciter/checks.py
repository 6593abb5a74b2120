# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The check of the exciter for `atpid doctor`: settings, calibration, device. Nothing moves."""

from collections.abc import Iterator
from contextlib import closing

from atpid_control.stand.added import EXCITER
from atpid_control.stand.calibration_findings import judged_calibration
from atpid_control.stand.findings import Finding, NotCheckedError, Subject, judged
from atpid_driver.calibration.model import shipped_calibrations
from atpid_exciter.excitation import ExcitationSettings, drive_of
from atpid_exciter.excitation.outlets import calibration_of


def exciter(at: Subject) -> Iterator[Finding]:
    """Check the exciter's settings, its calibration, and its device, which is opened, its output off, and closed."""
    if not at.options.excitation_config:
        raise NotCheckedError("no exciter is driven (--excitation-config)")
    settings = at.settings(ExcitationSettings, EXCITER)
    if settings.backend != "simulated":
        yield judged_calibration(calibration_of(settings, shipped_calibrations()))  # raises CalibrationError
    if EXCITER in at.running():
        raise NotCheckedError(f"{EXCITER} runs: its output would be switched off")
    with closing(drive_of(settings, shipped_calibrations)) as drive:
        yield judged(f"{drive.connect()} answers")  # raises DriverError
