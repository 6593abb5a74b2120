# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is checked before a stand is run: computer, ROS, devices, calibrations, scene (docs/first_run.md)."""
