# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a newcomer looks for is at most three links from the README."""

import pytest
from documented import ROOT, anchors, links

#: Each task of a newcomer: the page, and the heading under which it is done.
TASKS = {
    "simulate my own beam": "docs/tutorial.md#3-a-scene-of-your-own",
    "find the best height": "docs/tutorial.md#4-its-height-map",
    "stop the motor": "docs/stand.md#the-operators-stop",
    "export for MATLAB": "docs/reading.md#as-files",
    "use a contact law of my own": "docs/howto_contact_law.md#the-file",
    "read a bag in Python": "docs/reading.md#in-python",
    "what is a cliff": "docs/atlas.md#cliffs-as-curves",
    "wire the motor": "docs/stand.md#motor",
    "compare two runs": "docs/reading.md#two-bags-beside-each-other",
    "is this for me": "docs/what_it_is.md#is-this-for-me",
}
FARTHEST = 3


def clicks() -> dict[str, int]:
    """Return how many links each Markdown page is from the README, by its path."""
    found, newest = {"README.md": 0}, ["README.md"]
    while newest:
        targets = [(page, link.partition("#")[0]) for page in newest for link in links(ROOT / page) if ".md" in link]
        reached = [(page, ((ROOT / page).parent / target).resolve()) for page, target in targets if target]
        steps = {path.relative_to(ROOT).as_posix(): found[page] + 1 for page, path in reached if path.is_file()}
        newest = [page for page in steps if page not in found]
        found |= {page: steps[page] for page in newest}
    return found


@pytest.mark.parametrize("task", TASKS)
def test_a_task_is_three_links_away(task: str) -> None:
    page, _, heading = TASKS[task].partition("#")
    assert clicks()[page] <= FARTHEST
    assert heading in anchors(ROOT / page)


def test_each_page_of_the_documentation_is_reached() -> None:
    reached = clicks()
    assert [path.name for path in ROOT.glob("docs/*.md") if path.relative_to(ROOT).as_posix() not in reached] == []


def test_the_numbers_of_the_example_are_those_of_the_design() -> None:
    """`tests/test_design_page.py` computes them again."""
    table = (ROOT / "docs/what_it_is.md").read_text().partition("| answer | |\n|---|---|\n")[2]
    rows = table.partition("\n\n")[0].splitlines()
    design = (ROOT / "docs/design.md").read_text()
    assert len(rows) > 2
    assert [row for row in rows if row not in design] == []
