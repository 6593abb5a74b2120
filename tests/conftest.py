# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tests across packages share. Domain, discovery range and the check for leftovers: atpid_common.testing."""

from pathlib import Path

import pytest
from left_out import pytest_sessionfinish

__all__ = ["pytest_sessionfinish"]  # a hook

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what takes longest before the last package, so that the others run beside it and not before it."""
    longest = [item for item in items if item.path.name == "test_installation.py"]
    others = [item for item in items if item.path.name != "test_installation.py"]
    places = (place for place, item in enumerate(others) if "atpid_control" in item.path.parts)
    place = next(places, len(others))
    items[:] = [*others[:place], *longest, *others[place:]]


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of the scenes that come with the project."""
    return ROOT / "scenes"
