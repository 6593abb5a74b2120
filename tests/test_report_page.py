# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pages of a bag in a browser: accessible, on desktop and phone, no name of a curve on a curve, nothing cut off."""

from pathlib import Path

import pytest
from documented import ROOT
from page_visit import visited

from atpid_control.cli import main
from atpid_control.views.report import report

BAG = ROOT / "bags/thesis_4_3_short"


@pytest.mark.slow
def test_the_pages_of_a_bag_are_accessible_and_whole_on_every_screen(tmp_path: Path) -> None:
    page = report(BAG, tmp_path / "report").page
    for arguments in (["analyse", BAG], ["compare", BAG, ROOT / "bags/rumble"], ["validate", BAG]):
        assert main(["bag", *map(str, arguments), "--out", str(tmp_path / str(arguments[0]))]) == 0
    found = visited(page, *tmp_path.glob("*/[ab]*.html"))
    assert len(found) == 16
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


@pytest.mark.slow
def test_a_name_on_a_curve_is_found(tmp_path: Path) -> None:
    page = report(BAG, tmp_path).page
    text = page.read_text(encoding="utf-8")
    below = 'yanchor: "bottom", yshift: 3'
    assert text.count(below) == 1
    page.write_text(text.replace(below, 'yanchor: "top", yshift: -30'), encoding="utf-8")
    found = visited(page)
    assert "adaptive" in found["report.html phone light"]
    assert found["report.html desktop light"] == []
