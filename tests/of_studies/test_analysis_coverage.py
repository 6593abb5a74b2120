# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The error bars of orders and frequency response hold the truth under noise of any memory, and friction is named."""

import pytest

from studies.identification.analysis_coverage import friction_named, main, orders_held, response_held


@pytest.mark.parametrize("memory", [0.0, 0.99])
def test_the_intervals_of_orders_hold_whatever_the_noise_remembers(memory: float) -> None:
    assert orders_held(memory, 1.2, 40, 2) > 0.89


@pytest.mark.parametrize(("memory", "at_input"), [(0.9, False), (0.0, True)])
def test_the_intervals_of_a_response_hold_beside_a_resonance(memory: float, at_input: bool) -> None:
    assert min(response_held(memory, at_input, 60.0, 4, 2)) > 0.92


def test_friction_is_named_and_viscous_damping_is_not() -> None:
    assert friction_named(0.005, 0.0, 4, 2) == 1.0
    assert friction_named(0.0, 0.9, 4, 2) == 0.0


def test_the_command_prints_its_table(capsys: pytest.CaptureFixture[str]) -> None:
    main(1, 1)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("| 1 signals a figure, seed 1 |")
    assert len(lines) == 15
    assert {line.count("|") for line in lines} == {5}
