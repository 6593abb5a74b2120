# SPDX-License-Identifier: Apache-2.0
"""The page of a campaign: its curves with error bars beside simulation of the same points, each with its own report."""

import json
import math
from collections.abc import Iterator, Sequence
from functools import partial
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from plotly.offline import get_plotlyjs

from atpid_common.output import writing
from atpid_control.campaign.folder import CampaignFolder
from atpid_control.campaign.plan import Campaign, Point, points_of
from atpid_control.campaign.result import GIVEN, simulated
from atpid_control.views.report.charts import Figure, Marked, points
from atpid_control.views.report.make import PAGE, report
from atpid_control.views.static_page import Link, document, facts, table, warnings
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import HERE, Batch, Progress, Workers

#: Standard deviations within which measurement and simulation agree.
AGREE = 2.0
_COLOURS = ("own", "given", "accent", "ink", "muted")
#: Charts: the quantity of a point that varies along the axis, its unit and scale, and the words for the chart.
_AXES = (
    ("ceiling", "height of the ceiling, mm", 1e3, "Efficiency over the height"),
    ("grain_mass", "mass of the grain, g", 1e3, "Efficiency over the grain's mass"),
    ("amplitude", "amplitude of the excitation, mm or mN", 1e3, "Efficiency over the amplitude"),
    ("ratio", "frequency over the resonance", 1.0, "Beam over the frequency"),
)
_HEADS = ("point", "excitation", "frequency", "height", "beam", "simulated", "apart", "efficiency", "motion", "attempt")
_CLICK = (
    'document.querySelectorAll(".chart").forEach((chart) => chart.on("plotly_click", (event) => {'
    " const page = event.points[0].customdata; if (page) location.href = page; }));"
)


class Compared(NamedTuple):
    """A point that was measured, beside its simulation."""

    point: Point
    record: dict[str, Any]  # with what `simulated` returns

    @property
    def apart(self) -> float:
        """Measured less simulated amplitude over the standard deviation of their difference [-]."""
        record = self.record
        error = math.hypot(record["beam_amplitude_std"], record["simulated_amplitude_std"])
        return float((record["beam_amplitude"] - record["simulated_amplitude"]) / error)


def compared(
    campaign: Campaign, scene: Scene, folder: CampaignFolder, workers: Workers = HERE, progress: Progress | None = None
) -> list[Compared]:  # fmt: skip
    """Return all points measured, by number, each simulated at the excitation and height that were measured."""
    records = folder.records()
    found = [(point, records[point.number]) for point in sorted(points_of(campaign, scene), key=lambda one: one.number)
             if records.get(point.number, {}).get("status") == "measured"]  # fmt: skip
    jobs = [(point, tuple((name, record[name]) for name in GIVEN)) for point, record in found]
    beside = Batch(partial(_simulated, campaign, scene), jobs, processes=True).run(workers, progress)
    return [Compared(point, record | more) for (point, record), more in zip(found, beside, strict=True)]


def _simulated(campaign: Campaign, scene: Scene, job: tuple[Point, tuple[tuple[str, float], ...]]) -> dict[str, float]:
    return simulated(campaign, scene, job[0], dict(job[1]))


