# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a design: self-contained HTML in the style of the reports, light or dark by the reader's setting."""

import math
from collections.abc import Sequence
from html import escape

from atpid_control.views.report.stages import per_cent
from atpid_control.views.static_page import Cell, document, drawn, facts, table, warnings
from atpid_design import motor
from atpid_design.make import Design
from atpid_design.picture import mass, panels, sketch
from atpid_design.problem import STANDARD_GRAVITY, Problem, Uncertainty
from atpid_design.tuned_mass import MassRow
from atpid_design.worst_case import Interval, Point

_CSS = """
h1 { max-width: 32em; } .tiles { grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); }
ol.events li { grid-template-columns: 10px 1fr; }
"""


def page(made: Design) -> str:
    """Return the whole page."""
    parts = (_header, _tiles, _warnings, _panels, _promise, _grains, _motor, _tuned_mass, _assumed, _next, _footer)
    return document(headline(made), (part(made) for part in parts), _CSS)


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


def _header(made: Design) -> str:
    p = made.problem
    given = structure(p)
    moves = f"The grain moves the resonance from {p.frequency:.2f} to {made.resonance:.2f} Hz (damper closed). "
    if p.excitation_frequency is None:
        stated = (
            f"All of this is for an excitation at {made.resonance:.2f} Hz, the resonance with the closed damper. "
            f"Today's structure has its own at {p.frequency:.2f} Hz, where it would move by "
            f"±{1e3 * made.bare_resonance_amplitude:.3g} mm, and moves less here: for a machine that runs at a "
            "frequency of its own, state it by --excitation-frequency."
        )
    else:
        stated = f"All of this is for an excitation at {tone(made)}, at the worst of the frequencies."
    return (
        f'<header><p class="eyebrow">{escape(given)}</p><h1>{escape(headline(made))}</h1>'
        f"<p>{escape(moves + stated)}</p><p>The <b>reduction</b> is against the structure of today, without the damper "
        "but with its container, and the <b>efficiency</b> against the same structure with a "
        '<b class="given">closed damper</b>, both at the same excitation. The intervals are what all structures within '
        f"the stated uncertainties show, {sum(one.structures for one in made.points)} runs at {len(made.points)} "
        f"amplitudes; {made.check.structures} structures drawn anew between those amplitudes checked them.</p></header>"
    )


def _tiles(made: Design) -> str:
    low, high = made.heights
    drive, last = made.motor, made.points[-1]
    shown = (
        (f"±{1e3 * last.beam_amplitude.high:.3g} mm", "structure, at most",
         f"{acceleration(last, last.beam_amplitude.high):.2g} g at {made.problem.level(last.amplitude)}"),
        (per_cent(made.reduction[:1] * 2), "reduction, at least",
         f"at most {per_cent(made.reduction[1:] * 2)}; efficiency at least {per_cent(made.efficiency[:1] * 2)}"),
        (mass(made.grain_mass), f"grain, {100 * made.mass_fraction:.3g} % of all", f"⌀ {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * low:.0f}–{1e3 * high:.0f} mm", "heights of the ceiling", f"closed: {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * drive.speed:.3g} mm/s", "speed of the ceiling", f"{1e3 * drive.travel:.0f} mm of travel"),
        (f"{drive.force:.4g} N", "largest force on the ceiling", f"on the floor {drive.floor_force:.4g} N"),
    )  # fmt: skip
    tiles = "".join(
        f'<div class="tile"><div class="big">{big}</div><div class="what">{what}</div>'
        f'<div class="sub">{sub}</div></div>'
        for big, what, sub in shown
    )
    return f'<div class="tiles">{tiles}</div>'


def _warnings(made: Design) -> str:
    return f"<h2>Limits</h2>{warnings(made.warnings) or '<p>None of the limits in docs/design.md is met.</p>'}"


def _panels(made: Design) -> str:
    return drawn(panels(made))


def _promise(made: Design) -> str:
    (scale, unit), drive = made.problem.unit, made.problem.drive
    heads = (f"{drive} [{unit}]", "height [mm]", "structure [mm]", "acceleration [g]", "today [mm]", "reduction [%]",
             "efficiency [%]", "force, ceiling [N]", "force, floor [N]", "overlap / r")  # fmt: skip
    rows = [
        (
            f"±{scale * one.amplitude:.3g}", f"{1e3 * one.height:.1f}", _bounds(one.beam_amplitude, 1e3, ".3g"),
            _bounds(one.beam_amplitude, acceleration(one, 1.0), ".2g"), _bounds(one.bare_amplitude, 1e3, ".3g"),
            _bounds(one.reduction, 100.0, ".1f"), _bounds(one.efficiency, 100.0, ".1f"),
            _bounds(one.ceiling_force, 1.0, ".3g"), _plain(f"{one.floor_force:.3g}"), f"{one.overlap:.3f}",
        )
        for one in made.points
    ]  # fmt: skip
    note = (
        "Each: what is expected of the given structure, beneath it the least and the largest of all cases. Structure: "
        "its amplitude and acceleration with the damper; today: its amplitude without. Force on the floor: largest. "
        "Overlap / r: how deep the grain is pressed into a wall, over its radius; Hertz's law is for up to 0.1."
    )
    shown = table("Over the amplitudes", heads, rows)
    return f'<h2>Over the amplitudes</h2>{shown}<p class="note">{note}</p>'


