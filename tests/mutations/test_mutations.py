# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The list that `make mutations` tries keeps to the files: each change can be made, its tests are there."""

import subprocess
import sys
from collections import Counter

import pytest
from mutation import ROOT, Mutation, MutationError, listed

MUTATIONS = listed()


def problem(mutation: Mutation) -> str:
    try:
        mutation.applied((ROOT / mutation.file).read_text())
    except (MutationError, OSError) as error:
        return str(error)
    return "" if mutation.tests else f"{mutation.name}: no test is named"


def test_each_can_be_made_in_one_place() -> None:
    assert [line for line in map(problem, MUTATIONS) if line] == []


def test_the_tests_that_they_name_are_there() -> None:
    names = sorted({name for mutation in MUTATIONS for name in mutation.tests})
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-c", "pyproject.toml", *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, [line for line in done.stdout.splitlines() if "not found" in line]


def test_each_has_a_name_of_its_own() -> None:
    assert [name for name, count in Counter(mutation.name for mutation in MUTATIONS).items() if count > 1] == []


@pytest.mark.parametrize(("old", "new"), [("not there", "x"), ("twice", "x"), ("once", "once"), ("once", "(")], ids=str)
def test_one_that_cannot_be_made_is_named(old: str, new: str) -> None:
    with pytest.raises(MutationError, match=r"^a name: some\.py "):
        Mutation("a name", "some.py", old, new, (), "").applied("once = twice = twice\n")
