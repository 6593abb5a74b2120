# SPDX-License-Identifier: Apache-2.0
"""The page's parts, each as HTML; empty where a run has nothing to say on it."""

from __future__ import annotations

import math
from html import escape

from atpid_control.report.run import Happening, Ledger
from atpid_control.report.stages import Stage
from atpid_control.report.thesis import Printed
from atpid_control.report.view import View, headline

_SEVERITIES = ("info", "warning", "alarm")


def header(view: View) -> str:
    run = view.run.bag.run
    parts = [run.get("scene", "no scene"), run.get("created", "")[:16].replace("T", " "), f"{view.run.duration:.4g} s"]
    eyebrow = " · ".join(escape(part) for part in parts if part)
    return f'<header><p class="eyebrow">{eyebrow}</p><h1>{escape(headline(view))}</h1>{_lead(view)}</header>'


def _lead(view: View) -> str:
    if view.always_closed or view.closed is None:
        return ""
    if view.decrements is not None:
        return (
            '<p>The beam is released and left alone. The <b class="own">damper</b> is compared with the same beam and its '
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
    if view.always_closed:
        return ""
    tiles = [
        f'<div class="tile"><div class="big">−{100.0 * stage.efficiency:.0f} %</div>'
        f'<div class="what">support ±{1e3 * stage.excitation_amplitude:.4g} mm</div>'
        f'<div class="sub">beam ±{stage.undamped_amplitude:.3f} m → ±{stage.amplitude:.3f} m</div></div>'
        for stage in view.stages
        if math.isfinite(stage.efficiency)
    ]
    if view.decrements is not None:
        own, closed = view.decrements
        tiles = [
            f'<div class="tile"><div class="big">{value:.2f}</div><div class="what">{what}</div>'
            '<div class="sub">largest ratio of successive peaks</div></div>'
            for value, what in ((own, "with the grain free"), (closed, "damper closed"))
        ]
    return f'<div class="tiles">{"".join(tiles)}</div>' if tiles else ""


def overview(view: View) -> str:
    said = []
    if view.windows:
        said.append("Shaded: where each stage is measured.")
    if view.stages:
        said.append("The error of an estimate is shown where the identifier calls it steady.")
    if view.printed:
        said.append('<b class="accent">Orange</b>: heights the thesis prints (Fig. 4.6).')
    if not view.run.simulated:
        said.append("Displacements as the laser measured them.")
    return (
        '<figure><div class="chart" id="overview" role="img" aria-label="Beam displacement, excitation amplitude and '
        f'ceiling height over time"></div><figcaption>{" ".join(said)}</figcaption></figure>'
    )


def table(view: View) -> str:
    if not view.stages:
        return ""
    heads = ("stage", "support amplitude", "identified", "error", "frequency", "ceiling height", "beam, closed", "beam",
             "left over")  # fmt: skip
    rows = [_row(stage, view.printed[n] if view.printed else None) for n, stage in enumerate(view.stages)]
    thesis = (
        ' Under each figure, in <b class="accent">orange</b>, what the thesis prints (section 4.3); its beam amplitudes were '
        "read off figures and may include the static deflection." if view.printed else ""
    )  # fmt: skip
    head = "".join(f"<th>{name}</th>" for name in heads)
    return (
        "<h2>Stage by stage</h2>"
        f'<p class="note">Amplitudes are half peak-to-peak, in the shaded windows.{thesis}</p>'
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
    )


def _row(stage: Stage, printed: Printed | None) -> str:
    def cell(text: str, thesis: str = "") -> str:
        beside = f'<span class="thesis">{thesis}</span>' if thesis else ""
        return f"<td>{text}{beside}</td>"

    error = 100.0 * (stage.identified_amplitude / stage.excitation_amplitude - 1.0)
    given = {"height": "", "closed": "", "beam": "", "left": ""}
    if printed is not None:
        given = {
            "height": f"{printed.height_sign.replace('> ', '&gt; ')}{printed.height:.2f} m",
            "closed": f"{printed.closed:.2f} m",
            "beam": f"{printed.amplitude:.2f} m",
            "left": f"{100.0 * printed.amplitude / printed.closed:.0f} %",
        }
    return "<tr>" + "".join(
        [
            cell(f"{stage.t0:.4g} to {stage.t1:.4g} s"),
            cell(_number(1e3 * stage.excitation_amplitude, ".4g", "mm")),
            cell(_number(1e3 * stage.identified_amplitude, ".3f", "mm")),
            cell(_number(error, "+.2f", "%")),
            cell(_number(stage.identified_frequency, ".3f", "Hz")),
            cell(_number(stage.height, ".3f", "m"), given["height"]),
            cell(_number(stage.undamped_amplitude, ".3f", "m"), given["closed"]),
            cell(_number(stage.amplitude, ".3f", "m"), given["beam"]),
            cell(f"<b class='own'>{_number(100.0 * stage.left, '.1f', '%')}</b>", given["left"]),
        ]
    ) + "</tr>"  # fmt: skip


def _number(value: float, form: str, unit: str) -> str:
    return f"{value:{form}} {unit}".replace("-", "−") if math.isfinite(value) else "–"


def grain(view: View) -> str:
    if view.grain_window is None:
        return ""
    return (
        "<h2>Why it works</h2><p>At the right height the grain meets "
        "floor and ceiling once each in every period, each time "
        "against the motion of the beam. Much higher, and it misses the beat; lower, and it takes less.</p>"
        '<figure><div class="chart" id="grain" role="img" aria-label="Motion of the grain between floor and ceiling"></div>'
        "</figure>"
    )


def energy(ledger: Ledger | None) -> str:
    if ledger is None:
        return ""
    parts = [("contacts of the grain", ledger.contact_loss, "own"), ("the beam's own damping", ledger.beam_loss, "given"),
             ("still in motion", max(0.0, ledger.stored), "accent")]  # fmt: skip
    total = sum(value for _, value, _ in parts) or 1.0
    bar = "".join(f'<i style="flex:{value / total:.6f};background:var(--{colour})"></i>' for _, value, colour in parts)
    keys = "".join(
        f'<li><i style="background:var(--{colour})"></i>{name} <b>{value:.4g} J</b> ({100.0 * value / total:.0f} %)</li>'
        for name, value, colour in parts
    )
    work = f"The support brought {ledger.input:.4g} J and the ceiling's motor {ledger.ceiling_work:.3g} J"
    if ledger.stored < 0.0:
        work += f"; {-ledger.stored:.4g} J were there at the start"
    return (
        f'<h2>Where the energy went</h2><p class="note">{work.replace("-", "−")}, in {ledger.impacts} impacts. '
        f"The ledger closes to {_power(ledger.residual)}.</p>"
        f'<div class="bar" role="img" aria-label="Shares of the energy">{bar}</div><ul class="keys">{keys}</ul>'
    )


def _power(value: float) -> str:
    if value == 0.0:
        return "the last digit"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa} · 10<sup>{int(exponent)}</sup>".replace("-", "−")


