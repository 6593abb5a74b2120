# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tests and their maintainers use: the list of what CI leaves out, fresh examples, benchmark, stubs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from benchmark import parts
from left_out import ALLOWED
from message_stubs import STUBS, stubs

from studies.parameters import CHOSEN, DEFAULTS, SECTIONS, markdown, page, parameter_file

TESTS = Path(__file__).parent


def run(*words: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    environment = os.environ | {"PYTHONPATH": f"{TESTS}:{os.environ.get('PYTHONPATH', '')}"} | variables
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize(("reason", "workers", "status"), [("the moon is full", "1", 1), (next(iter(ALLOWED)), "0", 0)])
def test_what_is_not_on_the_list_fails_in_ci(tmp_path: Path, reason: str, workers: str, status: int) -> None:
    (tmp_path / "test_one.py").write_text(f"import pytest\n\ndef test_it():\n    pytest.skip({reason!r})\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    words = ["-m", "pytest", "-p", "left_out", "-p", "xdist", "-n", workers, str(tmp_path)]
    done = run(*words, CI="true", PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")
    assert done.returncode == status, done.stdout
    assert ("left_out.py" in done.stdout) == bool(status)
    assert reason in done.stdout or not status


@pytest.mark.skipif(not os.environ.get("CI"), reason="left to chance: in CI only; `make fresh`")
def test_fresh_examples_of_the_property_tests_pass() -> None:
    done = run(str(TESTS / "fresh.py"), "10")
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-2000:]
    tried, found = re.findall(r"\d+", done.stdout.splitlines()[-1])[:2]
    assert 1 <= int(tried) <= int(found) > 20  # property tests


def test_each_part_of_the_benchmark_has_a_ratio(tmp_path: Path) -> None:
    measured = parts(tmp_path, 2.0)
    assert len({part.name for part in measured}) == 4
    assert all(part.real > 0.0 and part.processor > 0.0 for part in measured)


def test_the_stubs_of_the_messages_are_those_of_the_definitions() -> None:
    made = stubs()
    assert {name: (STUBS / name).read_text() for name in made} == made, "anew: python tests/message_stubs.py"


REMEDY = "; make it anew: python -m studies parameters"


def test_the_page_is_what_the_command_writes(root: Path) -> None:
    text = (root / "docs" / "parameters.md").read_text()
    assert [heading for heading in SECTIONS if f"\n## {heading}\n" not in text] == []
    assert [heading for heading, table in SECTIONS.items() if markdown(table) not in text] == []
    assert page(text) == text, f"docs/parameters.md{REMEDY}"


@pytest.mark.parametrize("name", [*DEFAULTS, *CHOSEN])
def test_a_parameter_file_is_what_the_command_writes(root: Path, name: str) -> None:
    text = (root / name).read_text()
    assert parameter_file(name, text) == text, f"{name}{REMEDY}"
    (values,) = yaml.safe_load(text).values()
    table = {row.name: row for row in (DEFAULTS | CHOSEN)[name]}
    assert [key for key, value in values["ros__parameters"].items() if table[key].problem(value)] == []


def test_every_default_is_allowed_and_every_row_explained() -> None:
    rows = [row for table in SECTIONS.values() for row in table]
    given = [row for row in rows if not isinstance(row.default, type)]
    assert [row.name for row in given if row.problem(row.default)] == []
    assert [row.name for row in rows if not row.description] == []
