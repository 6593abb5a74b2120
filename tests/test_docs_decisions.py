# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decision records: the index is complete, and every record that is named anywhere exists."""

import re

from documented import ROOT, files

RECORDS = ROOT / "docs/decisions"
#: A record is named by its file, so that a number alone, which a merge of records may change, is not relied on.
_FILE = re.compile(r"(?<![\w-])\d{4}-[a-z0-9-]+\.md")
_NUMBER = re.compile(r"docs/decisions/\d{4}(?![\w-])|(?<!\[)\b(?:[Dd]ecision|[Rr]ecord) 0\d{3}\b(?![-.]\d)")
_READ = {".md", ".py", ".xml", ".toml", ".rst", ".yaml", ".msg", ".srv", ".action", ".h", ".cpp", ".c", ".in", ".txt"}


def records() -> list[str]:
    return sorted(path.name for path in RECORDS.glob("[0-9]*.md"))


def texts() -> list[tuple[str, str]]:
    """Return the text of every file that can name a record."""
    read = [path for path in files() if path.suffix in _READ or path.name == "Makefile"]
    return [(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in read]


def test_each_record_has_a_number_of_its_own_in_its_title() -> None:
    numbers = [name[:4] for name in records()]
    assert len(set(numbers)) == len(numbers)  # numbers of records that are gone are not given again
    titles = [(RECORDS / name).read_text(encoding="utf-8").partition("\n")[0] for name in records()]
    assert [title[:7] for title in titles] == [f"# {name[:4]} " for name in records()]


def test_the_index_has_each_record_once_in_order_with_its_number_and_a_line() -> None:
    index = (RECORDS / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(\d{4}) [^]]+\]\(([^)]+)\) \| [^|]+ \|$", index, flags=re.MULTILINE)
    assert rows == [(name[:4], name) for name in records()]


def test_every_record_has_its_three_parts() -> None:
    for name in records():
        text = (RECORDS / name).read_text(encoding="utf-8")
        parts = re.findall(r"^\*\*(Decided|Why|Given up)\.\*\*", text, flags=re.MULTILINE)
        assert parts == ["Decided", "Why", "Given up"], name


def test_every_record_that_is_named_exists() -> None:
    named = [(page, name) for page, text in texts() for name in _FILE.findall(text)]
    assert len(named) > 50  # the pattern still finds them
    assert [place for place in named if place[1] not in records()] == []


def test_the_number_of_a_link_is_that_of_its_record() -> None:
    link = re.compile(r"\[[a-z ]*(\d{4})[^]]*\]\([^)]*?(\d{4})-[a-z]")
    pairs = [(page, *pair) for page, text in texts() for pair in link.findall(text)]
    assert [pair for pair in pairs if pair[1] != pair[2]] == []


def test_no_record_is_named_by_its_number_alone() -> None:
    assert [(page, match) for page, text in texts() for match in _NUMBER.findall(text)] == []