def events(events: list[Happening]) -> str:
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
    run, result, scene = view.run.bag.run, view.run.bag.result, view.run.scene
    facts = {
        "scene": run.get("scene", "–"),
        "seed": str(scene.seed) if scene else "–",
        "run": run.get("run_id", "–"),
        "commit": run.get("commit", "–"),
        "clock": _clock(run.get("clock", "–"), result.get("real_time_factor")),
        "lost": f"{view.run.lost} scans of {len(view.run.motion.time)}, in {view.run.blocks} blocks",
        "answers": f"{len(view.run.estimates.time)} estimates, {len(view.run.ceiling.commanded_time)} commands",
        "recording": "closed in order" if result.get("finished") == "yes" else "ended before the run did",
    }
    if view.run.scene_problem:
        facts["scene"] = view.run.scene_problem
    rows = "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    defaults = "".join(f"<li>{escape(line)}</li>" for line in scene.defaults()) if scene else ""
    more = (
        "<p class='note' style='margin-top:22px'>Values the scene "
        f"leaves to defaults:</p><ul class='note'>{defaults}</ul>"
    )
    text = view.run.bag.scene_text
    whole = f"<details><summary>The scene, word for word</summary><pre>{escape(text)}</pre></details>" if text else ""
    return f"<h2>The run</h2><dl>{rows}</dl>{more if defaults else ''}{whole}"


def _clock(kind: str, factor: str | None) -> str:
    return f"{kind}, {float(factor):.1f} times as fast as real time" if factor and kind == "lockstep" else kind
