# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page that shows all studies: docs/research/thesis.md."""

import shutil
import textwrap
from collections.abc import Sequence
from pathlib import Path

from atpid_common import output
from studies import pages
from studies.thesis.rows import Row, shown
from studies.thesis.run import Finished
from studies.thesis.study import FOLDER, not_computed

_WIDTH = 100

_CELLS = ("figure", "quantity", "ours", "thesis", "difference", "why")


def write_page(done: Sequence[Finished], page: Path) -> list[Path]:
    """Write the page, and the pictures into its folder `figures`; return all files. Raises OutputError."""
    pictures = output.folder(pages.figures(output.file(page, "--page")), "--page")
    written = [page]
    with output.writing(page, "--page"):
        for one in done:
            if one.picture is not None:
                written.append(pictures / f"thesis_{one.name}.png")
                shutil.copyfile(one.picture, written[-1])
        page.write_text(page_text(done, pages.link(page)), encoding="utf-8")
    return written


def page_text(done: Sequence[Finished], figures: str) -> str:
    """Return the page as Markdown, wrapped at 100 columns but for tables; `figures` leads to its pictures."""
    intro = (FOLDER / "page.txt").read_text(encoding="utf-8")
    parts = [wrapped(intro), summary(done), *(section(one, figures) for one in done), _missing()]
    return "\n\n".join(parts) + "\n"


def summary(done: Sequence[Finished]) -> str:
    """Return how many rows agree, and the table of those that do not."""
    every = [(one, row) for one in done for row in one.rows]
    compared = [(one, row) for one, row in every if row.agrees is not None]
    differ = [(one, row) for one, row in compared if not row.agrees]
    text = (
        f"{len(every)} rows: {len(compared)} have a number or a word of the thesis, or a closed form, to compare with, "
        f"of which {len(compared) - len(differ)} agree; {len(every) - len(compared)} stand for curves without printed "
        f"values. These {len(differ)} differ:"
    )
    return "\n\n".join(["## What agrees and what does not", wrapped(text), table([row for _, row in differ])])


def section(one: Finished, figures: str) -> str:
    """Return a study's section: what is assumed, its picture, its rows."""
    reference = "" if one.study.section == "reference" else f" (section {one.study.section})"
    parts = [f"## {one.study.title}{reference}"]
    if one.study.text:
        parts.append(wrapped(one.study.text))
    if one.picture is not None:
        parts.append(f"![{one.study.title}]({figures}/thesis_{one.name}.png)")
    parts.append(f"    python -m studies thesis {one.name} --out out/study")
    return "\n\n".join([*parts, table(one.rows)])


def table(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table."""
    lines = ["| " + " | ".join(_CELLS) + " |", "|" + "---|" * len(_CELLS)]
    return "\n".join([*lines, *("| " + " | ".join(cells(row)) + " |" for row in rows)])


def cells(row: Row) -> list[str]:
    """Return a row as the cells of its table."""
    unit = f" [{row.unit}]" if row.unit not in ("", "-") else ""
    return [row.figure, row.quantity + unit, shown(row.ours, row.digits), _thesis(row), _difference(row), row.why]


def _thesis(row: Row) -> str:
    return "curve" if row.thesis is None else shown(row.thesis, max(row.digits, 4))


def _difference(row: Row) -> str:
    if row.difference is not None:
        mark = "" if row.agrees else " **differs**"
        return ("0" if row.difference == 0.0 else f"{row.difference:+.2g}") + mark
    return "" if row.agrees is None else ("agrees" if row.agrees else "**differs**")


def wrapped(text: str) -> str:
    """Return paragraphs wrapped at 100 columns; headings and code are left as they are."""
    parts = text.strip().split("\n\n")
    return "\n\n".join(
        part if part.startswith(("#", "    ")) else textwrap.fill(" ".join(part.split()), _WIDTH) for part in parts
    )


def _missing() -> str:
    lines = ["| figures and tables | why there is no row |", "|---|---|"]
    lines += [f"| {item.figures} | {item.why} |" for item in not_computed()]
    return "\n".join(["## What cannot be computed", "", *lines])
