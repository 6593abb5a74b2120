# SPDX-License-Identifier: Apache-2.0
"""The page's table: each stage's figures, and the thesis's beneath where it is the thesis's bench."""

from __future__ import annotations

import math
from html import escape

from atpid_control.report.stages import Stage
from atpid_control.report.thesis import Printed
from atpid_control.report.view import View, not_arrived

_THESIS_NOTE = (
    ' Beneath, in <b class="accent">orange</b>, what the thesis prints (section 4.3; read off figures, and sometimes '
    "with the static deflection in it); in grey, the best that a search over all heights finds with this model."
)
_COLUMNS = (
    "stage", "support amplitude", "identified", "error", "frequency", "ceiling height", "beam, closed", "beam",
    "efficiency",
)  # fmt: skip


def table(view: View) -> str:
    """Return the stages' figures with the thesis's beneath."""
    if not view.stages:
        return ""
    rows = [_row(stage, view.printed[n] if view.printed else None) for n, stage in enumerate(view.stages)]
    thesis = _THESIS_NOTE if view.printed else ""
    head = "".join(f"<th>{name}</th>" for name in _COLUMNS)
    notes = [f"* {escape(text)}." for text in not_arrived(view)]
    notes += ["Where the motion is irregular, efficiency is given as the range of repeated simulations."] * any(
        stage.amplitude_spread for stage in view.stages
    )
    below = "".join(f'<p class="note">{text}</p>' for text in notes)
    return (
        "<h2>Stage by stage</h2>"
        f'<p class="note">Amplitudes are half peak-to-peak, in the shaded windows.{thesis}</p>'
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>{below}'
    )


def _row(stage: Stage, printed: Printed | None) -> str:
    error = 100.0 * (stage.identified_amplitude / stage.excitation_amplitude - 1.0)
    thesis = best = {"height": "", "closed": "", "beam": "", "efficiency": ""}
    if printed is not None:
        thesis = {
            "height": f"{escape(printed.height_sign)}{printed.height:.2f} m",
            "closed": f"{printed.closed:.2f} m",
            "beam": f"{printed.amplitude:.2f} m",
            "efficiency": f"{100.0 * printed.efficiency:.0f} %",
        }
        best = best | {
            "height": f"{printed.best_height:.2f} m",
            "efficiency": f"{100.0 * printed.best_efficiency:.0f} %",
        }
    cells = [
        (f"{stage.t0:.4g} to {stage.t1:.4g} s", "", ""),
        (number(1e3 * stage.excitation_amplitude, ".4g", "mm"), "", ""),
        (number(1e3 * stage.identified_amplitude, ".3f", "mm"), "", ""),
        (number(error, "+.3f", "%"), "", ""),
        (number(stage.identified_frequency, ".3f", "Hz"), "", ""),
        (number(stage.height, ".3f", "m") + ("" if stage.arrived else " *"), thesis["height"], best["height"]),
        (number(stage.undamped_amplitude, ".3f", "m"), thesis["closed"], ""),
        (number(stage.amplitude, ".3f", "m"), thesis["beam"], ""),
        (f"<b class='own'>{_efficiency(stage)}</b>", thesis["efficiency"], best["efficiency"]),
    ]
    return "<tr>" + "".join(_cell(name, *cell) for name, cell in zip(_COLUMNS, cells, strict=True)) + "</tr>"


def _cell(name: str, text: str, thesis: str, best: str) -> str:
    """Return a cell; a narrow page shows its column's name beside it in place of the head."""
    beneath = f'<span class="thesis">{thesis}</span>' if thesis else ""
    beneath += f'<span class="best">{best}</span>' if best else ""
    return f'<td data-name="{name}"><div>{text}{beneath}</div></td>'


def _efficiency(stage: Stage) -> str:
    if stage.amplitude_spread is not None:
        return stage.efficiency_text()
    return number(100.0 * stage.efficiency, ".1f", "%")


def number(value: float, form: str, unit: str) -> str:
    """Return a value in the page's form: a true minus sign, no sign on zero, a dash for NaN."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:{form}}"
    if float(text) == 0.0:  # rounded to zero, it has no sign
        text = text.lstrip("+-")
    return f"{text} {unit}".replace("-", "−")
