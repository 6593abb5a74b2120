# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a design, of data/design.html, and the words in which a design is told."""

import math
from collections.abc import Sequence

from atpid_control.views.report.stages import per_cent
from atpid_control.views.static_page import document, drawn, filled
from atpid_design import motor
from atpid_design.make import Design
from atpid_design.picture import mass, panels, sketch
from atpid_design.problem import STANDARD_GRAVITY, Problem, Uncertainty
from atpid_design.tuned_mass import MassRow
from atpid_design.worst_case import Interval, Point

_CSS = """
.sketch{max-width:560px;width:100%;font:18px var(--sans)} .sketch text{fill:var(--ink)}
.sketch path{fill:none;stroke:var(--muted)}
.sketch .wall{stroke:var(--ink);stroke-width:2.5} .sketch .ceiling{stroke:var(--own);stroke-width:3}
.sketch .closed{stroke-dasharray:4 4}
.sketch circle{fill:var(--soft);stroke:var(--own)}
h1 { max-width: 32em; } .tiles { grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); }
ol.events li { grid-template-columns: 10px 1fr; }
"""
#: A row of a table: its cells by their heads, each a text, or one with what stands beneath it.
Row = dict[str, str | tuple[str, str]]


def page(made: Design) -> str:
    """Return the whole page."""
    names = {
        "made": made,
        "p": made.problem,
        "title": headline(made),
        "structure": structure(made.problem),
        "tone": tone(made),
        "tiles": _tiles(made),
        "panels": drawn(panels(made)),
        "promise": _table(promise(made)),
        "grains": _table(_grains(made)),
        "sketch": sketch(made),
        "verdict": verdict(made.tuned_mass.rows),
        "beside": _table(_beside(made)),
        "uncertain": Uncertainty.model_fields.items(),
        "mass": mass,
        "motor": motor,
    }
    return document(headline(made), [filled("design.html", __package__, names)], _CSS)


def _table(rows: list[Row]) -> tuple[list[str], list[list[str | tuple[str, str]]]]:
    """Return the heads and the cells of a table."""
    return list(rows[0]), [list(row.values()) for row in rows]


def headline(made: Design) -> str:
    """Return the result in one sentence: what is left, then by how much less that is than today's."""
    last = made.points[-1]
    left = f"±{1e3 * last.beam_amplitude.high:.3g} mm, {acceleration(last, last.beam_amplitude.high):.2g} g"
    today = f"today ±{1e3 * max(tone.bare for tone in last.over_frequency):.3g} mm"
    return (
        f"With a grain of {mass(made.grain_mass)} the structure moves by at most {left}, {today}, at a "
        f"{made.problem.drive} of {made.problem.level(last.amplitude)} and {tone(made)}; reduction "
        f"{per_cent(made.reduction)}, efficiency {per_cent(made.efficiency)} over all amplitudes"
    )


def structure(p: Problem) -> str:
    """Return the structure in words, one mode after the other."""
    own = f"{p.mass:.4g} kg · {p.frequency:.4g} Hz · damping ratio {p.damping:.3g}"
    if not p.is_modal:
        return f"{own} of the beam alone"
    further = (
        f"{one.mass:.4g} kg · {math.sqrt(one.stiffness / one.mass) / (2.0 * math.pi):.4g} Hz · damping ratio "
        f"{0.5 * one.damping / math.sqrt(one.stiffness * one.mass):.3g} · {one.drive_factor:.3g} of the drive"
        for one in p.further_modes
    )
    modes = "; ".join(f"mode {k}: {words}" for k, words in enumerate([own, *further], 1))
    return f"{modes}; {'driven by a force' if p.drive == 'force' else 'driven at its support'}"


def tone(made: Design) -> str:
    """Return the excitation's frequency in words."""
    low, high = made.frequencies
    return f"{low:.4g} Hz" if low == high else f"{low:.4g} to {high:.4g} Hz"


def acceleration(one: Point, amplitude: float) -> float:
    """Return the acceleration [g] of an amplitude [m] at a point's frequency."""
    return (2.0 * math.pi * one.frequency) ** 2 * amplitude / STANDARD_GRAVITY


def _tiles(made: Design) -> tuple[tuple[str, str, str], ...]:
    low, high = made.heights
    drive, last = made.motor, made.points[-1]
    most = last.beam_amplitude.high
    at = f"{acceleration(last, most):.2g} g at {made.problem.level(last.amplitude)}"
    least, largest = (per_cent((one, one)) for one in made.reduction)
    beside = f"at most {largest}; efficiency at least {per_cent(made.efficiency[:1] * 2)}"
    return (
        (f"±{1e3 * most:.3g} mm", "structure, at most", at),
        (least, "reduction, at least", beside),
        (mass(made.grain_mass), f"grain, {100 * made.mass_fraction:.3g} % of all", f"⌀ {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * low:.0f}–{1e3 * high:.0f} mm", "heights of the ceiling", f"closed: {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * drive.speed:.3g} mm/s", "speed of the ceiling", f"{1e3 * drive.travel:.0f} mm of travel"),
        (f"{drive.force:.4g} N", "largest force on the ceiling", f"on the floor {drive.floor_force:.4g} N"),
    )


