# SPDX-License-Identifier: Apache-2.0
"""Bags with messages that cannot be: the report is made of the others, and states what was left out."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_common.errors import InputError
from atpid_control.bags.read import Bag, Raw, open_bag
from atpid_control.report.make import page
from atpid_control.report.picture import save_pictures
from atpid_control.report.view import view_of

BAG = Path(__file__).parents[2] / "bags/thesis_4_3_short"
KINDS = ("Excitation", "CeilingCommand", "CeilingState", "SampleBlock", "PlantTruth", "Event")
NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e-308, 0.0, -1.0)
COUNTS = (0, 2**32 - 1, 2**62, 2**63, 2**64 - 1)

Change = Callable[[Any], None]


class OddBag(Bag):
    """A bag some of whose messages of one kind are changed after decoding."""

    kind: str
    change: Change
    places: set[int]

    def decode(self, raw: Raw) -> Any:
        message = super().decode(raw)
        if self.types[raw.topic].endswith(f"/{self.kind}") and raw.log_ns in self.places:
            self.change(message)
        return message


def odd(kind: str, change: Change, share: float = 1.0, seed: int = 0) -> OddBag:
    """Return the recorded bag with a share of its messages of a kind changed."""
    bag = open_bag(BAG)
    bag.__class__ = OddBag
    assert isinstance(bag, OddBag)
    chance = random.Random(seed)
    bag.kind, bag.change = kind, change
    bag.places = {raw.log_ns for raw in bag.raw if chance.random() < share}
    return bag


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
    made = 0
    for seed in range(12):
        chance = random.Random(seed)
        bag = odd(chance.choice(KINDS), chosen(chance), chance.choice([0.01, 0.3, 1.0]), seed)
        try:
            view = view_of(bag)
        except InputError as error:  # not one block of displacements is left
            assert "\n" not in str(error)  # noqa: PT017
            continue
        assert "<html" in page(view)
        made += 1
        if seed % 6 == 0:
            save_pictures(view, tmp_path)
    assert made > 9


def test_what_is_left_out_stands_in_the_report() -> None:
    def nonsense(message: Any) -> None:
        message.amplitude = -1.0

    view = view_of(odd("Excitation", nonsense, 0.5))
    (line,) = view.run.left_out
    assert line.startswith("/excitation: ")
    assert line.endswith("its amplitude -1.0 cannot be")
    assert line in page(view)
    assert len(view.run.estimates.time) + int(line.split()[1].rstrip(",")) == 160


def test_an_index_that_does_not_go_on_is_left_out() -> None:
    def far(message: Any) -> None:
        message.first_index += 2**61

    view = view_of(odd("SampleBlock", far, 0.1))
    assert any("its index is" in line for line in view.run.left_out)
    assert view.run.motion.time[-1] < 10.0
    assert view.run.lost > 0
