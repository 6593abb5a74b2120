# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with a calibration."""

from atpid_common.errors import InputError


class CalibrationError(InputError):
    """A recording that does not tell the beam's parameters, or masses that cannot be."""
