# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies modes`: random structures of several modes beside scipy's integration."""

import json

import pytest

from studies.cli import main


def test_a_structure_beside_scipy(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", "--systems", "3", "--seed", "11", "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert len(compared) == 3
    assert all(one["residual"] < 2e-6 and one["modes"] > 1 for one in compared)
    same = [one for one in compared if one["spread"] < 5e-4]
    assert same
    assert all(one["amplitude"] == pytest.approx(one["naive"], rel=2e-3) for one in same)


def test_the_tables_show_what_a_mode_costs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", "--systems", "1", "--seed", "11"]) == 0
    shown = capsys.readouterr().out
    assert "of these within 0.2 % of scipy's" in shown
    assert "cost of a run of 80 s" in shown
