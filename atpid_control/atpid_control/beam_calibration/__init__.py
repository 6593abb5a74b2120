# SPDX-License-Identifier: Apache-2.0
"""Stiffness, damping and mass of the beam from a recorded decay or sweep (the thesis leaves this as future work).

Support and beam displacement determine natural frequency and decay, that is the ratios k/m and c/m, but not the three
parameters. One mass has to be given: the whole moving mass, or one that was added for a second recording.
"""

from atpid_control.beam_calibration.fit import BeamFit, fit_beam
from atpid_control.beam_calibration.masses import BeamParameters, from_added_mass, from_known_mass
from atpid_control.beam_calibration.recording import CalibrationError, Recording, read_recording

__all__ = [
    "BeamFit", "BeamParameters", "CalibrationError", "Recording", "fit_beam", "from_added_mass", "from_known_mass",
    "read_recording",
]  # fmt: skip
