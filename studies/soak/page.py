# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The result of a soak: trends with their verdicts as a table, and the curves as a picture."""

from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.output import writing
from studies.soak.measure import Sample
from studies.soak.run import Soak
from studies.soak.trends import Trend, trend

#: Slopes that do not matter: 24 MB, and less than one file, thread or segment, in a day [unit/h].
_LEAST = {"memory": 1.0, "handles": 1.0 / 24.0, "threads": 1.0 / 24.0, "segments": 1.0 / 24.0}
_UNITS = {"memory": "MB", "handles": "", "threads": "", "segments": ""}
#: Legs from which on the trend from one to the next is looked at.
_LEGS = 4
#: A block's wall time may grow by so much [ms/h].
_SLOWER = 0.05


def trends_of(soak: Soak) -> list[Trend]:
    """Return the trends: of all processes, of the memory of each, of the segments and of the time of a block."""
    samples = soak.sampler.samples
    if not samples:
        return []
    legs, times = [one.leg for one in samples], [one.time for one in samples]

    def of(name: str, kind: str, values: Sequence[float]) -> Trend:
        return trend(name, _UNITS[kind], legs, times, values, _LEAST[kind])

    totals = [one.total for one in samples]
    found = [of(kind, kind, [getattr(total, kind) for total in totals]) for kind in ("memory", "handles", "threads")]
    found.append(of("shared-memory segments", "segments", [one.segments for one in samples]))
    names = sorted({name.split(" ")[0] for one in samples for name in one.processes})
    for name in names if len(names) > 1 else ():
        memory = [one.processes[name].memory if name in one.processes else np.nan for one in samples]
        found.append(of(f"memory of {name}", "memory", memory))
    found.append(_pace(soak, samples))
    return found + _between(soak, samples)


def _pace(soak: Soak, samples: Sequence[Sample]) -> Trend:
    """Return the trend of the wall time of a block or, in real time, of the 99th percentile of its delay [ms]."""
    if soak.plan.real_time:
        rows = [(leg.number, one.time, 1e3 * one.p99) for leg in soak.legs for one in leg.delays]
    else:
        block = soak.plan.scene.recording.block
        rows = [
            (after.leg, after.time, 1e3 * block * (after.wall - before.wall) / (after.time - before.time))
            for before, after in pairwise(samples)
            if before.leg == after.leg and after.time > before.time
        ]
    name = "sample to command, 99 %" if soak.plan.real_time else "wall time of a block"
    legs, times, values = zip(*rows, strict=True) if rows else ((), (), ())
    return trend(name, "ms", legs, times, values, _SLOWER)


def _between(soak: Soak, samples: Sequence[Sample]) -> list[Trend]:
    """Return the trends from leg to leg, of a soak in one process of at least four legs: what a run leaves behind."""
    lasts = {one.leg: one for one in samples}
    if len(lasts) < _LEGS or soak.plan.real_time:
        return []
    begins = np.cumsum([0.0, *(leg.duration for leg in soak.legs)])
    times, zeros = [float(begins[leg]) for leg in lasts], [0] * len(lasts)
    values = {kind: [getattr(one.total, kind) for one in lasts.values()] for kind in ("memory", "handles", "threads")}
    values["segments"] = [one.segments for one in lasts.values()]
    return [
        trend(f"{kind} from leg to leg", _UNITS[kind], zeros, times, series, _LEAST[kind], warm_up=False)
        for kind, series in values.items()
    ]


def verdict(soak: Soak, trends: Sequence[Trend]) -> str:
    """Return the soak's result in one line."""
    growing = [one.name for one in trends if one.grows]
    lost = sum(leg.lost for leg in soak.legs)
    problems = [f"grows: {', '.join(growing)}"] if growing else []
    problems += [f"{sum(bool(leg.findings) for leg in soak.legs)} legs broke a rule"] if not soak.sound else []
    problems += [f"{soak.left} shared-memory segments were left behind"] if soak.left else []
    problems += [f"ended early: {soak.stopped}"] if soak.stopped else []
    hours = sum(leg.duration for leg in soak.legs if leg.line) / 3600.0
    if not problems and not any(np.isfinite(one.slope) for one in trends):
        problems = ["too short for a trend"]
    return f"{hours:.4g} h in {len(soak.legs)} legs, {lost} scans lost: {'; '.join(problems) or 'nothing grows'}"


