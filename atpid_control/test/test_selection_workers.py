# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a selection is computed with: threads, and no garbage collection meanwhile."""

import gc

import pytest

from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.protocol import Excitation
from atpid_control.selection.workers import without_collection
from atpid_sim.scene import standard_bench


def test_the_collection_is_postponed_and_comes_back_after_an_error() -> None:
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError), without_collection():
        _ = 1 / gc.isenabled()  # disabled: division by zero
    assert gc.isenabled()
    gc.disable()
    try:
        with without_collection():
            pass
        assert not gc.isenabled()  # what the caller had chosen
    finally:
        gc.enable()


def test_a_selection_collects_no_garbage() -> None:
    selector, begun = DirectSelector(standard_bench()), []

    def note(phase: str, _: dict[str, int]) -> None:
        begun.append(phase)

    gc.callbacks.append(note)
    try:
        gc.set_threshold(1)
        selector.select(Excitation(0.01))
        during = [phase for phase in begun if phase == "start"]
    finally:
        gc.set_threshold(700, 10, 10)
        gc.callbacks.remove(note)
    assert len(during) < 100  # before and after the search; within it there are thousands
