# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder of a campaign: a point is there whole or not at all, whenever the campaign is killed.

A point is measured in a folder beside (`.0007.part`), flushed to the disk and renamed to `points/0007`; one that was
bad goes to `bad/0007-1` in the same way. Nothing else is remembered: what is done is what is there, and the index is
made from it.
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from atpid_common.output import finite, folder, writing
from atpid_control.campaign.plan import CampaignError
from atpid_control.stand.outdir import claimed

RECORD, PLAN = "point.json", "campaign.json"
#: What a record has as its `status`; a point with one of the first two is done.
MEASURED, SKIPPED, BAD = "measured", "skipped", "bad"
Record = dict[str, Any]


class CampaignFolder:
    """Points measured, points that were bad, and the plan they belong to."""

    def __init__(self, path: Path) -> None:
        """Take a folder, which need not be there yet."""
        self.path, self.points, self.bad = path, path / "points", path / "bad"

    @contextmanager
    def open(self, plan: Mapping[str, Any]) -> Iterator[None]:
        """Claim the folder for the campaign `plan`; what a killed one left unfinished is removed.

        Raises CampaignError where another campaign is in it, BenchError where one runs there.
        """
        folder(self.path)
        with claimed(self.path), writing(self.path):
            if (self.path / PLAN).is_file():
                if self.plan() != (given := json.loads(json.dumps(plan))):
                    differs = ", ".join(sorted(key for key in given if given[key] != self.plan().get(key)))
                    raise CampaignError(
                        f"{self.path}: holds another campaign (it differs in {differs}); give another --out"
                    )
            elif foreign := sorted(item.name for item in self.path.iterdir() if not item.name.startswith(PLAN)):
                raise CampaignError(f"{self.path}: holds other files ({', '.join(foreign[:3])}); give a new --out")
            else:
                _write(self.path / PLAN, plan)
            for place in (self.points, self.bad):
                place.mkdir(exist_ok=True)
            for part in self.points.glob(".*.part"):
                shutil.rmtree(part)
            yield

    def plan(self) -> dict[str, Any]:
        """Return the plan it was made for. Raises CampaignError: it is none."""
        try:
            plan: dict[str, Any] = json.loads((self.path / PLAN).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise CampaignError(f"{self.path}: is no folder of a campaign: {PLAN} is missing; give its --out") from None
        return plan

    def place(self, number: int) -> Path:
        """Return the folder of a point that is done."""
        return self.points / f"{number:04d}"

    def begin(self, number: int) -> Path:
        """Return an empty folder in which a point is measured."""
        part = self.points / f".{number:04d}.part"
        part.mkdir()
        return part

    def keep(self, part: Path, record: Record) -> None:
        """Make a point that was measured, or is given up, one that is done; an attempt that was bad is set aside."""
        number = record["number"]
        aside = self.bad / f"{number:04d}-{record['attempt']}"
        target = aside if record["status"] == BAD else self.place(number)
        _write(part / RECORD, record)
        for path in (*part.rglob("*"), part):
            _flush(path)
        part.rename(target)  # fails where there is one already, which is not empty
        _flush(target.parent)

    def attempts(self, number: int) -> int:
        """Return how many attempts of a point were bad."""
        return sum(1 for _ in self.bad.glob(f"{number:04d}-*"))

    def record(self, number: int) -> Record:
        """Return what was kept of a point that is done."""
        record: Record = json.loads((self.place(number) / RECORD).read_text(encoding="utf-8"))
        return record

    def records(self) -> dict[int, Record]:
        """Return the points that are done, by number."""
        return {(number := int(path.name)): self.record(number) for path in sorted(self.points.glob("[0-9]*"))}

    def write_index(self) -> None:
        """Write index.json and index.csv anew: a convenience, from the points that are there."""
        import pandas as pd  # here, since it loads slowly

        rows = list(self.records().values())
        _write(self.path / "index.json", rows)
        table = pd.DataFrame(rows).drop(columns="events", errors="ignore")
        _replace(self.path / "index.csv", table.to_csv(index=False, lineterminator="\n"))


def _write(path: Path, value: Any) -> None:
    _replace(path, json.dumps(finite(value), indent=1) + "\n")


def _replace(path: Path, text: str) -> None:
    beside = path.with_name(f"{path.name}.new")
    beside.write_text(text, encoding="utf-8")
    _flush(beside)
    beside.replace(path)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
