# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML from templates that share head, style and parts: light or dark by the reader's setting."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from html import escape
from importlib.resources import files
from itertools import chain
from typing import TYPE_CHECKING

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from atpid_common.output import finite
from atpid_sim.figure_style import DARK, LIGHT, SIZE, Panels, legend_below, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: The package whose folder `data` has page.html, which each page extends, and parts.html, of tables and lists.
_SHARED = "atpid_control.views.report"


def rendered(
    template: str, package: str, names: Mapping[str, object], figures: Mapping[str, object] | None = None
) -> str:
    """Return the page of a template in the folder `data` of a package, with what it names.

    figures: of plotly, each drawn into the element with the class `chart` and its name as id.
    """
    code = {"colours": _colours(), "style": _shared("page.css")}
    if figures is not None:
        from plotly.offline import get_plotlyjs  # here, since it loads slowly, and not every page has charts

        # a closing tag inside the text would end the script element
        data = json.dumps(finite(figures), separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
        code |= {"figures": data, "library": get_plotlyjs(), "script": _shared("page.js")}
    loader = ChoiceLoader([PackageLoader(one, "data") for one in (package, _SHARED)])
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text: str = pages.get_template(template).render(names, **code)
    return f"{text}\n"


def _shared(name: str) -> str:
    return files(_SHARED).joinpath("data", name).read_text(encoding="utf-8")


def _colours() -> str:
    """Return the colours of both schemes as CSS."""
    light, dark = ("".join(f"--{name}:{value};" for name, value in asdict(one).items()) for one in (LIGHT, DARK))
    return f":root{{{light}}}@media (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"


def drawn(panels: Panels) -> str:
    """Return each panel as a drawing of its own: side by side, on a narrow screen below each other."""
    return f'<div class="panels">{"".join(map(_drawing, chain.from_iterable(panels)))}</div>'


def _drawing(draw: Callable[[Axes], None]) -> str:
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