def span(one: Interval, scale: float, form: str) -> str:
    """Return an interval in words, multiplied by a scale."""
    return "{} ({})".format(*_bounds(one, scale, form))


def _bounds(one: Interval, scale: float, form: str) -> tuple[str, str]:
    """Return what is expected, and the least and the largest."""
    expected, low, high = (f"{scale * value:{form}}" for value in one)
    return _plain(expected), f"{_plain(low)} to {_plain(high)}"


def _plain(text: str) -> str:
    """Return a number without a power of ten where it has at most six digits."""
    return f"{float(text):g}" if "e" in text else text


def _grains(made: Design) -> str:
    heads = ("grain", "share", "diameter", "reduction [%]", "efficiency [%]", "heights", "force on the ceiling",
             "remark")  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for one in made.candidates:
        about = mass(one.grain_mass), f"{100 * one.mass_fraction:.3g} %", f"{2e3 * one.radius:.1f} mm"
        mark = "chosen" if one.mass_fraction == made.mass_fraction else ""
        if one.failure:
            rows.append((*about, "–", "–", "–", "–", one.failure))
            continue
        heights = f"{1e3 * one.heights[0]:.0f}–{1e3 * one.heights[1]:.0f} mm"
        rows.append(
            (*about, _bounds(one.reduction, 100.0, ".1f"), _bounds(one.efficiency, 100.0, ".1f"), heights,
             _plain(f"{one.ceiling_force:.3g}") + " N", mark)
        )  # fmt: skip
    return (
        f"<h2>The choice of the grain</h2>{table('The choice of the grain', heads, rows)}"
        '<p class="note">The least expected, beneath it least and largest, over three amplitudes and the corners of '
        "the box of uncertainties; the rule of the choice: docs/design.md. The promise of the chosen grain is over "
        "more of both. Force: of the given structure.</p>"
    )


def _motor(made: Design) -> str:
    drive = made.motor
    given = made.problem.yield_strength
    bears = "" if given is None else f"; given {1e-6 * given:.4g} MPa"
    listed = {
        "speed": f"{1e3 * drive.speed:.4g} mm/s: over the whole range of amplitudes, or from closed, within the time "
        f"constant of the closed damper, {drive.time_constant:.3g} s",
        "travel": f"{1e3 * drive.travel:.4g} mm over the amplitudes, {drive.travel_time:.3g} s at that speed; duty: "
        "that long after each change of the excitation over its whole range, else it stands",
        "position": f"an error of {1e3 * drive.height_error:.2g} mm costs two points of reduction at the most "
        f"sensitive amplitude; within the promise: {1e3 * made.problem.uncertainty.height:g} mm",
        "screw and gear": f"lead {1e3 * drive.lead:g} mm, and {drive.gear:.3g} turns of a motor with "
        f"{drive.motor_speed:g} 1/min for one of the screw",
        "torque on the screw": f"{drive.screw_torque:.3g} N m, {drive.screw_torque / drive.gear:.2g} N m at the motor, "
        f"against the mean force of the impacts, a screw with {100 * motor.SCREW_EFFICIENCY:.0f} % efficiency, which "
        "does not move back",
        "power": f"{drive.power:.3g} W; each kg of ceiling adds {9.81 * drive.speed / motor.SCREW_EFFICIENCY:.2g} W",
        "held at rest": f"{drive.force:.4g} N by screw and bearings at each impact, on average "
        f"{drive.mean_force:.3g} N",
        "force on the ceiling": f"{drive.force:.4g} N: largest contact force over the corners, from the contact law",
        "force on the floor": f"{drive.floor_force:.4g} N, likewise",
        "torque of a lever": f"{drive.torque:.4g} N m at {1e3 * drive.lever:g} mm, where a lever and not a screw holds "
        "the ceiling, in proportion to it",
        "impacts": f"{drive.impact_rate:.4g} a second, {drive.impact_rate * 86400:.2g} a day: more than 10 million "
        f"within {1e7 / max(drive.impacts_a_day, 1e-9):.2g} days, so take fatigue strength for all that bears them; "
        f"{drive.impulse:.3g} N s each",
        "contact": f"peak pressure {1e-6 * drive.pressure:.4g} MPa under the largest force (Hertz); yield begins below "
        f"the surface at {motor.YIELD_BEGINS:g} times the yield strength (Johnson 1985), so from "
        f"{1e-6 * drive.yield_strength:.4g} MPa on nothing yields{bears}",
        "noise": f"{drive.sound_power_level:.0f} dB re 1 pW, {drive.sound_power_level - 11.0:.0f} dB re 20 µPa at 1 m "
        "in a free field, unweighted: the grain alone, a rigid sphere in free air that the contact force accelerates "
        "(Koss 1974). The ringing of container, beam and floor is not in it and is usually the larger part: measure it",
        "speed over that of impacts": f"{drive.speed_ratio:.2g}, allowed {motor.FAST:g}",
    }
    return f"<h2>Motor and container</h2><figure>{sketch(made)}</figure>{facts(listed)}"


