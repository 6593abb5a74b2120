# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a design and of results: its parts, whole and escaped."""

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from atpid_control.views.static_page import document, drawn, facts, table, warnings
from atpid_sim.figure_numbers import numbers_in, save_panels
from atpid_sim.figure_style import LIGHT


def test_what_is_given_is_escaped() -> None:
    shown = document(
        "<A>", [table("<B>", ["<C>"], [["<D>"], [("<E>", "<F>")]]), facts({"<G>": "<H>"}), warnings(["<I>"])]
    )
    assert re.findall(r"<[A-I]>", shown) == []
    for letter in "ABCDEFGHI":
        assert f"&lt;{letter}&gt;" in shown


def test_a_table_has_a_region_that_the_keyboard_reaches() -> None:
    assert 'role="region" tabindex="0" aria-label="rows"' in table("rows", ["", "x"], [["a", "b"]])


def test_without_warnings_there_is_no_list() -> None:
    assert warnings([]) == ""


def _panel(axes: Any) -> None:
    axes.plot([0.0, 1.0], [0.0, 2.0], color=LIGHT.own, label="a curve")
    axes.set(title="<Height>", ylabel="mm")


def test_a_page_holds_its_panels_in_both_schemes() -> None:
    shown = document("A", [drawn([[_panel], [_panel, _panel]])])
    assert re.findall(r'(?:src|href)="(?!#|http://www.w3.org)[^"]*"', shown) == []
    assert shown.count("--paper:") == 2
    assert shown.count('<svg role="img" aria-label="&lt;Height&gt;"') == 3
    assert shown.count("<figcaption>&lt;Height&gt;</figcaption>") == 3
    assert shown.count(">a curve</text>") == 3
    assert "stroke: var(--own)" in shown
    drawings = shown[shown.index("<main>") :]
    assert not any(colour in drawings for colour in asdict(LIGHT).values())


def test_a_picture_has_every_panel_and_its_numbers(tmp_path: Path) -> None:
    save_panels([[_panel], [_panel, _panel]], tmp_path / "a.png")
    assert list(numbers_in(tmp_path / "a.png")) == [f"{place} <Height>" for place in range(3)]


@pytest.mark.parametrize("words", [("runs", "2026"), ("/deep",)])
def test_a_long_name_of_a_curve_leaves_room_for_the_curve(words: tuple[str, ...]) -> None:
    def two(axes: Any) -> None:
        for end in ("/first bag", "/second bag"):
            axes.plot([0.0, 1.0], [0.0, 2.0], label=" ".join(words) * 100 + end)

    shown = drawn([[two]])  # a warning of matplotlib, where no room is left, is an error
    assert "first" in shown
    assert "second" in shown
