# SPDX-License-Identifier: Apache-2.0
"""The page of a design and of results: its parts, whole and escaped."""

import re

from atpid_control.views.static_page import document, facts, png_address, table, warnings


def test_what_is_given_is_escaped() -> None:
    shown = document(
        "<A>", [table("<B>", ["<C>"], [["<D>"], [("<E>", "<F>")]]), facts({"<G>": "<H>"}), warnings(["<I>"])]
    )
    assert re.findall(r"<[A-I]>", shown) == []
    for letter in "ABCDEFGHI":
        assert f"&lt;{letter}&gt;" in shown


def test_a_table_without_heads_has_no_head_and_a_region_that_the_keyboard_reaches() -> None:
    shown = table("rows", ["", ""], [["a", "b"]])
    assert "<thead>" not in shown
    assert "<thead>" in table("rows", ["", "x"], [["a", "b"]])
    assert 'role="region" tabindex="0" aria-label="rows"' in shown


def test_without_warnings_there_is_no_list() -> None:
    assert warnings([]) == ""


def test_a_page_holds_its_pictures_and_both_schemes() -> None:
    shown = document("A", [f'<img src="{png_address(b"PNG")}" alt="B">'])
    assert re.findall(r'(?:src|href)="([^"]*)"', shown) == ["data:image/png;base64,UE5H"]
    assert shown.count("--paper:") == 2
