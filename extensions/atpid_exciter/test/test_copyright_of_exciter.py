# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notices of this package's files, by ament_copyright; ruff and mypy stand for the other linters of ROS."""

from atpid_common.testing import test_every_file_has_its_notice  # noqa: F401  # is a test here too
