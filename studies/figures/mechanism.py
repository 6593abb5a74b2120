# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The mechanism: one beam with the ceiling closed, too low, right and too high, in motion, and a labelled drawing.

python -m studies figures mechanism --out docs/figures
"""

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np

import atpid_sim as ap
from atpid_common import output
from atpid_sim.figure_style import DARK, LIGHT, Palette
from atpid_sim.system import Array
from studies.figures.mechanism_parts import PIXELS, container, labelled, legend, text

#: The beam [kg], [Hz], [-]; share of the grain, its density [kg/m^3]; support amplitude [m].
MASS, FREQUENCY, DAMPING, FRACTION, DENSITY, SUPPORT = 0.12, 12.0, 0.03, 0.1, 1400.0, 0.003
#: Each case: what it is called and its clearance over the best one.
CASES = (("closed", 0.0), ("too low", 0.35), ("right", 1.0), ("too high", 1.7))
#: Periods of the loop, samples a period, slowness; the motion begins after so many seconds.
_PERIODS, _SAMPLES, _SLOWED, _SETTLED = 6, 32, 15.0, 20.0
#: What the grain does, by the kind of motion.
_HOW = {
    "closed": "the grain is held", "sticking": "the grain rides on its walls",
    "optimal": "strikes both, once a period", "irregular": "the grain strikes irregularly",
}  # fmt: skip
#: Periods behind that, among which those are looked for after which an irregular motion is nearest to where it began.
_LOOKED_AT = 160
#: Size of the animation, of a case in it, and where things are in a case [px].
_WIDE, _TALL, _CASE, _TIP, _ORIGIN, _TRACE = 880, 536, 214, 150, 312, 430
_TRACE_SCALE = 0.5  # of the mechanism's


class Seen(NamedTuple):
    """One case: its height and amplitudes [m], the kind of motion, and series (n,) over the loop [m]."""

    name: str
    height: float
    amplitude: float
    motion: str
    support: Array
    beam: Array  # about the equilibrium
    grain: Array  # its lowest point above the floor


def scene() -> ap.Scene:
    """Return the structure: a light beam, driven at the resonance that it has with the grain held."""
    grain = MASS * FRACTION / (1.0 - FRACTION)
    radius = float((0.75 * grain / (DENSITY * np.pi)) ** (1.0 / 3.0))
    return ap.standard_bench(
        beam={"mass": MASS, "frequency": FREQUENCY, "damping_ratio": DAMPING},
        grain={"mass_fraction": FRACTION, "radius": radius},
        excitation={"amplitude": SUPPORT, "frequency": "resonance"},
        ceiling={"height": 2.0 * radius},
        duration=_SETTLED,
    )


@cache
def cases() -> tuple[Seen, ...]:
    """Return the four cases, simulated; the clearances are shares of that of the best height."""
    system = scene()
    diameter = 2.0 * system.grain.radius
    best = ap.best_height(system).height - diameter
    return tuple(_seen(system, name, diameter + share * best) for name, share in CASES)


def without_damper() -> float:
    """Return the amplitude of the beam without the damper at its own resonance [m]."""
    return float(ap.simulate(scene().with_(excitation={"amplitude": SUPPORT, "frequency": FREQUENCY})).bare_amplitude)


def _seen(system: ap.Scene, name: str, height: float) -> Seen:
    run = ap.simulate(system.with_(height=height))
    period, count = 1.0 / system.frequency_hz, _PERIODS * _SAMPLES
    longer = system.with_(height=height, duration=_SETTLED + (_LOOKED_AT + _PERIODS + 1) * period)
    time = _SETTLED + period * np.arange((_LOOKED_AT + _PERIODS) * _SAMPLES) / _SAMPLES
    motion = ap.trajectory(longer, t_eval=time)
    beam, grain = motion.beam + system.static_deflection, motion.grain - motion.beam
    state = np.stack([beam, motion.beam_velocity / (2.0 * np.pi * FREQUENCY), grain])[:, ::_SAMPLES]
    away = np.abs(state[:, _PERIODS:] - state[:, :-_PERIODS]).sum(axis=0)
    part = slice(int(np.argmin(away)) * _SAMPLES, int(np.argmin(away)) * _SAMPLES + count)
    kind = "irregular" if run.spread else run.motion
    return Seen(name, height, run.amplitude, kind, motion.support[part], beam[part], np.maximum(grain[part], 0.0))


def table() -> str:
    """Return what the pictures show as a Markdown table."""
    bare = without_damper()
    lines = [f"Without the damper, at its own resonance: ±{1e3 * bare:.1f} mm.", ""]
    lines += ["| ceiling | height [mm] | beam [mm] | of that | motion |", "|---|---|---|---|---|"]
    for each in cases():
        size = f"±{1e3 * each.amplitude:.1f} | {100.0 * each.amplitude / bare:.0f} %"
        lines.append(f"| {each.name} | {1e3 * each.height:.1f} | {size} | {each.motion} |")
    return "\n".join(lines)


def draw(folder: Path) -> list[Path]:
    """Draw both pictures into `folder`; return their paths."""
    made = {"mechanism_moving.svg": _moving(), "mechanism.svg": _labelled()}
    output.folder(folder)
    for name, drawing in made.items():
        with output.writing(folder / name):
            (folder / name).write_text(drawing + "\n", encoding="utf-8")
    return [folder / name for name in made]


def _moving() -> str:
    """Return the animation: mechanism and beam's displacement of each case, in CSS that a reader can stop."""
    seen, bare = cases(), without_damper()
    seconds = _PERIODS * _SLOWED / scene().frequency_hz
    frames, parts = [_sweep()], []
    for number, each in enumerate(seen):
        for name, moved in (("b", each.beam), ("g", each.grain), ("s", each.support)):
            frames.append(_keyframes(f"{name}{number}", [f"translateY({-PIXELS * y:.1f}px)" for y in 1e3 * moved]))
        bent = (each.beam - each.support) / max(bare, seen[0].amplitude)
        frames.append(_keyframes(f"r{number}", [f"scaleY({max(abs(y), 1e-3) * (-1) ** (y < 0):.3f})" for y in bent]))
        parts.append(f'<g transform="translate({12 + number * _CASE} 0)">{_case(each, number, bare)}</g>')
    moves = "".join(
        f".{one}{n}{{animation:{one}{n} {seconds:.2f}s linear infinite}}" for one in "bgsr" for n in range(4)
    )
    words = [
        text(20, 32, "One loose grain damps a beam, if its ceiling has the right height", "title"),
        legend(20, 58),
        f'<rect x="{14 + 2 * _CASE}" y="70" width="{_CASE - 8}" height="{_TALL - 110}" rx="6" class="inside"/>',
        text(
            20,
            _TALL - 14,
            f"Simulated: beam of {1e3 * MASS:g} g at {FREQUENCY:g} Hz, support ±{1e3 * SUPPORT:g} mm, "
            f"grain {100 * FRACTION:g} %; {_SLOWED:g} times slower. Per cent: of dashed.",
            "small",
        ),
    ]
    return _svg(_WIDE, _TALL, "".join([*words, *parts]), moves + ".t{animation:t " f"{seconds:.2f}s linear infinite}}"
                + "".join(frames))  # fmt: skip


