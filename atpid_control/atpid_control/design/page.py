# SPDX-License-Identifier: Apache-2.0
"""The page of a design: self-contained HTML in the style of the reports, light or dark by the reader's setting."""

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files

from atpid_control.design import motor
from atpid_control.design.make import Design
from atpid_control.design.picture import draw
from atpid_control.design.problem import Uncertainty
from atpid_control.report.picture import DARK, LIGHT, Palette


def page(made: Design) -> str:
    """Return the whole page."""
    colours = f":root{{{_colours(LIGHT)}}}@media (prefers-color-scheme: dark){{:root{{{_colours(DARK)}}}}}\n"
    css = files("atpid_control.report").joinpath("data", "page.css").read_text(encoding="utf-8")
    title = escape(headline(made))
    parts = (_header, _tiles, _warnings, _picture, _promise, _grains, _motor, _assumed, _next)
    return "\n".join([
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{colours}{css}img {{ width: 100%; height: auto; }}</style></head><body><main>",
        *(part(made) for part in parts),
        f"<footer>Made by <code>python -m atpid_control design</code> in {made.wall_s:.0f} s. All numbers are in "
        "design.json. The rules and their limits: docs/design.md.</footer></main></body></html>\n",
    ])  # fmt: skip


def headline(made: Design) -> str:
    """Return the result in one sentence."""
    low, high = (100.0 * value for value in made.efficiency)
    first, last = (1e3 * value for value in made.problem.amplitudes)
    if low <= 0.0:
        return (
            f"No reduction can be promised for this structure, support ±{first:.3g} to ±{last:.3g} mm: "
            f"{low:.0f} to {high:.0f} % with a grain of {mass(made.grain_mass)}"
        )
    return (
        f"A grain of {mass(made.grain_mass)} takes {low:.0f} to {high:.0f} % off the resonance of this structure, "
        f"support ±{first:.3g} to ±{last:.3g} mm"
    )


def mass(value: float) -> str:
    """Return a mass [kg] in words."""
    return f"{value:.3g} kg" if value >= 1.0 else f"{1e3 * value:.3g} g"


def _colours(palette: Palette) -> str:
    return "".join(f"--{name}:{value};" for name, value in asdict(palette).items())


def _header(made: Design) -> str:
    p = made.problem
    given = f"{p.mass:g} kg · {p.frequency:g} Hz · damping ratio {p.damping:g} of the beam alone"
    return (
        f'<header><p class="eyebrow">{escape(given)}</p><h1>{escape(headline(made))}</h1>'
        "<p>The <b>efficiency</b> is the reduction of the structure's amplitude against the same structure under the "
        'same excitation with a <b class="given">closed damper</b>. The interval is what all structures within the '
        f"stated uncertainties show, {sum(one.structures for one in made.points)} runs at {len(made.points)} "
        f"amplitudes; {made.check.structures} structures drawn anew between those amplitudes checked it.</p></header>"
    )


def _tiles(made: Design) -> str:
    low, high = made.heights
    drive = made.motor
    shown = (
        (f"{100 * made.efficiency[0]:.0f} %", "reduction, at least", f"at most {100 * made.efficiency[1]:.0f} %"),
        (mass(made.grain_mass), f"grain, {100 * made.mass_fraction:.3g} % of all", f"⌀ {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * low:.0f}–{1e3 * high:.0f} mm", "heights of the ceiling", f"closed: {2e3 * made.radius:.1f} mm"),
        (f"{1e3 * drive.speed:.3g} mm/s", "speed of the ceiling", f"{1e3 * drive.travel:.0f} mm of travel"),
        (f"{drive.force:.4g} N", "largest force on the ceiling",
         f"{drive.torque:.3g} N m at a lever of {1e3 * drive.lever:g} mm"),
    )  # fmt: skip
    tiles = "".join(
        f'<div class="tile"><div class="big">{big}</div><div class="what">{what}</div>'
        f'<div class="sub">{sub}</div></div>'
        for big, what, sub in shown
    )
    return f'<div class="tiles">{tiles}</div>'


def _warnings(made: Design) -> str:
    if not made.warnings:
        return "<h2>Limits</h2><p>None of the limits in docs/design.md is met.</p>"
    lines = "".join(
        f'<li class="warning"><time></time><i></i><span>{escape(line)}</span></li>' for line in made.warnings
    )
    return f'<h2>Limits</h2><ol class="events">{lines}</ol>'


def _picture(made: Design) -> str:
    light, dark = (_embedded(made, palette) for palette in (LIGHT, DARK))
    return (
        f'<figure><picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">'
        f'<img src="{light}" alt="Grain, reduction, heights, cliff, amplitude and force"></picture></figure>'
    )


