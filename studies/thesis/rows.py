# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rows of a study: ours, the thesis's, the difference, and why."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.thesis.measured import Measured
from studies.thesis.points import Job, matches
from studies.thesis.quantities import described, named
from studies.thesis.study import Expected, Study, StudyError, Value

#: Differences that count as agreement where a row names none: points of a percentage, or a share of the value.
WITHIN_POINTS, WITHIN_SHARE = 3.0, 0.05

#: What stands with a row whose motion is irregular.
IRREGULAR = "irregular motion"

#: Relative difference from a closed form that counts as agreement: eight digits.
CLOSED_FORM = 1e-8


class Row(NamedTuple):
    """One quantity, computed and in the thesis."""

    figure: str
    quantity: str
    unit: str
    ours: float | str
    thesis: float | str | None  # None: a curve without a printed value
    difference: float | None  # ours less thesis's, where both are numbers
    agrees: bool | None  # None: nothing to compare with
    why: str
    digits: int


def rows_of(study: Study, jobs: Sequence[Job], measured: Sequence[Measured]) -> list[Row]:
    """Return the rows of a study; raise StudyError for one that matches no point."""
    return [row for expected in study.rows for row in _rows(expected, jobs, measured)]


def _rows(expected: Expected, jobs: Sequence[Job], measured: Sequence[Measured]) -> list[Row]:
    if expected.against is not None:
        return _against(expected, jobs, measured)
    found = [(job, values.values[expected.quantity]) for job, values in zip(jobs, measured, strict=True)
             if matches(job.point, expected.at) and expected.quantity in values.values]  # fmt: skip
    if not found:
        raise StudyError(f"{expected.figure}: no point of the sweep has {expected.quantity} at {expected.at}")
    if expected.reduce is not None:
        value = _reduced(expected.reduce, found)
        where = described({key: _span(given) for key, given in expected.at.items()})
        return [_row(expected, _text(expected, where), value, _single(expected))]
    printed = expected.thesis if isinstance(expected.thesis, list) else [expected.thesis] * len(found)
    if len(printed) != len(found):
        raise StudyError(f"{expected.figure}: {len(printed)} numbers for {len(found)} points of the sweep")
    return [_row(expected, _text(expected, described(job.point)), value, thesis)
            for (job, value), thesis in zip(found, printed, strict=True)]  # fmt: skip


def _against(expected: Expected, jobs: Sequence[Job], measured: Sequence[Measured]) -> list[Row]:
    """Return a row for each point: the engine beside a closed form."""
    quantity, rows = named(expected.quantity), []
    for job, found in zip(jobs, measured, strict=True):
        if expected.quantity in found.values and matches(job.point, expected.at):
            ours, closed = float(found.values[expected.quantity]), float(found.values[str(expected.against)])
            within = CLOSED_FORM * abs(closed) if expected.within is None else expected.within
            agrees = abs(ours - closed) <= within
            rows.append(Row(expected.figure, _text(expected, described(job.point)), quantity.unit, ours, closed,
                            ours - closed, agrees, expected.why, quantity.digits))  # fmt: skip
    return rows


def _row(expected: Expected, text: str, ours: float | str, thesis: Value | None) -> Row:
    quantity = named(expected.quantity)
    number = isinstance(ours, float | int) and isinstance(thesis, float | int)
    difference = float(ours) - float(thesis) if number else None  # type: ignore[arg-type]
    why = "; ".join(part for part in (IRREGULAR if expected.irregular else "", expected.why) if part)
    unit, digits = ("-", 4) if expected.reduce == "line" else (quantity.unit, quantity.digits)
    return Row(expected.figure, text, unit, ours, thesis, difference,
               _agrees(expected, ours, thesis, unit), why, digits)  # fmt: skip


def _agrees(expected: Expected, ours: float | str, thesis: Value | None, unit: str) -> bool | None:
    if thesis is None:
        return None
    if isinstance(ours, str):
        return ours == thesis or ours in expected.same
    if isinstance(thesis, str):
        sign, _, limit = thesis.partition(" ")
        return ours > float(limit) if sign == ">" else ours < float(limit)
    within = expected.within
    if within is None:
        within = WITHIN_POINTS if unit.startswith("%") else WITHIN_SHARE * abs(thesis)
    return abs(ours - thesis) <= within


def _reduced(how: str, found: list[tuple[Job, float | str]]) -> float:
    values = np.array([float(value) for _, value in found])
    if how == "line":  # share of the variance a straight line over the one key that varies explains
        key = next(name for name in found[0][0].point if len({job.point[name] for job, _ in found}) > 1)
        x = np.array([float(job.point[key]) for job, _ in found])
        return float(np.corrcoef(x, values)[0, 1] ** 2)
    functions: dict[str, Callable[..., Any]] = {"max": np.max, "min": np.min, "mean": np.mean, "span": np.ptp}
    if how not in functions:
        raise StudyError(f"reduce: given {how!r}; allowed: line, {', '.join(functions)}")
    return float(functions[how](values))


def _text(expected: Expected, where: str) -> str:
    words = {"max": "greatest ", "min": "least ", "mean": "mean ", "span": "range of the ", None: ""}
    name = named(expected.quantity).text
    text = f"straight line through the {name}, R²" if expected.reduce == "line" else words[expected.reduce] + name
    return f"{text}: {where}" if where else text


def _single(expected: Expected) -> Value | None:
    if isinstance(expected.thesis, list):
        raise StudyError(f"{expected.figure}: one number is needed where points are reduced to one")
    return expected.thesis


def _span(given: Value | list[Value]) -> Value:
    return " to ".join(f"{value}" for value in (given[0], given[-1])) if isinstance(given, list) else given


def shown(value: float | str | None, digits: int) -> str:
    """Return a value as tables show it."""
    if value is None or isinstance(value, str):
        return value or ""
    if math.isnan(value):
        return "none"
    return f"{value:.{digits}g}" if value != 0.0 else "0"
