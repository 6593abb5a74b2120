# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tests across packages share. Domain, discovery range and the check for leftovers: atpid_common.testing."""

from pathlib import Path

import pytest
from compiled_once import pytest_configure
from left_out import pytest_sessionfinish

__all__ = ["pytest_configure", "pytest_sessionfinish"]  # hooks

ROOT = Path(__file__).resolve().parent.parent


#: Files that are moved, and the folder whose first test they go before.
MOVED = {"test_batch.py": "atpid_driver", "test_installation.py": "atpid_control"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what takes longest beside other files."""
    moved = {name: [item for item in items if item.path.name == name] for name in MOVED}
    items[:] = [item for item in items if item.path.name not in MOVED]
    for name, folder in MOVED.items():
        places = (place for place, item in enumerate(items) if item.path.relative_to(ROOT).parts[0] == folder)
        place = next(places, len(items))
        items[place:place] = moved[name]


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of the scenes that come with the project."""
    return ROOT / "scenes"
