# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The integration that promises of designs are checked by, against scipy's; and the study that uses it."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from atpid_control.design.problem import NOMINAL, problem_of
from studies import damped_structure, designs
from studies.cli import main

HORIZONTAL = {
    "mass": 1.5, "frequency": 10.0, "damping": 0.03, "amplitudes": (0.001, 0.002), "gravity": 0.0,
    "restitution": 0.4,
}  # fmt: skip


def test_the_restitution_is_the_one_asked_for() -> None:
    p = damped_structure.physics(problem_of(**HORIZONTAL), 0.1, 0.002, NOMINAL, None)
    for speed in (0.1, 3.0):
        assert damped_structure.rebound(p.reduced, p.contact, p.loss, speed)[0] == pytest.approx(0.4, abs=2e-3)


TWO = HORIZONTAL | {
    "amplitudes": (1.0, 8.0), "drive": "force",
    "further_modes": [{"mass": 4.0, "frequency": 35.0, "damping_ratio": 0.02, "drive_factor": -0.5}],
}  # fmt: skip


@pytest.mark.parametrize(("options", "amplitude"), [(HORIZONTAL, 0.002), (TWO, 6.0)])
def test_a_run_is_that_of_scipy_with_both_contacts_as_they_are(options: dict[str, Any], amplitude: float) -> None:
    p = damped_structure.physics(problem_of(**options), 0.1, amplitude, NOMINAL, None)
    closed, count = damped_structure.steady(p, p.grain), len(p.mass)
    height, period = p.diameter + 0.5 * math.pi * abs(closed.sum()), 2.0 * math.pi / p.omega

    def law(overlap: float, rate: float) -> float:
        return max(0.0, p.contact * overlap**1.5 + p.loss * rate * overlap**0.25) if overlap > 0.0 else 0.0

    def slope(t: float, y: np.ndarray) -> list[float]:
        q, rates, (grain, speed) = y[:count], y[count : 2 * count], y[2 * count :]
        beam, velocity = q.sum(), rates.sum()
        floor = law(beam - grain, velocity - speed)
        ceiling = law(p.diameter + grain - beam - height, speed - velocity)
        u, rate = p.amplitude * math.sin(p.omega * t), p.amplitude * p.omega * math.cos(p.omega * t)
        pulled = p.direct * u + p.rate * rate - p.stiffness * q - p.damping * rates - floor + ceiling
        return [*rates, *(pulled / p.mass), speed, (floor - ceiling) / p.grain]

    q, rates = closed.imag, p.omega * closed.real
    start = np.array([*q, *rates, q.sum(), rates.sum()])
    end = 9.0 * period
    found = solve_ivp(slope, (0.0, end), start, method="DOP853", rtol=1e-9, atol=1e-11, max_step=5e-4,
                      t_eval=np.linspace(end - 2.0 * period, end, 4001))  # fmt: skip
    low, high, *_ = damped_structure.integrate(p, start, height, -1.0, 1e-6, end, 2e-6, 2)
    beam = found.y[:count].sum(axis=0)
    assert low == pytest.approx(beam.min(), rel=3e-3)
    assert high == pytest.approx(beam.max(), rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("modal", [False, True])
def test_reductions_agree_with_the_packages(modal: bool) -> None:
    found = designs.compare(3, 7, modal)
    assert found.regular >= 1
    assert np.median(found.difference) < 1e-3
    # of random structures some are close to where their motion changes: docs/design_check.md has how many
    assert np.count_nonzero(found.difference > 0.01) <= 1
    assert found.difference.max() < 0.03
    assert found.bare < 1e-3


@pytest.mark.slow
def test_the_command_prints_its_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(designs, "STRUCTURES", {"a bracket": (HORIZONTAL, 0.1)})
    monkeypatch.setattr(designs, "_SYSTEMS", 3)
    page = tmp_path / "check.md"
    assert main(["designs", "--draws", "6", "--seed", "1", "--points", "2", "--page", str(page)]) == 0
    assert "| a bracket | " in capsys.readouterr().out
    assert " | 6 of 6 | " in page.read_text(encoding="utf-8")
