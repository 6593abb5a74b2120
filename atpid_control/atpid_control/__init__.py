# SPDX-License-Identifier: Apache-2.0
"""Identification, height selection, recording, replay and reports of the Adaptive Tuned Particle Impact Damper, with its launch and parameter files."""
