# SPDX-License-Identifier: Apache-2.0
"""A page of headings, tables and pictures: self-contained HTML, light or dark by the reader's setting."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib.resources import files

from atpid_sim.figure_style import DARK, LIGHT, Palette


@dataclass(frozen=True)
class Link:
    """A cell that leads to another page."""

    text: str
    address: str


#: A table's cell, or a cell with what stands beneath it in small print.
Cell = str | tuple[str, str] | Link


def document(title: str, parts: Iterable[str], css: str = "") -> str:
    """Return the page: `parts` are HTML, `css` rules of this page alone."""
    return "\n".join([
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{colours()}{style_sheet()}img{{width:100%;height:auto}}{css}</style></head><body><main>",
        *parts,
        "</main></body></html>\n",
    ])  # fmt: skip


def colours() -> str:
    """Return the colours of both schemes as CSS."""
    light, dark = (_variables(palette) for palette in (LIGHT, DARK))
    return f":root{{{light}}}@media (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"


def _variables(palette: Palette) -> str:
    return "".join(f"--{name}:{value};" for name, value in asdict(palette).items())


def style_sheet() -> str:
    """Return the rules that all pages share."""
    return files("atpid_control.views.report").joinpath("data", "page.css").read_text(encoding="utf-8")


def table(name: str, heads: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Return a table in a region that scrolls sideways; without a head where all of `heads` are empty."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(map(_cell, heads, row))}</tr>" for row in rows)
    # a region that scrolls is reached by the keyboard too
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(name)}"><table>'
        f"{f'<thead><tr>{head}</tr></thead>' if any(heads) else ''}<tbody>{body}</tbody></table></div>"
    )


def _cell(head: str, cell: Cell) -> str:
    if isinstance(cell, Link):
        return f'<td data-name="{escape(head)}"><a href="{escape(cell.address)}">{escape(cell.text)}</a></td>'
    text, beneath = (cell, "") if isinstance(cell, str) else cell
    small = f'<span class="best">{escape(beneath)}</span>' if beneath else ""
    return f'<td data-name="{escape(head)}"><div>{escape(text)}{small}</div></td>'


def facts(named: Mapping[str, str]) -> str:
    """Return names and what they are as a list."""
    return f"<dl>{''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in named.items())}</dl>"


def warnings(lines: Iterable[str]) -> str:
    """Return a list of warnings; nothing without any."""
    items = "".join(f'<li class="warning"><i></i><span>{escape(line)}</span></li>' for line in lines)
    return f'<ol class="events">{items}</ol>' if items else ""


def png_address(content: bytes) -> str:
    """Return the bytes of a PNG as the address of an image."""
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"
