# SPDX-License-Identifier: Apache-2.0
"""The page's parts, each as HTML; empty where a run has no data for it."""

import math
from html import escape

from atpid_control.report.latency import latency_of
from atpid_control.report.run import Ledger, RunEvent
from atpid_control.report.stages import Printed, Stage, measured_decrement
from atpid_control.report.view import View, headline, not_arrived

_OPTIMAL_NOTE = (
    "At the right height the grain meets floor and ceiling once each in every period, each time against the motion of "
    "the beam. Higher, and impacts lose synchronism; lower, and each impact dissipates less."
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
            '<p>The beam is released from a deflection. The <b class="own">damper</b> is compared with the same beam '
            'and a <b class="given">closed damper</b>: beam and grain move as one mass.</p>'
        )
    moving = (
        "The support's amplitude is identified while the beam vibrates, and a motor takes the ceiling to the height "
        "that belongs to it. " if view.own_name == "adaptive" else ""
    )  # fmt: skip
    return (
        f"<p>{moving}The <b>efficiency</b> is the reduction of the beam's amplitude against the same beam under the "
        'same excitation with a <b class="given">closed damper</b>, which holds the grain between floor and ceiling.'
        "</p>"
    )


def tiles(view: View) -> str:
    """Return the main results: one a stage, or the decrements of a free decay."""
    if view.always_closed:
        return ""
    made = [
        f'<div class="tile"><div class="big">{stage.efficiency_text()}</div>'
        f'<div class="what">efficiency, support ±{1e3 * stage.excitation_amplitude:.4g} mm</div>'
        f'<div class="sub">beam ±{stage.undamped_amplitude:.3f} m → {_beam_amplitude(stage)}</div></div>'
        for stage in view.stages
        if math.isfinite(stage.efficiency)
    ]
    if view.decrements is not None:
        own, closed = view.decrements
        scene = view.run.scene
        made = [] if scene is None else [
            _decrement(own, "with the grain free", measured_decrement(scene, scene.ceiling.heights[0][1]), ""),
            _decrement(closed, "with the damper closed", measured_decrement(scene, 0.0), " reference"),
        ]  # fmt: skip
    return f'<div class="tiles">{"".join(made)}</div>' if made else ""


def _beam_amplitude(stage: Stage) -> str:
    if stage.amplitude_spread is None:
        return f"±{stage.amplitude:.3f} m"
    least, largest = stage.amplitude_spread
    return f"±{least:.3f} to {largest:.3f} m: irregular; this run: ±{stage.amplitude:.3f} m"


def _decrement(value: float, what: str, measured: float | None, kind: str) -> str:
    beside = f', <b class="accent">measured on the stand: {measured:.4g}</b>' if measured else ""
    return (
        f'<div class="tile{kind}"><div class="big">{value:.2f}</div><div class="what">{what}</div>'
        f'<div class="sub">largest ratio of successive peaks{beside}</div></div>'
    )


def overview(view: View) -> str:
    """Return the place of the main chart and how to read it."""
    notes = []
    if view.windows:
        notes.append("Shaded: where each stage is measured.")
    if view.stages:
        notes.append("The error of an estimate is shown where the identifier calls it steady.")
    if view.printed:
        notes.append('<b class="accent">Orange</b>: heights the thesis prints (Fig. 4.6).')
    if view.standing is not None:
        notes.append(f"The ceiling stands at {view.standing:.4g} m.")
    if not view.run.simulated:
        notes.append("Displacements as the laser measured them.")
    return (
        '<figure><div class="chart" id="overview" role="img" aria-label="Beam displacement, excitation amplitude and '
        f'ceiling height over time"></div><figcaption>{" ".join(notes)}</figcaption></figure>'
    )


def grain(view: View) -> str:
    """Return the place of the grain's chart."""
    if view.grain_window is None:
        return ""
    text = "Where lines touch, the grain is in contact with a wall, which dissipates energy."
    if view.own_name == "adaptive":
        text = _OPTIMAL_NOTE
    return (
        f"<h2>The grain</h2><p>{text}</p>"
        '<figure><div class="chart" id="grain" role="img" aria-label="Motion of the grain between floor and ceiling">'
        "</div></figure>"
    )


def energy(view: View) -> str:
    """Return where the energy of the run went."""
    ledger = view.run.ledger
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
    mantissa, exponent = f"{ledger.residual:.0e}".split("e")
    left = f"{mantissa} · 10<sup>{int(exponent)}</sup>".replace("-", "−") if ledger.residual else "the last digit"
    keys = "".join(
        f'<li><i style="background:var(--{colour})"></i>{name} <b>{value:.4g} J</b> '
        f"({100.0 * value / total:.0f} %)</li>"
        for name, value, colour in parts
    )
    return (
        f'<h2>Where the energy went</h2><p class="note">{_supplied(ledger)}.'
        f"{'' if view.always_closed else f' The grain had {ledger.impacts} contacts with floor and ceiling.'} "
        f"The ledger closes to {left} of the energy supplied.</p>"
        f'<div class="bar" role="img" aria-label="Shares of the energy">{bar}</div><ul class="keys">{keys}</ul>'
    )


