# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a campaign, of data/campaign.html: curves with error bars beside simulation of the same points."""

import json
import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from statistics import fmean

from atpid_campaign.campaign.folder import MEASURED, SKIPPED, CampaignFolder, Record
from atpid_campaign.campaign.plan import Campaign
from atpid_campaign.campaign.result import simulated
from atpid_common.output import finite, writing
from atpid_control.views.report.charts import Figure, Marked, points
from atpid_control.views.report.page import PAGE, report
from atpid_control.views.static_page import Link, document, filled, scripts
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import HERE, Batch, Progress

#: Standard deviations within which measurement and simulation agree.
AGREE = 2.0
_COLOURS = ("own", "accent", "green", "red", "violet", "ink", "muted")
#: Charts: the column of a record that varies along the axis, its unit and scale, and the words for the chart.
_AXES = (
    ("height", "height of the ceiling, mm", 1e3, "Efficiency over the height"),
    ("wanted_grain_mass", "mass of the grain, g", 1e3, "Efficiency over the grain's mass"),
    ("wanted_amplitude", "amplitude of the excitation, {}", 1.0, "Efficiency over the amplitude"),
    ("wanted_ratio", "frequency over the resonance", 1.0, "Beam over the frequency"),
)


_CLICK = (
    'document.querySelectorAll(".chart").forEach((chart) => chart.on("plotly_click", (event) => {'
    " const page = event.points[0].customdata; if (page) location.href = page; }));"
)


def compared(
    campaign: Campaign, scene: Scene, folder: CampaignFolder, progress: Progress | None = None
) -> list[Record]:
    """Return the records of all points measured, by number, each simulated at what was measured.

    Beside what `simulated` returns: `apart`, measured less simulated amplitude over the standard deviation of their
    difference [-], and the `efficiency` [-] of both, against the closed damper of the same grain and excitation,
    measured where there is one, else simulated.
    """
    found = [record for record in folder.records().values() if record["status"] == MEASURED]
    jobs = [record["number"] for record in found]
    beside = Batch(partial(_simulated, campaign, scene, folder), jobs, processes=True).run(HERE, progress)
    rows = [record | more for record, more in zip(found, beside, strict=True)]
    closed: dict[tuple[object, ...], list[Record]] = {}
    for row in rows:
        if row["wanted_ceiling"] == "closed":
            closed.setdefault(_excited(row), []).append(row)
    for row in rows:
        error = math.hypot(row["beam_amplitude_std"], row["simulated_amplitude_std"])
        row["apart"] = (row["beam_amplitude"] - row["simulated_amplitude"]) / error
        bare = {"beam_amplitude": row["closed_amplitude"], "beam_amplitude_std": 0.0}
        for name, key, references in (
            ("efficiency", "beam_amplitude", closed.get(_excited(row), [bare])),
            ("simulated_efficiency", "simulated_amplitude", [bare]),
        ):
            reference, std = (fmean(one[f"beam_amplitude{end}"] for one in references) for end in ("", "_std"))
            ratio = row[key] / reference
            row[name], row[f"{name}_std"] = 1.0 - ratio, math.hypot(row[f"{key}_std"], ratio * std) / reference
    return rows


def _excited(row: Record) -> tuple[object, ...]:
    return tuple(row[f"wanted_{name}"] for name in ("amplitude", "frequency", "grain_mass"))


def _simulated(campaign: Campaign, scene: Scene, folder: CampaignFolder, number: int) -> dict[str, float]:
    return simulated(campaign, scene, folder.record(number))


def agreeing(rows: Sequence[Record]) -> int:
    """Return how many points agree with their simulation."""
    return sum(abs(row["apart"]) <= AGREE for row in rows)


def write_page(campaign: Campaign, scene: Scene, folder: CampaignFolder, progress: Progress | None = None) -> Path:
    """Write index.html, comparison.json and each point's report; return the page. Raises OutputError, BagError."""
    rows = compared(campaign, scene, folder, progress)
    for row in rows:
        place = folder.place(row["number"])
        if not (place / "report" / PAGE).is_file():
            report(place / "bag", place / "report")
    page = folder.path / "index.html"
    with writing(page):
        (folder.path / "comparison.json").write_text(json.dumps(finite(rows), indent=1) + "\n", encoding="utf-8")
        page.write_text(_html(campaign, folder, rows, scene.driven_by.unit), encoding="utf-8")
    return page


