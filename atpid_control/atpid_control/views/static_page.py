# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A page of headings, tables and panels: self-contained HTML, light or dark by the reader's setting."""

import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib.resources import files
from itertools import chain
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from atpid_common.files import Document
from atpid_sim.figure_style import DARK, LIGHT, SIZE, Panels, legend_below, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Link:
    """A cell that leads to another page."""

    text: str
    address: str


#: A table's cell, or a cell with what stands beneath it in small print.
Cell = str | tuple[str, str] | Link


def document(title: str, parts: Iterable[str], css: str = "") -> str:
    """Return the page: `parts` are HTML, `css` rules of this page alone."""
    light, dark = ("".join(f"--{name}:{value};" for name, value in asdict(one).items()) for one in (LIGHT, DARK))
    colours = f":root{{{light}}}@media (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"
    head = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{colours}{_shared('page.css')}{css}</style></head><body><main>"
    )
    return "\n".join([head, *parts, "</main></body></html>\n"])


def filled(template: str, package: str, names: Mapping[str, object]) -> str:
    """Return a template in the folder `data` of a package, filled: a page's body; it may call `table` and lists."""
    pages = Environment(
        loader=PackageLoader(package, "data"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    text: str = pages.get_template(template).render({"table": table, "facts": facts, "warnings": warnings, **names})
    return text


def _shared(name: str) -> str:
    """Return a file that all pages share."""
    return files("atpid_control.views.report").joinpath("data", name).read_text(encoding="utf-8")


def scripts(figures: Mapping[str, Document], more: str = "") -> str:
    """Return what draws each figure of plotly into the element of its name; `more` is run after it."""
    from plotly.offline import get_plotlyjs  # here, since it loads slowly, and not every page has a chart

    # a closing tag inside the text would end the script element
    data = json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return (
        f'<script type="application/json" id="figures">{data}</script>\n'
        f"<script>{get_plotlyjs()}</script>\n<script>{_shared('page.js')}{more}</script>"
    )


def table(name: str, heads: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Return a table in a region that scrolls sideways."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(map(_cell, heads, row))}</tr>" for row in rows)
    # a region that scrolls is reached by the keyboard too
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(name)}"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cell(head: str, cell: Cell) -> str:
    if isinstance(cell, Link):
        return f'<td data-name="{escape(head)}"><a href="{escape(cell.address)}">{escape(cell.text)}</a></td>'
    text, beneath = (cell, "") if isinstance(cell, str) else cell
    small = f'<span class="best">{escape(beneath)}</span>' if beneath else ""
    return f'<td data-name="{escape(head)}"><div>{escape(text)}{small}</div></td>'


def facts(named: Mapping[str, str] | Iterable[Sequence[str]]) -> str:
    """Return names and what they are as a list."""
    pairs = named.items() if isinstance(named, Mapping) else named
    return f"<dl>{''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in pairs)}</dl>"


def warnings(lines: Iterable[str]) -> str:
    """Return a list of warnings; nothing without any."""
    items = "".join(f'<li class="warning"><i></i><span>{escape(line)}</span></li>' for line in lines)
    return f'<ol class="events">{items}</ol>' if items else ""


def drawn(panels: Panels) -> str:
    """Return each panel as a drawing of its own: side by side, on a narrow screen below each other."""
    return f'<div class="panels">{"".join(map(_drawing, chain.from_iterable(panels)))}</div>'


def _drawing(draw: "Callable[[Axes], None]") -> str:
    """Return a panel as SVG whose text is text and whose colours are those of the page's scheme."""
    import matplotlib  # here, since it loads slowly, and not every page has a drawing
    from matplotlib.figure import Figure

    with matplotlib.rc_context(style(LIGHT) | {"svg.fonttype": "none", "legend.fontsize": SIZE}):
        figure = Figure(figsize=(4.3, 3.3), layout="constrained")
        axes = figure.subplots()
        draw(axes)
        legend_below(axes)
        title = escape(axes.get_title(loc="left"))
        axes.set_title("")  # on the page it may have several lines
        buffer = io.StringIO()
        matplotlib.rcParams["svg.hashsalt"] = title
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text, named = buffer.getvalue(), f'<svg role="img" aria-label="{title}"'
    shown = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])  # ids of one page are unique
    for name, value in asdict(LIGHT).items():
        shown = shown.replace(value, f"var(--{name})")
    return f"<figure><figcaption>{title}</figcaption>{shown.replace('<svg', named, 1)}</figure>"
