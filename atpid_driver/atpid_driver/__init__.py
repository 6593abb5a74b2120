# SPDX-License-Identifier: Apache-2.0
"""The hardware of the tuned particle impact damper: LabJack, NI and motor drivers, calibration, stand-ins."""
