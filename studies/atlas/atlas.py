# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The atlas as arrays, its file, and its tables.

Of a block with R rows, C columns and n heights, arrays have the shapes (R, C), (R, C, n), or (R, C, n, 2): swept
upward and downward.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.files import read_arrays
from atpid_sim.maps import MapError
from atpid_sim.simulation.quantities import efficiency
from studies.atlas.column import FAILED, TYPES, Column
from studies.atlas.plan import FREQUENCY, MASS, Place, Plan

Columns = dict[Place, Column]
#: Arrays of a block by name.
Block = dict[str, Any]

#: Largest file read, unpacked: some twenty times that of the standard bench.
_MOST_BYTES = 30_000_000
#: Name: (value of a column, type of its array).
_FIELDS: dict[str, tuple[Callable[[Column], Any], Any]] = {
    "heights": (lambda c: c.heights, float),
    "types": (lambda c: [[up.type, down.type] for up, down in zip(c.up, c.down, strict=True)], np.int8),
    "amplitudes": (lambda c: [[up.amplitude, down.amplitude] for up, down in zip(c.up, c.down, strict=True)], float),
    "regular": (lambda c: [[up.regular, down.regular] for up, down in zip(c.up, c.down, strict=True)], bool),
    "hysteresis": (lambda c: c.hysteresis, bool),
    "closed": (lambda c: c.closed, float),
    "best_height": (lambda c: c.best.height, float),
    "best_amplitude": (lambda c: c.best.amplitude, float),
    "reproducible": (lambda c: c.best.reproducible, bool),
    "ending": (lambda c: c.stability.ending, str),
    "periods": (lambda c: c.stability.periods, int),
    "impacts": (lambda c: c.stability.impacts, int),
    "largest": (lambda c: c.stability.largest, float),
    "largest_error": (lambda c: c.stability.largest_error, float),
    "cliff": (lambda c: c.stability.cliff, float),
    "loss": (lambda c: c.stability.loss, str),
    "beat": (lambda c: c.stability.beat, float),
    "recovered": (lambda c: c.stability.recovered, float),
    "simulations": (lambda c: c.simulations, int),
}
#: Values of the table, one row a column.
_TABLE = (
    "closed", "best_height", "best_amplitude", "reproducible", "ending", "periods", "impacts", "largest",
    "largest_error", "cliff", "loss", "beat", "recovered",
)  # fmt: skip


@dataclass(frozen=True)
class Atlas:
    """Plan and blocks."""

    plan: Plan
    blocks: dict[str, Block]

    @staticmethod
    def of(plan: Plan, columns: Columns) -> Atlas:
        """Return the atlas of a plan's columns."""

        def arrays(rows: list[list[Place]]) -> Block:
            return {
                name: np.array([[value(columns[place]) for place in row] for row in rows], dtype=kind)
                for name, (value, kind) in _FIELDS.items()
            }

        return Atlas(plan, {name: arrays(plan.block(name)) for name in (MASS, FREQUENCY)})

    @staticmethod
    def load(path: Path) -> Atlas:
        """Return the atlas in a file. Raises FileError where it cannot be read, MapError where it is no atlas."""
        stored = read_arrays(path, _MOST_BYTES)
        try:
            plan = json.loads(str(stored["plan"]))
            blocks = {block: {name: stored[f"{block}_{name}"] for name in _FIELDS} for block in (MASS, FREQUENCY)}
            lists: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value for key, value in plan.items()
            }
            return Atlas(Plan(**lists), blocks)
        except (KeyError, ValueError, AttributeError, TypeError):
            raise MapError(f"{path}: is no atlas; make one with `python -m studies atlas`") from None

    def save(self, path: Path) -> None:
        """Write the file; raises OutputError."""
        arrays = {f"{block}_{name}": array for block, part in self.blocks.items() for name, array in part.items()}
        with output.writing(path):
            np.savez_compressed(path, plan=np.array(json.dumps(asdict(self.plan))), **arrays)

    @property
    def simulations(self) -> int:
        """Runs made, without those of return maps."""
        places = {place: count for place, count in self._each("simulations")}
        return sum(int(count) for count in places.values())

    def _each(self, name: str) -> list[tuple[Place, Any]]:
        return [
            (place, self.blocks[block][name][i, j])
            for block in (MASS, FREQUENCY)
            for i, row in enumerate(self.plan.block(block))
            for j, place in enumerate(row)
        ]

    def rows(self) -> list[dict[str, Any]]:
        """Return one row a column: place, best height, its efficiency and stability, cliff, and distance to it."""
        listed: dict[Place, dict[str, Any]] = {}
        for name in _TABLE:
            for place, value in self._each(name):
                listed.setdefault(place, dict(place._asdict()))[name] = value.item()
        for row in listed.values():
            row["efficiency"] = efficiency(row["best_amplitude"], row["closed"])
            row["distance"] = row["cliff"] - row["best_height"]
        return list(listed.values())

    def summary(self) -> dict[str, Any]:
        """Return counts and shares of the whole atlas."""
        rows = self.rows()
        types = np.concatenate([part["types"].ravel() for part in self.blocks.values()])
        periodic = [row for row in rows if row["periods"] > 0]
        stable = [row for row in periodic if row["largest"] < 1.0]
        with_cliff = [row for row in rows if np.isfinite(row["cliff"])]
        distances = np.array([row["distance"] / row["cliff"] for row in with_cliff] or [np.nan])
        return {
            "columns": len(rows),
            "simulations": self.simulations,
            "cells": len(types),
            "cells_failed": int(np.count_nonzero(types == FAILED)),
            "share_of_cells": {name: float(np.mean(types == number)) for number, name in enumerate(TYPES)},
            "cells_with_hysteresis": int(sum(np.count_nonzero(part["hysteresis"]) for part in self.blocks.values())),
            "best_heights": sum(bool(np.isfinite(row["best_height"])) for row in rows),
            "periodic_at_the_best_height": len(periodic),
            "stable": len(stable),
            "beyond_the_cliff": sum(row["distance"] < 0.0 for row in with_cliff),
            "cliffs": _counted(with_cliff, "loss"),
            "distance_over_cliff": dict(zip(("least", "median", "largest"), _spread(distances), strict=True)),
        }

    def write_tables(self, folder: Path) -> None:
        """Write atlas.csv and atlas.json into a folder; raises OutputError."""
        rows = [output.finite(row) for row in self.rows()]
        with output.writing(folder):
            with (folder / "atlas.csv").open("w", newline="", encoding="utf-8") as file:
                table = csv.DictWriter(file, list(rows[0]))
                table.writeheader()
                table.writerows(rows)
            text = json.dumps(output.finite(self.summary()), indent=1) + "\n"
            (folder / "atlas.json").write_text(text, encoding="utf-8")


def _counted(rows: list[dict[str, Any]], name: str) -> dict[str, int]:
    values = [row[name] for row in rows]
    return {value: values.count(value) for value in sorted(set(values))}


def _spread(values: Any) -> list[float]:
    return [float(np.nanmin(values)), float(np.nanmedian(values)), float(np.nanmax(values))]