def promise(made: Design) -> list[Row]:
    """Return what is promised at each amplitude: expected of the given structure, beneath it least and largest."""
    scale, unit = made.problem.unit
    return [
        {
            f"{made.problem.drive} [{unit}]": f"±{scale * one.amplitude:.3g}",
            "height [mm]": f"{1e3 * one.height:.1f}",
            "structure [mm]": _bounds(one.beam_amplitude, 1e3, ".3g"),
            "acceleration [g]": _bounds(one.beam_amplitude, acceleration(one, 1.0), ".2g"),
            "today [mm]": _bounds(one.bare_amplitude, 1e3, ".3g"),
            "reduction [%]": _bounds(one.reduction, 100.0, ".1f"),
            "efficiency [%]": _bounds(one.efficiency, 100.0, ".1f"),
            "force, ceiling [N]": _bounds(one.ceiling_force, 1.0, ".3g"),
            "force, floor [N]": _plain(f"{one.floor_force:.3g}"),
            "overlap / r": f"{one.overlap:.3f}",
        }
        for one in made.points
    ]


def _bounds(one: Interval, scale: float, form: str) -> tuple[str, str]:
    """Return what is expected, and the least and the largest."""
    expected, low, high = (f"{scale * value:{form}}" for value in one)
    return _plain(expected), f"{_plain(low)} to {_plain(high)}"


def _plain(text: str) -> str:
    """Return a number without a power of ten where it has at most six digits."""
    return f"{float(text):g}" if "e" in text else text


def _grains(made: Design) -> list[Row]:
    rows: list[Row] = []
    for one in made.candidates:
        reduction, efficiency = (_bounds(each, 100.0, ".1f") for each in (one.reduction, one.efficiency))
        heights, force = "–".join(f"{1e3 * height:.0f}" for height in one.heights), _plain(f"{one.ceiling_force:.3g}")
        rows.append(
            {
                "grain": mass(one.grain_mass),
                "share": f"{100 * one.mass_fraction:.3g} %",
                "diameter": f"{2e3 * one.radius:.1f} mm",
                "reduction [%]": "–" if one.failure else reduction,
                "efficiency [%]": "–" if one.failure else efficiency,
                "heights": "–" if one.failure else f"{heights} mm",
                "force on the ceiling": "–" if one.failure else f"{force} N",
                "remark": one.failure or ("chosen" if one.mass_fraction == made.mass_fraction else ""),
            }
        )
    return rows


def _beside(made: Design) -> list[Row]:
    scale, unit = made.problem.unit
    return [
        {
            "state": row.state,
            f"{made.problem.drive} [{unit}]": f"±{scale * row.amplitude:.3g}",
            "excitation [Hz]": f"{row.frequency:.4g}",
            "today [mm]": f"±{1e3 * row.bare:.3g}",
            "this damper [mm]": f"±{1e3 * row.damper:.3g}",
            "tuned mass [mm]": f"±{1e3 * row.tuned:.3g}",
            "reduction by this damper [%]": f"{100 * row.reductions[0]:.1f}",
            "by the tuned mass [%]": f"{100 * row.reductions[1]:.1f}",
        }
        for row in made.tuned_mass.rows
    ]


def verdict(rows: Sequence[MassRow]) -> str:
    """Return which of both damps better, as designed and where a frequency has changed, and what else differs."""
    last = rows[2]
    better = [row.state for row in rows if row.damper < row.tuned]
    where = f"This damper moves less at: {', '.join(better)}" if better else "It does so in every state here"
    best = (
        "it damps a structure that stays as it is better, at every amplitude alike: where it can be built, build it. "
    )
    return (
        f"A tuned mass of the same weight leaves ±{1e3 * last.tuned:.3g} mm at the largest amplitude, this damper "
        f"±{1e3 * last.damper:.3g} mm; {best if not any(row.damper < row.tuned for row in rows[:3]) else ''}{where}. "
        "What this damper has and a tuned mass has not: no frequency of its own to tune or to drift, a ceiling that "
        "follows what is measured, no spring that carries the stroke. What it has not: any effect at amplitudes that "
        "do not throw the grain; it strikes, and it needs a motor."
    )