def write_page(
    campaign: Campaign, scene: Scene, folder: CampaignFolder, workers: Workers = HERE, progress: Progress | None = None
) -> Path:
    """Write index.html, comparison.json and each point's report; return the page. Raises OutputError, BagError."""
    found = compared(campaign, scene, folder, workers, progress)
    for one in found:
        place = folder.place(one.point.number)
        if not (place / "report" / PAGE).is_file():
            report(place / "bag", place / "report")
    page = folder.path / "index.html"
    rows = [one.record | {"apart": one.apart} for one in found]
    with writing(page):
        (folder.path / "comparison.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        page.write_text(_html(campaign, folder, found), encoding="utf-8")
    return page


def _html(campaign: Campaign, folder: CampaignFolder, found: Sequence[Compared]) -> str:
    figures = dict(_figures(found))
    records = folder.records()
    skipped = [f"{one['point']}: skipped: {one['reason']}" for one in records.values() if one["status"] != "measured"]
    agree = sum(abs(one.apart) <= AGREE for one in found)
    code = json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    script = files("atpid_control.views.report").joinpath("data", "page.js").read_text(encoding="utf-8")
    about = {
        "stand": campaign.stand, "points": f"{len(found)} measured, {len(skipped)} skipped",
        "agreement": f"{agree} of {len(found)} within {AGREE:g} standard deviations of simulation",
    }  # fmt: skip
    charts = (
        f'<figure><div class="chart" id="{name}" role="img" aria-label="{title}"></div></figure>'
        for name, _, _, title in _AXES
        if name in figures
    )
    return document("A stand over many points", [
        "<header><h1>A stand over many points</h1><p>Circles: measured. Lines: simulation of the same points. Bars: "
        "one standard deviation. A click on a circle, or a link in the table, leads to the point's report.</p>"
        "</header>", facts(about), warnings(skipped), *charts,
        '<h2>Every point</h2><p class="note">Amplitudes are half peak-to-peak; efficiency is against the damper '
        "closed; apart: measured less simulated, in standard deviations of the difference.</p>",
        table("Every point", _HEADS, [_row(one, found) for one in found]),
        f"<script>{get_plotlyjs()}</script>", f'<script type="application/json" id="figures">{code}</script>',
        f"<script>{script}{_CLICK}</script>",
    ])  # fmt: skip


def _address(point: Point) -> str:
    return f"points/{point.number:04d}/report/{PAGE}"


def _row(one: Compared, found: Sequence[Compared]) -> list[str | Link]:
    record, point = one.record, one.point
    share, error = _efficiency(one, found, "beam_amplitude")
    return [
        Link(point.text, _address(point)), f"{record['excitation_amplitude']:.5g}",
        f"{record['excitation_frequency']:.4f} Hz", f"{1e3 * record['height']:.4g} mm",
        _with_error(1e3 * record["beam_amplitude"], 1e3 * record["beam_amplitude_std"], "mm"),
        _with_error(1e3 * record["simulated_amplitude"], 1e3 * record["simulated_amplitude_std"], "mm"),
        f"{one.apart:+.1f}".replace("-", "−"), _with_error(100.0 * share, 100.0 * error, "%"),
        "regular" if record["regular"] else "irregular", str(record["attempt"]),
    ]  # fmt: skip


def _with_error(value: float, error: float, unit: str) -> str:
    digits = max(0, 1 - math.floor(math.log10(error))) if error > 0.0 else 2
    return f"{value:.{digits}f} ± {error:.{digits}f} {unit}".replace("-", "−")


def _efficiency(one: Compared, found: Sequence[Compared], name: str) -> tuple[float, float]:
    """Return 1 - amplitude / that with the damper closed, and its standard deviation [-].

    The closed damper's is measured where there is such a point of the same grain and excitation, else simulated.
    """
    point, record = one.point, one.record
    closed = [other.record for other in found if other.point.ceiling == "closed"
              and (other.point.amplitude, other.point.frequency, other.point.grain_mass)
              == (point.amplitude, point.frequency, point.grain_mass)]  # fmt: skip
    reference, error = record["closed_amplitude"], 0.0
    if closed and name == "beam_amplitude":
        reference, error = (sum(one[key] for one in closed) / len(closed) for key in (name, f"{name}_std"))
    ratio = record[name] / reference
    return 1.0 - ratio, math.hypot(record[f"{name}_std"], ratio * error) / reference


def _figures(found: Sequence[Compared]) -> Iterator[tuple[str, Figure]]:
    """Yield the charts whose quantity was varied."""
    for key, axis, scale, title in _AXES:
        shown = [one for one in found if key == "ratio" or one.point.ceiling not in ("closed", "none")]
        if key == "ceiling":
            shown = [one for one in shown if not one.point.is_method]
        value = "height" if key == "ceiling" else None
        places = [one.record["height"] if value else getattr(one.point, key) for one in shown]
        if len({round(place, 9) for place in places}) < 2:
            continue
        curves = list(_curves(found, shown, key, scale))
        yield key, points(title, "mm" if key == "ratio" else "%", axis, curves)


def _curves(found: Sequence[Compared], shown: Sequence[Compared], key: str, scale: float) -> Iterator[Marked]:
    def others(one: Compared) -> tuple[str, ...]:
        named = {"amplitude": f"{one.point.amplitude:g}", "ratio": f"{one.point.ratio:.4g} f₀",
                 "ceiling": f"{one.point.ceiling:g} m" if isinstance(one.point.ceiling, float) else one.point.ceiling,
                 "grain_mass": f"{1e3 * one.point.grain_mass:.4g} g"}  # fmt: skip
        return tuple(text for name, text in named.items() if name != key)

    for number, (name, group) in enumerate(groupby(sorted(shown, key=others), key=others)):
        line = sorted(group, key=lambda one: _place(one, key))
        if len({_place(one, key) for one in line}) < 2:
            continue
        colour = _COLOURS[number % len(_COLOURS)]
        for kind, column in (("measured", "beam_amplitude"), ("simulated", "simulated_amplitude")):
            values = [(1e3 * one.record[column], 1e3 * one.record[f"{column}_std"]) if key == "ratio"
                      else tuple(100.0 * part for part in _efficiency(one, found, column)) for one in line]  # fmt: skip
            yield Marked(
                f"{', '.join(name)}{'' if kind == 'measured' else ', simulated'}",
                [scale * _place(one, key) for one in line], [value for value, _ in values], [bar for _, bar in values],
                colour, kind == "measured", [_address(one.point) for one in line],
            )  # fmt: skip


def _place(one: Compared, key: str) -> float:
    return float(one.record["height"] if key == "ceiling" else getattr(one.point, key))
