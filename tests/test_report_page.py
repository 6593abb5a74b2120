# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pages of a bag in a browser: accessible, on desktop and phone, no name of a curve on a curve, nothing cut off."""

import pytest
from documented import ROOT
from page_visit import visited

from atpid_control.cli import main
from atpid_control.views.report import report

BAG = ROOT / "bags/thesis_4_3_short"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What is wrong with the pages, and with a report whose curves' names were put onto the curves."""
    folder = tmp_path_factory.mktemp("pages")
    page = report(BAG, folder / "report").page
    for arguments in (["analyse", BAG], ["compare", BAG, ROOT / "bags/rumble"], ["validate", BAG]):
        assert main(["bag", *map(str, arguments), "--out", str(folder / str(arguments[0]))]) == 0
    text = page.read_text(encoding="utf-8")
    below = 'yanchor: "bottom", yshift: 3'
    assert text.count(below) == 1
    spoiled = folder / "spoiled.html"
    spoiled.write_text(text.replace(below, 'yanchor: "top", yshift: -30'), encoding="utf-8")
    return visited(page, spoiled, *folder.glob("*/[ab]*.html"))


@pytest.mark.slow
def test_the_pages_of_a_bag_are_accessible_and_whole_on_every_screen(found: dict[str, list[str]]) -> None:
    pages = {name: wrong for name, wrong in found.items() if not name.startswith("spoiled")}
    assert len(pages) == 16
    assert {name: wrong for name, wrong in pages.items() if wrong} == {}


@pytest.mark.slow
def test_a_name_on_a_curve_is_found(found: dict[str, list[str]]) -> None:
    assert "adaptive" in found["spoiled.html phone light"]
    assert found["spoiled.html desktop light"] == []