def _case(each: Seen, number: int, bare: float) -> str:
    """Return one case; its clamp is at the left and the beam's displacement below."""
    share = f"{100.0 * each.amplitude / bare:.0f} %"
    much = f"±{1e3 * each.amplitude:.0f} mm"
    kind = "good" if each.name == "right" else "head"
    reach, scale, length = 1e3 * bare * PIXELS, _TRACE_SCALE, _CASE - 34
    x = np.linspace(0.0, length, len(each.beam))
    points = " ".join(f"{a:.1f},{-PIXELS * scale * b:.1f}" for a, b in zip(x, 1e3 * each.beam, strict=True))
    dashed = "".join(f'<path d="M0 {s * reach * scale:.1f}H{length}" class="bare"/>' for s in (-1, 1))
    return "".join([
        text(8, 92, each.name, kind), text(8, 112, _HOW[each.motion], "small"),
        f'<g class="s{number}"><rect x="0" y="{_ORIGIN - 34}" width="12" height="68" class="clamp"/></g>',
        f'<g transform="translate(12 {_ORIGIN})"><g class="s{number}"><g class="r{number}"><path d="{_bend(reach)}" '
        'class="beam"/></g></g></g>',
        f'<g transform="translate({_TIP} {_ORIGIN})"><g class="b{number}">',
        container(each.height, scene().grain.radius, f"g{number}"), "</g></g>",
        f'<g transform="translate(8 {_TRACE})">{dashed}<polyline points="{points}" class="trace"/>'
        f'<g class="t"><g transform="scale({scale})"><circle r="{5 / scale:.1f}" class="dot b{number}"/></g></g></g>',
        text(8, _TALL - 52, much, kind), text(_CASE - 28, _TALL - 52, share, "end " + kind),
    ])  # fmt: skip


