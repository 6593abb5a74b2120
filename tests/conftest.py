# SPDX-License-Identifier: Apache-2.0
"""What the tests across packages share. Domain, discovery range and the check for leftovers: atpid_common.testing."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of the scenes that come with the project."""
    return ROOT / "scenes"
