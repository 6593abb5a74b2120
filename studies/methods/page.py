# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page made from a comparison: docs/research/methods.md."""

import textwrap
from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from atpid_sim.system import Array
from studies.methods.run import PASSIVE, SELECTED, Compared

_WIDTH = 100
#: The scenes the page is about: its text says what is seen in them.
SCENES = ("thesis_4_3", "stepped_4_8_phi_0_3", "stiff_beam")


def headings(results: Sequence[Compared]) -> list[str]:
    """Return the headings of the table: a column a scene, then the times."""
    return ["", *(one.name for one in results), "time: median", "worst"]


def rows(results: Sequence[Compared]) -> list[list[str]]:
    """Return the rows of the table: efficiencies over the amplitudes, in brackets the least with 5 % error."""
    return [
        [what, *(_efficiencies(one, what) for one in results), *_times(results, what)] for what in (*PASSIVE, *SELECTED)
    ]


def page_text(results: Sequence[Compared], figures: str) -> str:
    """Return the page as Markdown, wrapped at 100 columns but for tables; `figures` leads to its picture."""
    text = (files("studies.methods") / "data" / "page.txt").read_text(encoding="utf-8")
    text = text.replace("(figures/", f"({figures}/")
    tables = {
        "scenes": _table(["scene", *_SCENE_HEADINGS], [_scene(one) for one in results]),
        "methods": _table(headings(results), rows(results)),
        "errors": _table(["5 % error in", *_ERRORS_OF], _errors(results)),
        "passive": _table(["", *(one.name for one in results)], _passive(results)),
        "refused": _filled(_refused(results)),
    }
    parts = [tables.get(part.strip("{}")) or _filled(part) for part in text.strip().split("\n\n")]
    return "\n\n".join(parts) + "\n"


_SCENE_HEADINGS = ("resonance", "grain", "damping ratio", "restitution", "support amplitudes")


def _scene(one: Compared) -> list[str]:
    about = one.about
    return [
        f"`scenes/{one.name}.yaml`", f"{about['frequency']:.2f} Hz", f"{100.0 * about['mass_fraction']:g} %",
        f"{about['damping_ratio']:.3g}", f"{about['restitution']:.3f}",
        ", ".join(f"{1e3 * amplitude:g}" for amplitude in one.amplitudes) + " mm",
    ]  # fmt: skip


def _efficiencies(one: Compared, what: str) -> str:
    nominal, every = one.nominal(what), one.efficiencies[what]
    if np.isnan(every).all():
        return "refused"
    low, high = 100.0 * np.nanmin(nominal), 100.0 * np.nanmax(nominal)
    shown = f"{low:.1f}" if high - low < 0.05 else f"{low:.1f}–{high:.1f}"
    mark = "*" if np.isnan(every).any() else ""
    return f"{shown} ({100.0 * np.nanmin(every):.1f}){mark}"


def _times(results: Sequence[Compared], what: str) -> list[str]:
    seconds = np.concatenate([one.seconds[what] for one in results]) if what in SELECTED else np.array([])
    return [_duration(float(np.median(seconds))), _duration(float(seconds.max()))] if len(seconds) else ["–", "–"]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds >= 1.0 else f"{1e3 * seconds:.2g} ms" if seconds < 0.1 else f"{seconds:.2f} s"


def _refused(results: Sequence[Compared]) -> str:
    lines = [f"- Refused, marked by an asterisk: {one.name}, {line}" for one in results for line in one.refusals]
    return "\n".join(lines) or "No method refuses any of these amplitudes."


_ERRORS_OF = (*SELECTED, PASSIVE[5])


def _errors(results: Sequence[Compared]) -> list[list[str]]:
    """Return the least efficiency of any amplitude for each structure of the first scene."""
    one = results[0]
    return [
        [name, *(_least(one.efficiencies[what][row]) for what in _ERRORS_OF)] for row, name in enumerate(one.structures)
    ]


def _least(values: Array) -> str:
    return "refused" if np.isnan(values).all() else f"{100.0 * np.nanmin(values):.1f}"


def _passive(results: Sequence[Compared]) -> list[list[str]]:
    """Return what the passive dampers are: tuning, efficiencies over all frequencies, space; Masri's gap."""
    table = []
    for what in PASSIVE[4:]:
        for key, label, scale, form in _TUNED:
            table.append([f"{what}: {label}", *(f"{scale * one.tuned[what][key]:{form}}" for one in results)])
    for key, label, scale, form in _THEORY:
        values = (f"{scale * one.theory[key]:{form}}" if one.theory else "none stable" for one in results)
        table.append([f"Masri's gap: {label}", *values])
    best = ((one.heights["lookup"][0], one.amplitudes[0], one.diameter) for one in results)
    table.append(["look-up, first amplitude: clearance / A", *(f"{(h - d) / a:.1f}" for h, a, d in best)])
    return table


_TUNED = (
    ("frequency", "natural frequency [Hz]", 1.0, ".3f"),
    ("damping", "damping [N s/m]", 1.0, ".3f"),
    ("efficiency", "efficiency at the resonance [%]", 100.0, ".1f"),
    ("efficiency_any_frequency", "at the worst frequency [%]", 100.0, ".1f"),
    ("efficiency_any_frequency_stiffness", "the same with 5 % error of the stiffness [%]", 100.0, ".1f"),
    ("stroke", "peak-to-peak stroke / A", 2.0, ".1f"),
)
_THEORY = (
    ("clearance", "clearance / A", 1.0, ".1f"),
    ("efficiency", "efficiency by the theory [%]", 100.0, ".1f"),
    ("multiplier", "largest multiplier by the theory", 1.0, ".3f"),
)


def _table(titles: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    head = ["| " + " | ".join(titles) + " |", "|" + "---|" * len(titles)]
    return "\n".join([*head, *("| " + " | ".join(line) + " |" for line in lines)])


def _filled(text: str) -> str:
    """Return a paragraph or a list wrapped; headings, code, pictures and tables as they are."""
    if text.startswith(("#", "    ", "!", "|")):
        return text
    if not text.startswith("- "):
        return textwrap.fill(" ".join(text.split()), _WIDTH, break_on_hyphens=False)
    items = (" ".join(item.split()) for item in text.removeprefix("- ").split("\n- "))
    wrapper = textwrap.TextWrapper(_WIDTH, subsequent_indent="  ", break_on_hyphens=False)
    return "\n".join(wrapper.fill(f"- {item}") for item in items)
