# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notices of this package's files, by ament_copyright; ruff and mypy stand for the other linters of ROS."""

from pathlib import Path

from atpid_common.testing import check_notices


def test_every_file_has_its_notice() -> None:
    check_notices(Path(__file__).resolve().parents[1])
