# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The points of a trade-off, and kernels that are compiled ahead."""

import itertools
from pathlib import Path

from atpid_control.identification import linear
from atpid_sim.scene import standard_bench
from atpid_sim.tradeoff import reference_of, with_front
from studies.tradeoff.measure import measure


def test_a_tradeoff_has_what_nothing_beats_and_levels_that_converge() -> None:
    short = standard_bench(
        duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
    )
    reference = reference_of(short)
    assert reference.agreement < 1e-8
    points = list(itertools.takewhile(lambda point: point.method != "lsoda", measure(short, reference)))
    error = {(point.method, point.tolerance): point.amplitude_error for point in points}
    assert error["soft", 1e-6] < 1e-5
    assert error["soft", 1e-8] < 1e-7
    assert error["finite", 1e-6] < 1e-3  # the damper is open for half a second: what was closed counts
    assert any(point.front for point in with_front(points))


def test_the_cache_of_compiled_functions_covers_all_their_sources() -> None:
    package = Path(__file__).parents[2] / "atpid_control" / "atpid_control"
    users = {path.stem for path in package.rglob("*.py") if "\n@compiled\n" in path.read_text(encoding="utf-8")}
    assert users == set(linear.KERNELS)
