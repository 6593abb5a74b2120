# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exciter's output: one role (`ExcitationDrive`), its backends by name, and the signals they put out."""

from collections.abc import Callable
from pathlib import Path

from atpid_exciter.excitation.drive import ExcitationDrive, SimulatedDrive
from atpid_exciter.excitation.settings import BACKENDS, ExcitationSettings

__all__ = ["BACKENDS", "ExcitationDrive", "ExcitationSettings", "drive_of"]


def drive_of(settings: ExcitationSettings, calibrations: Callable[[], Path]) -> ExcitationDrive:
    """Return the backend named in `settings`, unconnected; calibrations: returns the folder of the package's files."""
    if settings.backend == "simulated":
        return SimulatedDrive(settings)
    from atpid_exciter.excitation.guarded import GuardedDrive  # here: a simulated bench does not need it

    return GuardedDrive(settings, calibrations())
