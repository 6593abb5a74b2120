# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The loop check names each thing that fails, in one line each, and nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest

from atpid_control.supervision.loop_check import Ceiling, LatestBlocks, LoopSnapshot, failures

CEILING = Ceiling(0.017, 1.0, 0.3)


def sensors(**channels: float) -> LatestBlocks:
    """The channels, each with this share of valid readings in a block at 10 s."""
    made = LatestBlocks()
    for name, valid in channels.items():
        values = np.zeros(100)
        values[round(100 * valid) :] = math.nan
        made.push(name, values, 10.0)
    return made


RIGHT = LoopSnapshot(
    now=10.05, sensors=sensors(support=1.0, beam=0.9), scene=CEILING, motor=CEILING, recording=True, written=5
)


def test_a_loop_in_order_passes() -> None:
    assert failures(RIGHT) == []
    assert failures(replace(RIGHT, scene=None, motor=None)) == [], "a ceiling that no controller moves"
    assert failures(replace(RIGHT, recorder_expected=False, recording=False)) == []
    assert failures(replace(RIGHT, motor=Ceiling(0.01, 1.2, 0.3))) == [], "a motor that can do more"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"sensors": LatestBlocks()}, "sensors: no samples"),
        ({"sensors": sensors(support=1.0, beam=0.4)}, "beam: 40% of its readings are valid"),
        ({"now": 12.0, "sensors": sensors(beam=1.0)}, "beam: no samples for 2.0 s"),
        ({"errors": {"beam": "frozen at 3.1 V"}}, "beam: frozen at 3.1 V"),
        ({"motor": None}, "motor_node: its limits are not known yet"),
        ({"motor": Ceiling(0.02, 1.0, 0.3)}, "scene 0.017 to 1 m, motor node 0.02 to 1 m"),
        ({"motor": Ceiling(0.017, 0.9, 0.3)}, "scene 0.017 to 1 m, motor node 0.017 to 0.9 m"),
        ({"motor": Ceiling(0.017, 1.0, 0.2)}, "scene 0.3 m/s, motor node 0.2 m/s"),
        ({"recording": False}, "recorder_node: no bag is open"),
        ({"written": 0}, "recorder_node: nothing has been written"),
    ],
)
def test_what_fails_is_named(change: dict[str, object], line: str) -> None:
    (found,) = failures(replace(RIGHT, **change))  # type: ignore[arg-type]
    assert line in found


def test_all_that_fails_is_named_at_once() -> None:
    assert len(failures(LoopSnapshot(now=0.0, sensors=LatestBlocks(), scene=CEILING, errors={"beam": "dead"}))) == 4
