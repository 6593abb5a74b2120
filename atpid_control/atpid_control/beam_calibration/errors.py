# SPDX-License-Identifier: Apache-2.0
"""Errors of a calibration."""

from atpid_common.errors import InputError


class CalibrationError(InputError):
    """A recording that does not determine the beam's parameters, or impossible masses."""