def _embedded(made: Design, palette: Palette) -> str:
    buffer = io.BytesIO()
    draw(made, palette).savefig(buffer, format="png", dpi=120)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{_cells(heads, row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cells(heads: Sequence[str], row: Sequence[str]) -> str:
    named = zip(heads, row, strict=True)
    return "".join(f'<td data-name="{escape(name)}">{escape(cell)}</td>' for name, cell in named)


def _promise(made: Design) -> str:
    heads = ("support", "height", "efficiency", "expected", "structure", "force on the ceiling", "h' φ/A", "X/A",
             "overlap/r", "ω²X₀/g")  # fmt: skip
    rows = [
        (
            f"±{1e3 * one.amplitude:.3g} mm", f"{1e3 * one.height:.1f} mm",
            f"{100 * one.efficiency.low:.1f}–{100 * one.efficiency.high:.1f} %",
            f"{100 * one.efficiency.expected:.1f} %",
            f"±{1e3 * one.beam_amplitude.low:.3g}–{1e3 * one.beam_amplitude.high:.3g} mm",
            f"{one.ceiling_force.low:.3g}–{one.ceiling_force.high:.3g} N",
            f"{one.clearance * made.mass_fraction / one.amplitude:.2f}",
            f"{one.beam_amplitude.expected / one.amplitude:.2f}", f"{one.overlap:.3f}", f"{one.acceleration:.3g}",
        )
        for one in made.points
    ]  # fmt: skip
    note = (
        "The last four columns have no dimension: clearance times mass fraction over the support's amplitude, "
        "amplitude of the structure over that of the support, deepest overlap over the grain's radius, acceleration "
        "of the closed damper over gravity."
    )
    return f'<h2>Over the amplitudes</h2>{_table(heads, rows)}<p class="note">{note}</p>'


def _grains(made: Design) -> str:
    heads = ("grain", "share", "diameter", "efficiency", "least expected", "heights", "force on the ceiling", "")
    rows = []
    for one in made.candidates:
        about = mass(one.grain_mass), f"{100 * one.mass_fraction:.3g} %", f"{2e3 * one.radius:.1f} mm"
        mark = "chosen" if one.mass_fraction == made.mass_fraction else ""
        if one.failure:
            rows.append((*about, "–", "–", "–", "–", one.failure))
            continue
        spread = f"{100 * one.efficiency.low:.1f}–{100 * one.efficiency.high:.1f} %"
        heights = f"{1e3 * one.heights[0]:.0f}–{1e3 * one.heights[1]:.0f} mm"
        rows.append(
            (*about, spread, f"{100 * one.efficiency.expected:.1f} %", heights, f"{one.ceiling_force:.3g} N", mark)
        )
    return (
        f"<h2>The choice of the grain</h2>{_table(heads, rows)}"
        '<p class="note">Over three amplitudes and the corners of the box of uncertainties; the promise of the chosen '
        "grain is over more of both. Force: of the given structure.</p>"
    )


def _motor(made: Design) -> str:
    drive = made.motor
    facts = {
        "speed": f"{drive.speed:.4g} m/s: over the whole range of amplitudes, or from closed, within the time "
        f"constant of the closed damper, {drive.time_constant:.3g} s",
        "travel": f"{drive.travel:.4g} m over the amplitudes",
        "force": f"{drive.force:.4g} N: largest contact force on the ceiling over the corners, from the contact law",
        "torque": f"{drive.torque:.4g} N m at a lever of {drive.lever:g} m, in proportion to it",
        "impacts": f"{drive.impact_rate:.4g} a second, {drive.impulse:.3g} N s each, "
        f"{drive.mean_force:.3g} N on average",
        "speed over that of impacts": f"{drive.speed_ratio:.2g}, allowed {motor.FAST:g}",
    }
    return f"<h2>The motor</h2><dl>{_facts(facts)}</dl>"


def _facts(facts: dict[str, str]) -> str:
    return "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts.items())


def _assumed(made: Design) -> str:
    p = made.problem
    facts = {
        "excitation": f"a tone at resonance, {made.resonance:.4g} Hz with the chosen grain; gravity {p.gravity:g} m/s²",
        "contact": f"Tsuji's law, restitution {p.restitution:g}, Young's modulus {p.young_modulus:.3g} Pa",
        "grain": f"a sphere of {p.density:g} kg/m³",
    }
    for name, field in Uncertainty.model_fields.items():
        value = getattr(p.uncertainty, name)
        shown = f"± {1e3 * value:g} mm" if name == "height" else f"± {100 * value:g} %"
        facts[f"± {name.replace('_', ' ')}"] = f"{shown}, {(field.description or '').rpartition(' [')[0]}"
    return f"<h2>What is assumed</h2><dl>{_facts(facts)}</dl>"


def _next(made: Design) -> str:
    middle = made.points[len(made.points) // 2]
    return (
        "<h2>To go on</h2><pre>python -m atpid_control bench scene.yaml --out run\n"
        f"python -m atpid_sim simulate scene.yaml --height {middle.height:.5g}</pre>"
    )
