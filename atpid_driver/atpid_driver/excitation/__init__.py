# SPDX-License-Identifier: Apache-2.0
"""The exciter's output: one role (`ExcitationDrive`), its backends by name, and the signals they put out."""

from atpid_driver.excitation.drive import ExcitationDrive, SimulatedDrive
from atpid_driver.excitation.settings import BACKENDS, ExcitationSettings

__all__ = ["BACKENDS", "ExcitationDrive", "ExcitationSettings", "drive_of"]


def drive_of(settings: ExcitationSettings) -> ExcitationDrive:
    """Return the backend named in `settings`, unconnected."""
    return SimulatedDrive(settings.limits)
