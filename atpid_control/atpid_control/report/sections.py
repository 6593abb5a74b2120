# SPDX-License-Identifier: Apache-2.0
"""The page's parts, each as HTML; empty where a run has nothing to say on it."""

from __future__ import annotations

import math
from html import escape

from atpid_control.report.run import Happening, Ledger
from atpid_control.report.stages import Stage
from atpid_control.report.thesis import Printed, measured_decrement
from atpid_control.report.view import View, headline

_THESIS_NOTE = (
    ' Beneath, in <b class="accent">orange</b>, what the thesis prints (section 4.3; read off figures, and sometimes '
    "with the static deflection in it); in grey, the best that a search over all heights finds with this model."
)
_OPTIMAL_NOTE = (
    "At the right height the grain meets floor and ceiling once each in every period, "
    "each time against the motion of the "
    "beam. Higher, and it misses the beat; lower, and it takes less."
)
_SEVERITIES = ("info", "warning", "alarm")


def header(view: View) -> str:
    """Return the result in one sentence, and what it is compared with."""
    run = view.run.bag.run
    parts = [run.get("scene", "no scene"), run.get("created", "")[:16].replace("T", " "), f"{view.run.duration:.4g} s"]
    eyebrow = " · ".join(escape(part) for part in parts if part)
    return f'<header><p class="eyebrow">{eyebrow}</p><h1>{escape(headline(view))}</h1>{_lead(view)}</header>'


def _lead(view: View) -> str:
    if view.always_closed or view.closed is None:
        return ""
    if view.decrements is not None:
        return (
            '<p>The beam is released and left alone. The <b class="own">damper</b> is compared with the same beam and '
            "a "
            '<b class="given">closed damper</b>, which can only swing as one mass.</p>'
        )
    moving = (
        "The support's amplitude is identified while the beam vibrates, and a motor takes the ceiling to the height "
        "that belongs to it. " if view.own_name == "adaptive" else ""
    )  # fmt: skip
    return (
        f"<p>{moving}What is left is compared with the same beam under the same excitation and a "
        '<b class="given">closed damper</b>, in which the grain cannot move.</p>'
    )


def tiles(view: View) -> str:
    """Return the numbers one remembers: one a stage, or the decrements of a free decay."""
    if view.always_closed:
        return ""
    made = [
        f'<div class="tile"><div class="big">−{100.0 * stage.efficiency:.0f} %</div>'
        f'<div class="what">support ±{1e3 * stage.excitation_amplitude:.4g} mm</div>'
        f'<div class="sub">beam ±{stage.undamped_amplitude:.3f} m → ±{stage.amplitude:.3f} m</div></div>'
        for stage in view.stages
        if math.isfinite(stage.efficiency)
    ]
    if view.decrements is not None:
        own, closed = view.decrements
        scene = view.run.scene
        made = (
            [
                _decrement(own, "with the grain free", measured_decrement(scene, scene.ceiling.heights[0][1]), ""),
                _decrement(closed, "with the damper closed", measured_decrement(scene, 0.0), " reference"),
            ]
            if scene is not None
            else []
        )
    return f'<div class="tiles">{"".join(made)}</div>' if made else ""


def _decrement(value: float, what: str, measured: float | None, kind: str) -> str:
    beside = f', <b class="accent">measured on the stand: {measured:.4g}</b>' if measured else ""
    return (
        f'<div class="tile{kind}"><div class="big">{value:.2f}</div><div class="what">{what}</div>'
        f'<div class="sub">largest ratio of successive peaks{beside}</div></div>'
    )


def overview(view: View) -> str:
    """Return the place of the main chart and how to read it."""
    said = []
    if view.windows:
        said.append("Shaded: where each stage is measured.")
    if view.stages:
        said.append("The error of an estimate is shown where the identifier calls it steady.")
    if view.printed:
        said.append('<b class="accent">Orange</b>: heights the thesis prints (Fig. 4.6).')
    if view.standing is not None:
        said.append(f"The ceiling stands at {view.standing:.4g} m.")
    if not view.run.simulated:
        said.append("Displacements as the laser measured them.")
    return (
        '<figure><div class="chart" id="overview" role="img" aria-label="Beam displacement, excitation amplitude and '
        f'ceiling height over time"></div><figcaption>{" ".join(said)}</figcaption></figure>'
    )


def table(view: View) -> str:
    """Return the stages' figures with the thesis's beneath."""
    if not view.stages:
        return ""
    heads = ("stage", "support amplitude", "identified", "error", "frequency", "ceiling height", "beam, closed", "beam",
             "left over")  # fmt: skip
    rows = [_row(stage, view.printed[n] if view.printed else None) for n, stage in enumerate(view.stages)]
    thesis = _THESIS_NOTE if view.printed else ""
    head = "".join(f"<th>{name}</th>" for name in heads)
    return (
        "<h2>Stage by stage</h2>"
        f'<p class="note">Amplitudes are half peak-to-peak, in the shaded windows.{thesis}</p>'
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
    )


