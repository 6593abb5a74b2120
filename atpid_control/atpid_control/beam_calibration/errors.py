# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with a calibration."""


class CalibrationError(ValueError):
    """A recording that does not tell the beam's parameters, or masses that cannot be."""
