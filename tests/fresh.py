# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The property tests with examples drawn anew, for a bounded time: `python tests/fresh.py SECONDS` (`make fresh`).

What fails is kept in tests/examples and tried first the next time; it is printed as @reproduce_failure as well. The
tests come in another order each time, so that short runs try all of them in the course of time.
"""

import random
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.database import DirectoryBasedExampleDatabase
from parts import FUNCTION, measured

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "tests/examples"


class Bounded:
    """Runs what is cheap in another order each time, and begins none when the time is over."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.end, self.tried, self.found = seconds, 0.0, 0, 0

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        costs = measured()
        items[:] = [item for item in items if costs.get(item.nodeid, 0.0) <= FUNCTION]
        random.SystemRandom().shuffle(items)
        self.found = len(items)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self) -> bool | None:
        """Return True, that is done, for a test that is left out; it is not reported."""
        now = time.monotonic()
        self.end = self.end or now + self.seconds  # from the first test on: imports take as long as they take
        if now > self.end:
            return True
        self.tried += 1
        return None


def property_tests(folder: Path = ROOT) -> list[Path]:
    """Return the files with property tests; those of tests/fuzz are drawn anew by `make fuzz`."""
    places = ("*/test/test_*.py", "*/*/test/test_*.py", "tests/test_*.py", "tests/of_studies/test_*.py")
    files = sorted(path for place in places for path in folder.glob(place))
    return [path for path in files if "@given(" in path.read_text(encoding="utf-8")]


def run(seconds: float, files: Sequence[Path], kept: Path = KEPT) -> int:
    """Run the property tests of `files` for so long [s]; return pytest's exit status."""
    settings.register_profile("fresh", deadline=None, print_blob=True, database=DirectoryBasedExampleDatabase(kept))
    bounded = Bounded(seconds)
    words = ["-q", "-n", "0", "-p", "no:cacheprovider", "-m", "hypothesis", "--hypothesis-profile=fresh"]
    words += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # this file has imported hypothesis
    status = pytest.main([*words, *map(str, files)], plugins=[bounded])
    print(f"fresh examples: {bounded.tried} of {bounded.found} property tests in {seconds:g} s; failing ones in {kept}")
    return int(status)


if __name__ == "__main__":
    sys.exit(run(float(sys.argv[1]), [Path(word) for word in sys.argv[2:]] or property_tests()))
