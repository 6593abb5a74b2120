# SPDX-License-Identifier: Apache-2.0
"""The hardware of the Adaptive Tuned Particle Impact Damper: LabJack, NI and Arduino motor drivers, calibration, firmware, and stand-ins for tests."""