def _tuned_mass(made: Design) -> str:
    one = made.tuned_mass
    (scale, unit), drive = made.problem.unit, made.problem.drive
    heads = ("state", f"{drive} [{unit}]", "excitation [Hz]", "today [mm]", "this damper [mm]", "tuned mass [mm]",
             "reduction by this damper [%]", "by the tuned mass [%]")  # fmt: skip
    rows = [
        (
            row.state, f"±{scale * row.amplitude:.3g}", f"{row.frequency:.4g}", f"±{1e3 * row.bare:.3g}",
            f"±{1e3 * row.damper:.3g}", f"±{1e3 * row.tuned:.3g}",
            *(f"{100 * value:.1f}" for value in row.reductions),
        )
        for row in one.rows
    ]  # fmt: skip
    band = (
        "at any frequency"
        if made.problem.excitation_frequency is None
        else "from {:.4g} to {:.4g} Hz".format(*one.band)
    )
    return (
        f"<h2>Beside a tuned mass</h2><p>{escape(verdict(one.rows))}</p>"
        f"{table('Beside a tuned mass', heads, rows)}"
        f'<p class="note">A mass of {mass(one.mass)} on a spring of its own, {one.frequency:.4g} Hz, damping ratio '
        f"{one.damping_ratio:.3g} ({one.damping:.3g} N s/m), the best {band}; it swings by ±{1e3 * one.stroke:.3g} mm "
        "against the structure at the largest amplitude. It is ideal: linear, its spring without mass. In other "
        "states nothing is designed anew: spring and damper stay, and the ceiling at the designed height.</p>"
    )


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


def _assumed(made: Design) -> str:
    p = made.problem
    listed = {
        "excitation": f"a tone at {tone(made)}"
        + (", the resonance of each structure with the closed damper" if p.excitation_frequency is None else ""),
        "gravity": f"{p.gravity:g} m/s² along the motion"
        if p.gravity > 0.0
        else "none along the motion, which is "
        "horizontal: floor and ceiling are the two end walls, height the distance between them; that the grain then "
        "lies on a side wall, slides and rolls there (7/5 of its inertia), is left out",
        "contact": f"Tsuji's law, restitution {p.restitution:g}, Young's modulus {p.young_modulus:.3g} Pa",
        "grain": f"a sphere of {p.density:g} kg/m³",
    }
    if p.is_modal:
        listed["modes"] = (
            f"{1 + len(p.further_modes)}, each with mass, frequency and damping of its own as uncertain as those of "
            "the first; shares of the drive are exact. Modes not given are left out: their static compliance at the "
            "container is missing. The restitution is that against the mass an impulse there meets"
        )
    for name, field in Uncertainty.model_fields.items():
        value = getattr(p.uncertainty, name)
        shown = f"± {1e3 * value:g} mm" if name == "height" else f"± {100 * value:g} %"
        listed[f"± {name.replace('_', ' ')}"] = f"{shown}, {(field.description or '').rpartition(' [')[0]}"
    return f"<h2>What is assumed</h2>{facts(listed)}"


def _next(made: Design) -> str:
    middle = made.points[len(made.points) // 2]
    bench = "atpid bench scene.yaml --out run\n" if made.problem.drive == "support" else ""  # a force drives no loop
    return f'<h2>To go on</h2><pre tabindex="0">{bench}atpid simulate scene.yaml --height {middle.height:.5g}</pre>'


def _footer(made: Design) -> str:
    return (
        f"<footer>Made by <code>atpid design</code> in {made.wall_s:.0f} s. All numbers are in design.json. The rules "
        "and their limits: docs/design.md.</footer>"
    )
