# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A study file: scene, sweep, what is measured, the thesis's numbers, pictures (`data/NAME.yaml`)."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from atpid_common.errors import InputError, did_you_mean

#: Values of the keys that change a scene: number, word or, for a scene file, its name.
Value = float | str

FOLDER = Path(__file__).parent / "data"

#: Figures and tables of chapters 2 to 4 that no study computes, with the reason.
NOT_COMPUTED = "not_computed"


class StudyError(InputError):
    """A study that does not exist or whose file cannot be used."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Expected(_Model):
    """One row of the thesis, or one for each point of the sweep that `at` matches."""

    figure: str  # as printed: "Fig. 2.10", "Table 3.7", "Section 4.3"
    quantity: str
    at: dict[str, Value | list[Value]] = {}
    thesis: Value | list[Value] | None = None  # number, "> 3", "< 35" or a word; none: printed as a curve only
    against: str | None = None  # another quantity of the same point instead of the thesis's number: a closed form
    reduce: str | None = None  # max, min, mean, span, line: one row over all points
    same: list[str] = []  # words that mean the same as the thesis's
    within: float | None = None  # difference that counts as agreement, in the row's unit; default: `rows.WITHIN`
    irregular: bool = False  # the motion is: numbers are not repeatable on other processors
    why: str = ""


class Panel(_Model):
    """One panel of the picture: a curve of each point, or a quantity over a key of the sweep."""

    title: str
    xlabel: str
    ylabel: str
    curve: str | None = None
    x: str | None = None
    y: str | None = None
    at: dict[str, Value | list[Value]] = {}
    label: str = ""  # with the keys of the point in braces
    logarithmic: bool = False


class Study(_Model):
    """One study; see the files in `data/`."""

    title: str
    section: str
    text: str = ""  # what is assumed where the thesis does not say
    scene: dict[str, Any] = {}  # blocks of the standard bench that are replaced
    sweep: list[dict[str, list[Value]]] = [{}]  # grids, one after the other
    measure: str
    options: dict[str, Any] = {}
    instantaneous: bool = False  # impacts without duration, of the contact law's own restitution
    rows: list[Expected]
    panels: list[Panel] = []
    slow: bool = False  # left out of the test that computes the page's rows again


class NotComputed(_Model):
    """Figures and tables without a row."""

    figures: str
    why: str


def names() -> list[str]:
    """Return the names of all studies in the order of the thesis's figures."""
    found = [path.stem for path in FOLDER.glob("*.yaml") if path.stem != NOT_COMPUTED]
    return sorted(found, key=lambda name: (_first_figure(load(name)), name))


@cache
def load(name: str) -> Study:
    """Return a study by its name; raise StudyError in one line for an unknown name or a file that does not fit."""
    path = FOLDER / f"{name}.yaml"
    if not path.is_file() or name == NOT_COMPUTED:
        known = ["all", "list", *sorted(file.stem for file in FOLDER.glob("*.yaml") if file.stem != NOT_COMPUTED)]
        hint = did_you_mean(name, known)
        raise StudyError(f"study {name!r}: there is none{hint}; allowed: {', '.join(known)}")
    try:
        return Study.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise StudyError(f"{path.name}: {place}: {first['msg']}; given {first['input']!r}") from None


def not_computed() -> list[NotComputed]:
    """Return what no study computes."""
    document = yaml.safe_load((FOLDER / f"{NOT_COMPUTED}.yaml").read_text(encoding="utf-8"))
    return [NotComputed.model_validate(item) for item in document]


def _first_figure(study: Study) -> tuple[int, ...]:
    """Return chapter and number of the first figure that a study has a row for; after all others where it has none."""
    numbers = [(int(a), int(b)) for row in study.rows for a, b in re.findall(r"(\d)\.(\d+)", row.figure)
               if row.figure.startswith(("Fig", "Table"))]  # fmt: skip
    return min(numbers, default=(9, 0))
