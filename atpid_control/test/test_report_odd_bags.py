# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags with invalid messages: the report is made of the others, and states what was left out."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from rewritten import BAG, rewritten

from atpid_common.errors import InputError
from atpid_control.runs.read import open_bag
from atpid_control.views.report.page import page
from atpid_control.views.report.picture import save_pictures
from atpid_control.views.report.view import view_of

KINDS = ("Excitation", "CeilingCommand", "CeilingState", "SampleBlock", "PlantTruth", "Event")
NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e-308, 0.0, -1.0)
COUNTS = (0, 2**32 - 1, 2**62, 2**63, 2**64 - 1)

Change = Callable[[Any], None]


def odd(folder: Path, kind: str, change: Change, share: float = 1.0, seed: int = 0) -> Path:
    """Write the recorded bag with a share of its messages of a kind changed."""
    chance, topics = random.Random(seed), set(open_bag(BAG).topics_of(kind))

    def some(topic: str, _place: int, message: Any) -> None:
        if chance.random() < share and topic in topics:
            change(message)

    return rewritten(folder, some)


def chosen(chance: random.Random) -> Change:
    """Return a change of one field, the same for every message."""
    field: list[str] = []

    def change(message: Any) -> None:
        names = [name for name in getattr(message, "__slots__", None) or vars(message)]
        field[:] = field or [chance.choice(names)]
        value = getattr(message, field[0])
        if isinstance(value, float):
            setattr(message, field[0], chance.choice(NUMBERS))
        elif isinstance(value, int) and not isinstance(value, bool):
            setattr(message, field[0], chance.choice(COUNTS))
        elif isinstance(value, np.ndarray) and len(value):
            changed = np.array(value, dtype=float)
            changed[chance.randrange(len(changed))] = chance.choice(NUMBERS)
            setattr(message, field[0], changed[: chance.choice([len(changed), chance.randrange(len(changed))])])
        elif isinstance(value, str):
            setattr(message, field[0], chance.choice(["", "\x00<b>", "x" * 3000]))
        elif hasattr(value, "stamp"):
            value.stamp.sec = chance.choice([0, -(2**31), 2**31 - 1])

    return change


@pytest.mark.slow
def test_a_report_is_made_of_whatever_can_be_used(tmp_path: Path) -> None:
    """Each kind of message once; some times in the long profile."""
    made, count = 0, len(KINDS) * (5 if settings.get_current_profile_name() == "long" else 1)
    for seed in range(count):
        chance, kind = random.Random(seed), KINDS[seed % len(KINDS)]
        bag = odd(tmp_path / f"{seed}", kind, chosen(chance), chance.choice([0.01, 0.3, 1.0]), seed)
        try:
            view = view_of(bag)
        except InputError as error:  # not one block of displacements is left
            assert "\n" not in str(error)  # noqa: PT017
            continue
        assert "<html" in page(view)
        made += 1
        if seed % 6 == 0:
            save_pictures(view, tmp_path)
    assert made >= count - count // len(KINDS)  # blocks of displacements are one of the kinds


def test_what_is_left_out_stands_in_the_report(tmp_path: Path) -> None:
    def nonsense(message: Any) -> None:
        message.amplitude = -1.0

    view = view_of(odd(tmp_path / "odd", "Excitation", nonsense, 0.5))
    (line,) = view.run.missing
    assert line.startswith("excitation: ")
    assert line.endswith("its amplitude -1.0 cannot be")
    assert line in page(view)
    assert len(view.run.estimates.time) + int(line.split()[1]) == 160


def test_an_index_that_does_not_go_on_is_left_out(tmp_path: Path) -> None:
    def far(message: Any) -> None:
        message.first_index += 2**61

    view = view_of(odd(tmp_path / "odd", "SampleBlock", far, 0.1))
    assert any("a table of its own: its index goes from" in line for line in view.run.missing)
    assert view.run.motion.time[-1] < 10.0
    assert view.run.lost > 0