def _bend(reach: float) -> str:
    """Return a cantilever's shape under a load at its tip, bent up by `reach` [px], which a scale then bends."""
    x = np.linspace(0.0, 1.0, 13)
    y = -reach * 0.5 * x**2 * (3.0 - x)
    return "M" + "L".join(f"{(_TIP - 12) * a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))


def _keyframes(name: str, moves: list[str]) -> str:
    """Return a loop through these transforms; one that is like the one before is left out."""
    step = 100.0 / len(moves)
    kept = [(step * k, move) for k, move in enumerate(moves) if k == 0 or move != moves[k - 1]]
    steps = "".join(f"{at:.4g}%{{transform:{move}}}" for at, move in [*kept, (100.0, moves[0])])
    return f"@keyframes {name}{{{steps}}}"


def _sweep() -> str:
    return f"@keyframes t{{0%{{transform:translateX(0)}}100%{{transform:translateX({_CASE - 34}px)}}}}"


def _labelled() -> str:
    """Return the drawing of the mechanism at the best height, with its parts and dimensions named."""
    best = cases()[2]
    return _svg(880, 430, labelled(best.height, scene().grain.radius, SUPPORT, FRACTION), "")


def _svg(width: int, height: int, content: str, moves: str) -> str:
    """Return a drawing on a ground of its own, in the colours of the reader's scheme, with its numbers inside."""
    numbers = {each.name: [round(1e3 * each.height, 2), round(1e3 * each.amplitude, 2)] for each in cases()}
    style = (
        _colours(LIGHT) + "@media(prefers-color-scheme:dark){" + _colours(DARK) + "}" + _LOOKS + moves
        + "@media(prefers-reduced-motion:reduce){*{animation:none!important}}"
    )  # fmt: skip
    said = "; ".join(
        f"{each.name}: height {1e3 * each.height:.1f} mm, beam {1e3 * each.amplitude:.1f} mm" for each in cases()
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        f'font-family="DejaVu Sans,Verdana,Helvetica,Arial,sans-serif" font-size="14"><title>{escape(said)}</title>'
        f"<metadata>{json.dumps(numbers)}</metadata><style>{style}</style>"
        f'<rect width="{width}" height="{height}" rx="8" class="paper"/>{content}</svg>'
    )


def _colours(palette: Palette) -> str:
    names = ("paper", "ink", "muted", "grid", "given", "own", "soft", "accent", "window")
    return "svg{" + "".join(f"--{name}:{getattr(palette, name)};" for name in names) + "}"


_LOOKS = (
    "text{fill:var(--ink)}.paper{fill:var(--paper)}.title{font-size:20px;font-weight:700}.head,.good{font-size:17px;"
    "font-weight:700}.good{fill:var(--own)}.small{font-size:14px;fill:var(--muted)}.end{text-anchor:end}"
    ".middle{text-anchor:middle}.clamp{fill:var(--muted)}.beam{fill:none;stroke:var(--ink);stroke-width:5;"
    "vector-effect:non-scaling-stroke}.wall{fill:none;stroke:var(--ink);stroke-width:2}.plate{fill:var(--own)}"
    ".screw{stroke:var(--own);stroke-width:3}.motor{fill:var(--soft);stroke:var(--own);stroke-width:1.5}"
    ".grain{fill:var(--accent)}.floor{fill:var(--ink)}.inside{fill:var(--window)}"
    ".bare{fill:none;stroke:var(--muted);stroke-width:1.5;stroke-dasharray:5 4}.trace{fill:none;stroke:var(--own);"
    "stroke-width:1.6;stroke-linejoin:round}.dot{fill:var(--own)}.size{fill:none;stroke:var(--muted);"
    "stroke-width:1.2}.tip{fill:var(--muted)}"
)


def numbers_of(drawing: Path) -> dict[str, Any]:
    """Return heights and amplitudes [mm] by case that a drawing carries."""
    found: dict[str, Any] = json.loads(drawing.read_text(encoding="utf-8").partition("<metadata>")[2].partition("<")[0])
    return found
