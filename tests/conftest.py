# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tests across packages share. Domain, discovery range and the check for leftovers: atpid_common.testing."""

from pathlib import Path

import compiled_once
import costs
import parts
import pytest
from left_out import pytest_sessionfinish

__all__ = ["pytest_sessionfinish"]  # a hook

ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config: pytest.Config) -> None:
    """Compile a kernel in one worker at a time, and measure what tests cost where `make costs` runs them."""
    compiled_once.install()
    costs.install(config)
    config.addinivalue_line("markers", "rest: left to `make test-all`, by what it costs (tests/parts.py)")


@pytest.hookimpl(tryfirst=True)  # before `-m` looks at the marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Part the tests between `make test` and `make test-all`."""
    parts.mark(items)


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of the scenes that come with the project."""
    return ROOT / "scenes"
