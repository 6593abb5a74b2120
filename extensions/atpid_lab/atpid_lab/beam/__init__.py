# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stiffness, damping and mass of the beam from a recorded decay or sweep (the thesis leaves this as future work).

Support and beam displacement determine natural frequency and decay, that is the ratios k/m and c/m, but not the three
parameters. One mass has to be given: the whole moving mass, or one that was added for a second recording.
"""