def _html(campaign: Campaign, folder: CampaignFolder, rows: Sequence[Record], unit: str) -> str:
    figures = dict(_figures(rows, unit))
    left = [one for one in folder.records().values() if one["status"] == SKIPPED]
    skipped = [f"{one['point']}: skipped: {one['reason']}" for one in left]
    about = {
        "stand": campaign.stand,
        "points": f"{len(rows)} measured, {len(skipped)} skipped",
        "agreement": f"{agreeing(rows)} of {len(rows)} within {AGREE:g} standard deviations of simulation",
    }
    title, shown = "A stand over many points", [_row(row, unit) for row in rows]
    names = {
        "title": title,
        "about": about,
        "wrong": [*skipped, *(f"point {n}: left out, damaged: {wrong}" for n, wrong in folder.damaged.items())],
        "charts": {name: title for name, _, _, title in _AXES if name in figures},
        "heads": list(shown[0]) if shown else [],
        "rows": [list(row.values()) for row in shown],
        "scripts": scripts(finite(figures), _CLICK),
    }
    return document(title, [filled("campaign.html", "atpid_campaign", names)])


def _address(row: Record) -> str:
    return f"points/{row['number']:04d}/report/{PAGE}"


def _row(row: Record, unit: str) -> dict[str, str | Link]:
    return {
        "point": Link(row["point"].replace(" at", f" {unit} at", 1), _address(row)),
        f"excitation [{unit}]": f"{row['excitation_amplitude']:.5g}",
        "frequency [Hz]": f"{row['excitation_frequency']:.4f}",
        "height [mm]": f"{1e3 * row['height']:.4g}",
        "beam [mm]": _with_error(row, "beam_amplitude", 1e3),
        "simulated [mm]": _with_error(row, "simulated_amplitude", 1e3),
        "apart": f"{row['apart']:+.1f}".replace("-", "−"),
        "efficiency [%]": _with_error(row, "efficiency", 100.0),
        "motion": "regular" if row["regular"] else "irregular",
        "attempt": str(row["attempt"]),
    }


def _with_error(row: Record, name: str, scale: float) -> str:
    value, error = scale * row[name], scale * row[f"{name}_std"]
    digits = max(0, 1 - math.floor(math.log10(error))) if 0.0 < error < math.inf else 2
    return f"{value:.{digits}f} ± {error:.{digits}f}".replace("-", "−")


def _figures(rows: Sequence[Record], drive_unit: str) -> Iterator[tuple[str, Figure]]:
    """Yield the charts whose quantity was varied: over the frequency the beam itself, else the efficiency."""
    for key, axis, scale, title in _AXES:
        shown, unit, factor, columns = list(rows), "mm", 1e3, ("beam_amplitude", "simulated_amplitude")
        if key != "wanted_ratio":
            shown = [row for row in rows if row["wanted_ceiling"] not in ("closed", "none")]
            unit, factor, columns = "%", 100.0, ("efficiency", "simulated_efficiency")
        if key == "height":
            shown = [row for row in shown if isinstance(row["wanted_ceiling"], float)]
        curves: list[Marked] = []
        alike = partial(_alike, key, drive_unit)
        for name, group in groupby(sorted(shown, key=alike), key=alike):
            line = sorted(group, key=lambda row: row[key])
            x, pages = [scale * row[key] for row in line], [_address(row) for row in line]
            cycle, place = divmod(len(curves) // 2, len(_COLOURS))
            for column in columns if len(set(x)) > 1 else ():
                y, bars = ([factor * row[column + end] for row in line] for end in ("", "_std"))
                text = f"{name}, simulated" if column == columns[1] else name
                curves.append(Marked(text, x, y, bars, _COLOURS[place], column == columns[0], pages, cycle))
        if curves:
            yield key, points(title, unit, axis.format(drive_unit), curves)


def _alike(key: str, unit: str, row: Record) -> str:
    """Return what points of one curve over `key` have in common, in words."""
    ceiling = row["wanted_ceiling"]
    named = {
        "wanted_amplitude": f"{row['wanted_amplitude']:g} {unit}",
        "wanted_ratio": f"{row['wanted_ratio']:.4g} f₀",
        "height": f"{ceiling:g} m" if isinstance(ceiling, float) else ceiling,
        "wanted_grain_mass": f"{1e3 * row['wanted_grain_mass']:.4g} g",
    }
    return ", ".join(text for name, text in named.items() if name != key)
