# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on many windows of one run: those of single runs, each part computed once."""

import pytest

from atpid_sim.engine import columns
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.reproducibility import Verdict, judge
from atpid_sim.simulation.simulate import simulate, verdicts

#: Regular at 0.2 m, irregular at 0.35 m, regular again.
PROFILE = [[0.0, 0.2], [12.0, 0.2], [12.5, 0.35], [24.0, 0.35], [24.5, 0.2], [36.0, 0.2]]
WINDOWS = [(10.0, 12.0), (22.0, 24.0), (34.0, 36.0)]


def changing() -> Scene:
    return standard_bench(ceiling={"profile": PROFILE}, duration=36.0, tolerance=1e-4, steady_window=[34.0, 36.0])


def test_one_window_is_judged_as_a_run() -> None:
    scene = standard_bench(tolerance=1e-5)
    verdict, result = verdicts(scene, [scene.steady_window])[0], simulate(scene)
    assert verdict is not None
    assert (verdict.reproducible, verdict.spread) == (result.reproducible, result.spread)
    assert verdict.error < 1e-4


def test_the_irregular_window_is_named_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    spans: list[tuple[float, float]] = []

    def noted(integration: Integration, amplitude: float, steps: int, *errors: float) -> Verdict:
        spans.append((integration.table[0, columns.START], integration.table[-1, columns.END]))
        return judge(integration, amplitude, steps, *errors)

    monkeypatch.setattr("atpid_sim.simulation.simulate.judge", noted)
    found = verdicts(changing(), WINDOWS)
    assert [verdict is not None and verdict.reproducible for verdict in found] == [True, False, True]
    assert found[1] is not None
    assert found[1].spread is not None
    assert spans == [(0.0, 12.0), (12.0, 24.0), (24.0, 36.0)]  # no part of the run is repeated for another's window


def test_a_still_window_has_no_amplitude_to_judge() -> None:
    scene = standard_bench(excitation={"amplitude": 0.0, "frequency": 5.0}, ceiling={"height": 0.017}, duration=2.0)
    assert verdicts(scene, [(0.5, 1.0), (1.5, 2.0)], "simplified") == [None, None]
