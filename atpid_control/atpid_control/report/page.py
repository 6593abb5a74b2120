# SPDX-License-Identifier: Apache-2.0
"""The page: one self-contained file, light or dark by the reader's setting."""

from __future__ import annotations

import json
from dataclasses import asdict
from html import escape
from importlib.resources import files

from plotly.offline import get_plotlyjs

from atpid_control.report import charts, sections
from atpid_control.report.stage_table import table
from atpid_control.report.theme import DARK, LIGHT, Palette
from atpid_control.report.view import View, headline


def page(view: View) -> str:
    """Return the whole page as HTML."""
    title = escape(headline(view))
    figures = {"overview": charts.overview(view), "grain": charts.grain(view)}
    shown = {name: figure for name, figure in figures.items() if figure is not None}
    parts = [
        *(make(view) for make in (sections.header, sections.tiles, sections.overview, table, sections.grain)),
        sections.energy(view),
        sections.events(view.run.events),
        sections.facts(view),
    ]
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<style>{_colours()}{_data('page.css')}</style></head><body><main>",
            *(part for part in parts if part),
            "<footer>Made by <code>python -m atpid_control report</code> from the bag alone. Drag in a chart to zoom, "
            "double-click to go back.</footer></main>",
            f'<script type="application/json" id="figures">{_json(shown)}</script>',
            f"<script>{get_plotlyjs()}</script>",
            f"<script>{_data('page.js')}</script>",
            "</body></html>\n",
        ]
    )


def _data(name: str) -> str:
    return files("atpid_control.report").joinpath("data", name).read_text(encoding="utf-8")


def _json(value: object) -> str:
    # a closing tag inside the text would end the script element
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def _colours() -> str:
    def block(palette: Palette) -> str:
        return "".join(f"--{name}:{value};" for name, value in asdict(palette).items())

    return f":root{{{block(LIGHT)}}}@media (prefers-color-scheme: dark){{:root{{{block(DARK)}}}}}\n"