def _supplied(ledger: Ledger) -> str:
    supplied = [f"The support supplied {ledger.input:.4g} J"] if ledger.input else []
    if ledger.ceiling_work:
        verb = "supplied" if ledger.ceiling_work > 0.0 else "took up"
        supplied.append(f"the ceiling's motor {verb} {abs(ledger.ceiling_work):.3g} J")
    if ledger.stored < 0.0:
        supplied.append(f"{-ledger.stored:.4g} J were stored at the start")
    return ", ".join(supplied)


def latency(view: View) -> str:
    """Return how long each stage of the loop took, of a run in real time."""
    if view.run.bag.run.get("clock") != "real time":
        return ""
    found = latency_of(view.run.bag)
    rows = "".join(
        f"<tr><td>{name.replace('_', ' ')}</td>"
        + "".join(f"<td>{1e3 * values[key]:.1f}</td>" for key in ("p50", "p99", "max"))
        + "</tr>"
        for name, values in found.items()
    )
    head = "<tr><th>ms</th><th>median</th><th>99 %</th><th>largest</th></tr>"
    return f"<h2>Latency</h2><table><thead>{head}</thead><tbody>{rows}</tbody></table>" if found else ""


def events(events: list[RunEvent]) -> str:
    """Return the events, in order."""
    if not events:
        return ""
    rows = "".join(
        f'<li class="{_SEVERITIES[min(event.severity, 2)]}"><time>{event.time:.2f} s</time><i></i>'
        f"<span>{escape(event.text or event.kind)}{f', {event.count} times' if event.count > 1 else ''} "
        f'<span class="who">{escape(event.source)}</span></span></li>'
        for event in events
    )
    return f'<h2>What happened when</h2><ol class="events">{rows}</ol>'


def facts(view: View) -> str:
    """Return where the run comes from, what was lost, and which defaults the scene takes."""
    run, result, scene = view.run.bag.run, view.run.bag.result, view.run.scene
    clock, factor = run.get("clock", "–"), result.get("real_time_factor")
    if factor and clock == "lockstep":
        clock = f"{clock}, {float(factor):.1f} times as fast as real time"
    known = {
        "scene": run.get("scene", "–"),
        "seed": str(scene.seed) if scene else "–",
        "run": run.get("run_id", "–"),
        "commit": run.get("commit", "–"),
        "clock": clock,
        "lost": f"{view.run.lost} scans of {len(view.run.motion.time)}, in {view.run.blocks} blocks",
        "answers": f"{len(view.run.estimates.time)} estimates, {len(view.run.ceiling.commanded_time)} commands",
        "recording": "whole" if result.get("finished") == "yes" else "ended before the run did",
    }
    if view.run.scene_problem:
        known["scene"] = view.run.scene_problem
    rows = "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in known.items())
    unusual = _listed("Values of the scene that are unusual:", scene.warnings() if scene else [])
    odd = _listed("Messages that cannot be used, left out:", list(view.run.left_out))
    missing = _listed("Missing from the bag:", view.run.bag.missing)
    defaults = _listed("Values left to defaults:", scene.decisive_defaults(measured=True) if scene else [])
    text = view.run.bag.scene_text
    whole = f"<details><summary>The scene, verbatim</summary><pre>{escape(text)}</pre></details>" if text else ""
    return f"<h2>The run</h2><dl>{rows}</dl>{missing}{odd}{unusual}{defaults}{whole}"


def _listed(title: str, lines: list[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<p class='note defaults'>{title}</p><ul class='note'>{items}</ul>" if items else ""


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
        best = {"height": f"{printed.best_height:.2f} m", "efficiency": f"{100.0 * printed.best_efficiency:.0f} %"}
    efficiency = stage.efficiency_text() if stage.amplitude_spread else number(100.0 * stage.efficiency, ".1f", "%")
    cells = [
        (f"{stage.t0:.4g} to {stage.t1:.4g} s", "", ""),
        (number(1e3 * stage.excitation_amplitude, ".4g", "mm"), "", ""),
        (number(1e3 * stage.identified_amplitude, ".3f", "mm"), "", ""),
        (number(error, "+.3f", "%"), "", ""),
        (number(stage.identified_frequency, ".3f", "Hz"), "", ""),
        (number(stage.height, ".3f", "m") + ("" if stage.arrived else " *"), thesis["height"], best["height"]),
        (number(stage.undamped_amplitude, ".3f", "m"), thesis["closed"], ""),
        (number(stage.amplitude, ".3f", "m"), thesis["beam"], ""),
        (f"<b class='own'>{efficiency}</b>", thesis["efficiency"], best["efficiency"]),
    ]
    return "<tr>" + "".join(_cell(name, *cell) for name, cell in zip(_COLUMNS, cells, strict=True)) + "</tr>"


def _cell(name: str, text: str, thesis: str, best: str) -> str:
    """Return a cell; a narrow page shows its column's name beside it in place of the head."""
    beneath = f'<span class="thesis">{thesis}</span>' if thesis else ""
    beneath += f'<span class="best">{best}</span>' if best else ""
    return f'<td data-name="{name}"><div>{text}{beneath}</div></td>'


def number(value: float, form: str, unit: str) -> str:
    """Return a value in the page's form: a true minus sign, no sign on zero, a dash for NaN."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:{form}}"
    if float(text) == 0.0:  # rounded to zero, it has no sign
        text = text.lstrip("+-")
    return f"{text} {unit}".replace("-", "−")