def _row(stage: Stage, printed: Printed | None) -> str:
    error = 100.0 * (stage.identified_amplitude / stage.excitation_amplitude - 1.0)
    thesis = best = {"height": "", "closed": "", "beam": "", "left": ""}
    if printed is not None:
        thesis = {
            "height": f"{escape(printed.height_sign)}{printed.height:.2f} m",
            "closed": f"{printed.closed:.2f} m",
            "beam": f"{printed.amplitude:.2f} m",
            "left": f"{100.0 * printed.amplitude / printed.closed:.0f} %",
        }
        best = best | {"height": f"{printed.best_height:.2f} m", "left": f"{100.0 * printed.best_left:.0f} %"}
    return "<tr>" + "".join(
        [
            _cell(f"{stage.t0:.4g} to {stage.t1:.4g} s"),
            _cell(_number(1e3 * stage.excitation_amplitude, ".4g", "mm")),
            _cell(_number(1e3 * stage.identified_amplitude, ".3f", "mm")),
            _cell(_number(error, "+.3f", "%")),
            _cell(_number(stage.identified_frequency, ".3f", "Hz")),
            _cell(_number(stage.height, ".3f", "m"), thesis["height"], best["height"]),
            _cell(_number(stage.undamped_amplitude, ".3f", "m"), thesis["closed"]),
            _cell(_number(stage.amplitude, ".3f", "m"), thesis["beam"]),
            _cell(f"<b class='own'>{_number(100.0 * stage.left, '.1f', '%')}</b>", thesis["left"], best["left"]),
        ]
    ) + "</tr>"  # fmt: skip


def _cell(text: str, thesis: str = "", best: str = "") -> str:
    beneath = f'<span class="thesis">{thesis}</span>' if thesis else ""
    beneath += f'<span class="best">{best}</span>' if best else ""
    return f"<td>{text}{beneath}</td>"


def _number(value: float, form: str, unit: str) -> str:
    return f"{value:{form}} {unit}".replace("-", "−") if math.isfinite(value) else "–"


def grain(view: View) -> str:
    """Return the place of the grain's chart."""
    if view.grain_window is None:
        return ""
    said = "Where lines touch, the grain meets a wall; each meeting turns motion into heat."
    if view.own_name == "adaptive":
        said = _OPTIMAL_NOTE
    return (
        f"<h2>The grain</h2><p>{said}</p>"
        '<figure><div class="chart" id="grain" role="img" aria-label="Motion of the grain between floor and ceiling">'
        "</div></figure>"
    )


def energy(ledger: Ledger | None) -> str:
    """Return where the energy of the run went."""
    if ledger is None:
        return ""
    parts = [
        ("contacts of the grain", ledger.contact_loss, "own"),
        ("the beam's own damping", ledger.beam_loss, "given"),
        ("still in motion", max(0.0, ledger.stored), "accent"),
    ]
    total = sum(value for _, value, _ in parts) or 1.0
    parts = [part for part in parts if part[1] > 0.0]
    bar = "".join(f'<i style="flex:{value / total:.6f};background:var(--{colour})"></i>' for _, value, colour in parts)
    keys = "".join(
        f'<li><i style="background:var(--{colour})"></i>{name} <b>{value:.4g} J</b> '
        f"({100.0 * value / total:.0f} %)</li>"
        for name, value, colour in parts
    )
    brought = [f"The support brought {ledger.input:.4g} J"] if ledger.input else []
    if ledger.ceiling_work:
        verb = "brought" if ledger.ceiling_work > 0.0 else "took"
        brought.append(f"the ceiling's motor {verb} {abs(ledger.ceiling_work):.3g} J")
    if ledger.stored < 0.0:
        brought.append(f"{-ledger.stored:.4g} J were there at the start")
    return (
        f'<h2>Where the energy went</h2><p class="note">{", ".join(brought)}; the grain met the walls {ledger.impacts} '
        f"times. The ledger closes to {_power(ledger.residual)} of the energy that came in.</p>"
        f'<div class="bar" role="img" aria-label="Shares of the energy">{bar}</div><ul class="keys">{keys}</ul>'
    )


def _power(value: float) -> str:
    if value == 0.0:
        return "the last digit"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa} · 10<sup>{int(exponent)}</sup>".replace("-", "−")


def events(events: list[Happening]) -> str:
    """Return what the nodes said, in order."""
    if not events:
        return ""
    rows = "".join(
        f'<li class="{_SEVERITIES[min(event.severity, 2)]}"><time>{event.time:.2f} s</time><i></i>'
        f"<span>{escape(event.text or event.kind)}{f', {event.count} times' if event.count > 1 else ''} "
        f'<span class="who">{escape(event.who)}</span></span></li>'
        for event in events
    )
    return f'<h2>What happened when</h2><ol class="events">{rows}</ol>'


def facts(view: View) -> str:
    """Return where the run comes from, what was lost, and what the scene leaves unsaid."""
    run, result, scene = view.run.bag.run, view.run.bag.result, view.run.scene
    known = {
        "scene": run.get("scene", "–"),
        "seed": str(scene.seed) if scene else "–",
        "run": run.get("run_id", "–"),
        "commit": run.get("commit", "–"),
        "clock": _clock(run.get("clock", "–"), result.get("real_time_factor")),
        "lost": f"{view.run.lost} scans of {len(view.run.motion.time)}, in {view.run.blocks} blocks",
        "answers": f"{len(view.run.estimates.time)} estimates, {len(view.run.ceiling.commanded_time)} commands",
        "recording": "whole" if result.get("finished") == "yes" else "ended before the run did",
    }
    if view.run.scene_problem:
        known["scene"] = view.run.scene_problem
    rows = "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in known.items())
    defaults = "".join(f"<li>{escape(line)}</li>" for line in scene.defaults()) if scene else ""
    more = f"<p class='note defaults'>Values the scene leaves to defaults:</p><ul class='note'>{defaults}</ul>"
    text = view.run.bag.scene_text
    whole = f"<details><summary>The scene, word for word</summary><pre>{escape(text)}</pre></details>" if text else ""
    return f"<h2>The run</h2><dl>{rows}</dl>{more if defaults else ''}{whole}"


def _clock(kind: str, factor: str | None) -> str:
    return f"{kind}, {float(factor):.1f} times as fast as real time" if factor and kind == "lockstep" else kind
