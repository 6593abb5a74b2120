# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/parameters.md and the parameter files are what the nodes declare."""

from pathlib import Path

import pytest
import yaml
from rclpy.parameter import Parameter

from studies.parameters import CHOSEN, DEFAULTS, SECTIONS, markdown, page, parameter_file

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


def test_a_table_or_file_that_is_out_of_date_is_made_anew(root: Path) -> None:
    text = (root / "docs" / "parameters.md").read_text()
    damaged = text.replace("| 0.15 to 10 |", "||")
    assert text != damaged
    assert page(damaged) == text
    name = "atpid_control/config/selector.yaml"
    text = (root / name).read_text()
    assert parameter_file(name, text.replace("sigmas: 4.0", "sigmas: 3.0").replace("  # relative", "  # about")) == text


def test_every_default_is_allowed_and_every_row_explained() -> None:
    rows = [row for table in SECTIONS.values() for row in table]
    given = [row for row in rows if not isinstance(row.default, Parameter.Type)]
    assert [row.name for row in given if row.problem(row.default)] == []
    assert [row.name for row in rows if not row.description] == []