def failed(soak: Soak, trends: Sequence[Trend]) -> bool:
    """Whether something grows, a rule was broken, something was left behind or the soak ended early."""
    return any(one.grows for one in trends) or not soak.sound or bool(soak.left) or bool(soak.stopped)


def table(trends: Sequence[Trend]) -> Table:
    """Return one row a trend."""
    made = Table(box=SIMPLE_HEAD, pad_edge=False, title="slopes after the warm-up of each leg", title_justify="left")
    made.add_column("")
    for name in ("mean", "last", "slope an hour", "± its error", "matters above", ""):
        made.add_column(name, justify="right", no_wrap=True)
    for one in trends:
        name = f"{one.name} [{one.unit}]" if one.unit else one.name
        numbers = (one.mean, one.last, one.slope, one.error, one.least)
        made.add_row(name, *(f"{number:.4g}" for number in numbers), one.verdict)
    return made


def as_json(trends: Sequence[Trend]) -> list[dict[str, Any]]:
    """Return the trends for soak.json; NaN as null."""
    plain = [asdict(one) | {"verdict": one.verdict} for one in trends]
    return [
        {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in row.items()}
        for row in plain
    ]


def picture(soak: Soak, path: Path) -> None:
    """Draw what was held, and the time of a block, over the hours of data."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    begins = np.concatenate([[0.0], np.cumsum([leg.duration for leg in soak.legs])])
    samples = soak.sampler.samples
    hours = [(begins[one.leg] + one.time) / 3600.0 for one in samples]
    rows: list[tuple[str, list[float]]] = [
        ("memory [MB]", [one.total.memory for one in samples]),
        ("open files", [one.total.handles for one in samples]),
        ("threads", [one.total.threads for one in samples]),
        ("shared-memory segments", [one.segments for one in samples]),
    ]
    figure, axes = plt.subplots(len(rows) + 1, 1, sharex=True, figsize=(9.0, 9.0), layout="constrained")
    for axis, (name, values) in zip(axes, rows, strict=False):
        axis.plot(hours, values, color="tab:blue", linewidth=1.0)
        axis.set_ylim(0.0, 1.15 * max([1.0, *values]))
        axis.set_title(name, loc="left", fontsize=9)
    _draw_pace(axes[-1], soak, begins)
    axes[-1].set_xlabel("time of the data [h]")
    with writing(path):
        figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_pace(axis: Any, soak: Soak, begins: Any) -> None:
    if soak.plan.real_time:
        axis.set_title("sample to command: median, 99 %, largest of each minute [ms]", loc="left", fontsize=9)
        for name in ("median", "p99", "largest"):
            minutes = [(begins[leg.number] + one.time, one) for leg in soak.legs for one in leg.delays]
            hours, values = [at / 3600.0 for at, _ in minutes], [1e3 * getattr(one, name) for _, one in minutes]
            axis.plot(hours, values, marker=".", linewidth=1.0)
    else:
        axis.set_title("wall time of a block [ms]", loc="left", fontsize=9)
        block, samples = soak.plan.scene.recording.block, soak.sampler.samples
        pairs = [(a, b) for a, b in pairwise(samples) if a.leg == b.leg and b.time > a.time]
        axis.plot(
            [(begins[b.leg] + b.time) / 3600.0 for _, b in pairs],
            [1e3 * block * (b.wall - a.wall) / (b.time - a.time) for a, b in pairs],
            color="tab:blue", linewidth=1.0,
        )  # fmt: skip
    axis.set_ylim(bottom=0.0)
