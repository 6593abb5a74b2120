# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a study: its points computed, its rows and picture written; what is finished is kept."""

import csv
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.folders import content_key
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import HERE, Batch, Progress, Record, Workers, beside
from studies.thesis.measured import Measured
from studies.thesis.measures import MEASURES
from studies.thesis.picture import draw
from studies.thesis.points import Job, jobs
from studies.thesis.rows import Row, rows_of
from studies.thesis.study import FOLDER, Study, StudyError, load


@dataclass(frozen=True)
class Finished:
    """A study that has run."""

    name: str
    study: Study
    rows: list[Row]
    picture: Path | None


def finished(name: str, folder: Path, scenes: Path, progress: Progress, workers: Workers = HERE) -> Finished:
    """Return a study's rows, from `folder/NAME` where they are kept for the same inputs, else computed and kept there.

    A study that was killed goes on where it stopped. Raises StudyError, SceneError, OutputError, JournalError,
    ClusterError and NumericalFailure, each in one line.
    """
    study, place = load(name), folder / name
    key, rows_file, picture = inputs_key(name), place / "rows.json", place / f"{name}.png"
    kept = _kept(rows_file, key)
    if kept is None or (study.panels and not picture.is_file()):
        output.folder(place)
        record: Record[int, Measured] = Record(
            beside(place / "points.json"), {"inputs": key}, lambda number: (number,), _to_plain, _from_plain
        )
        points, found = compute(name, scenes, progress, workers, record)
        kept = rows_of(study, points, found)
        if study.panels:
            draw(study, points, found, picture)
        _write(place, key, kept, points, found)
        record.finish()
    return Finished(name, study, kept, picture if study.panels else None)


def compute(
    name: str,
    scenes: Path,
    progress: Progress,
    workers: Workers = HERE,
    record: Record[int, Measured] | None = None,
) -> tuple[list[Job], list[Measured]]:
    """Return the points of a study and what was measured at each; raises as `finished`."""
    study = load(name)
    if study.measure not in MEASURES:
        raise StudyError(f"{name}.yaml: measure: given {study.measure!r}; allowed: {', '.join(MEASURES)}")
    points = jobs(study, scenes)
    batch = Batch(lambda number: _measured(name, points[number]), range(len(points)))
    return points, batch.run(workers, progress, record)


def _measured(name: str, job: Job) -> Measured:
    study = load(name)
    try:
        return MEASURES[study.measure](job, study.options)
    except NumericalFailure as failure:
        raise NumericalFailure(f"at {job.point}: {failure}") from None


def _to_plain(found: Measured) -> dict[str, Any]:
    return {"values": found.values, "curves": {name: curve.tolist() for name, curve in found.curves.items()}}


def _from_plain(kept: Mapping[str, Any]) -> Measured:
    return Measured(kept["values"], {name: np.array(curve) for name, curve in kept["curves"].items()})


def inputs_key(name: str) -> str:
    """Return 16 hex digits that change with the study's file and with the sources of what computes it."""
    text = (FOLDER / f"{name}.yaml").read_bytes()
    return hashlib.sha256(text + _sources_key().encode()).hexdigest()[:16]


@cache
def _sources_key() -> str:
    keys = []
    for package in ("atpid_sim", "atpid_control"):
        found = find_spec(package)
        assert found is not None
        folder = Path(str(found.origin)).parent
        keys.append(content_key(folder, folder.rglob("*.py")))
    return "".join(keys)


def _kept(file: Path, key: str) -> list[Row] | None:
    """Return the rows kept for the same inputs; None where there are none, or the file is damaged."""
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        return [Row(**row) for row in kept["rows"]] if kept["inputs"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write(place: Path, key: str, rows: list[Row], points: list[Job], found: list[Measured]) -> None:
    """Write rows.csv, points.json and, last, rows.json, by which a study is known to be finished."""
    table = [row._asdict() for row in rows]
    measured = [job.point | values.values for job, values in zip(points, found, strict=True)]
    with output.writing(place):
        with (place / "rows.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, Row._fields)
            writer.writeheader()
            writer.writerows(table)
        (place / "points.json").write_text(json.dumps(measured, indent=1, default=_plain), encoding="utf-8")
        document = {"inputs": key, "rows": table}
        (place / "rows.json").write_text(json.dumps(document, indent=1, default=_plain), encoding="utf-8")


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)
