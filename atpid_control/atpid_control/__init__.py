# SPDX-License-Identifier: Apache-2.0
"""Identification, height selection, recording, replay and reports for the tuned particle impact damper."""
