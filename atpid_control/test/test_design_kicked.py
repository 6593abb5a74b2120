# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A design states how often its motion comes back after a kick, at the amplitude where it does least often."""

from types import SimpleNamespace
from typing import cast

import pytest

from atpid_control.design.kicked import KICK, comes_back
from atpid_control.design.make import Design
from atpid_control.design.problem import problem_of, scene_of
from atpid_sim.periodic.basin import Starts, basin

PROBLEM = problem_of(mass=2.0, frequency=15.0, damping=0.02, amplitudes=(0.001, 0.003))
#: Support and height [m]: the grain held; a motion beside another one; an irregular one.
HELD, BISTABLE, IRREGULAR = (1e-3, 0.0594), (1e-3, 0.08), (3e-3, 0.1094)


def designed(*points: tuple[float, float]) -> Design:
    """Return what is read of a design with these amplitudes and heights."""
    made = [SimpleNamespace(amplitude=amplitude, height=height, frequency=12.55) for amplitude, height in points]
    return cast(Design, SimpleNamespace(problem=PROBLEM, mass_fraction=0.3, points=made))


def test_the_least_share_is_stated() -> None:
    found = basin(scene_of(PROBLEM, 0.3, *BISTABLE, frequency=12.55), Starts(KICK))
    assert 0.9 < found.share < 1.0
    share = f"{100 * found.share:.1f} % ({100 * found.low:.1f} to {100 * found.high:.1f} %) of kicks of 0.1 m/s"
    assert comes_back(designed(HELD, BISTABLE)).startswith(f"{share} at a support of 1 mm")
    held = comes_back(designed(HELD))
    assert held.startswith("100.0 % (96.1 to 100.0 %) of kicks of 0.1 m/s at a support of 1 mm, 95 % within ")


@pytest.mark.parametrize(("points", "count"), [([IRREGULAR], "1 of 1"), ([HELD, IRREGULAR], "1 of 2")])
def test_a_motion_that_is_not_steady_is_named(points: list[tuple[float, float]], count: str) -> None:
    assert comes_back(designed(*points)).endswith(f"no steady motion at {count} amplitudes")
