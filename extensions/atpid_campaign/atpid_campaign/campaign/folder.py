# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder of a campaign: a point is there whole or not at all, whenever the campaign is killed.

A point is measured in a folder beside (`.0007.part`), flushed to the disk and renamed to `points/0007`; one that was
bad goes to `bad/0007-1` in the same way. Nothing else is remembered: what is done is what is there, and the index is
made from it. A point has digests of all its files but `log/`, which its process may still write to; where they do not
fit any more, the point goes to `damaged/0007-1`.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from atpid_campaign.campaign.plan import CampaignError
from atpid_common.files import Document, check, read_text
from atpid_common.output import finite, folder, writing
from atpid_common.waiting import to_stderr
from atpid_control.stand.outdir import claimed

_RECORD, PLAN, _DIGESTS = "point.json", "campaign.json", "digests.json"
#: What a record has as its `status`; a point with one of the first two is done.
MEASURED, SKIPPED, BAD = "measured", "skipped", "bad"
Record = Document


class CampaignFolder:
    """Points measured, points that were bad, and the plan they belong to."""

    def __init__(self, path: Path) -> None:
        """Take a folder, which need not be there yet."""
        self.path, self.points, self.bad, self.aside = path, path / "points", path / "bad", path / "damaged"
        self.damaged: dict[int, str] = {}  # points that are not as they were measured: in which way

    @contextmanager
    def open(self, plan: Document) -> Iterator[None]:
        """Claim the folder for the campaign `plan`; what a killed one left is removed, what is damaged moved aside.

        Raises CampaignError where another campaign is in it, BenchError where one runs there.
        """
        folder(self.path)
        with claimed(self.path), writing(self.path):
            if (self.path / PLAN).is_file():
                if self.plan() != (given := json.loads(json.dumps(plan))):
                    differs = ", ".join(sorted(key for key in given if given[key] != self.plan().get(key)))
                    other = f"another campaign (it differs in {differs})"
                    raise CampaignError(f"{self.path}: holds {other}; give another --out")
            elif foreign := sorted(item.name for item in self.path.iterdir() if not item.name.startswith(PLAN)):
                raise CampaignError(f"{self.path}: holds other files ({', '.join(foreign[:3])}); give a new --out")
            else:
                _write(self.path / PLAN, plan)
            for place in (self.points, self.bad, self.aside):
                place.mkdir(exist_ok=True)
            for part in self.points.glob(".*.part"):
                shutil.rmtree(part)
            self.check(f"moved to {self.aside}, measured again")
            for number in self.damaged:
                self.place(number).rename(self.aside / f"{number:04d}-{self.attempts(number, self.aside) + 1}")
            self.damaged = {}
            yield

    def plan(self) -> Document:
        """Return the plan it was made for. Raises FileError: there is none; CampaignError: it is damaged."""
        return _read(self.path / PLAN)

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
        _write(part / _RECORD, record)
        names = (path.relative_to(part) for path in sorted(part.rglob("*")) if path.is_file())
        _write(part / _DIGESTS, {str(name): _digest(part / name) for name in names if name.parts[0] != "log"})
        for path in (*part.rglob("*"), part):
            _flush(path)
        part.rename(target)  # fails where there is one already, which is not empty
        _flush(target.parent)

    def attempts(self, number: int, place: Path | None = None) -> int:
        """Return how many attempts of a point were bad, or are in another place."""
        return sum(1 for _ in (place or self.bad).glob(f"{number:04d}-*"))

    def record(self, number: int) -> Record:
        """Return what was kept of a point that is done. Raises InputError: its record is damaged."""
        return _read(self.place(number) / _RECORD)

    def records(self) -> dict[int, Record]:
        """Return the points that are done, by number, without those that were found to be damaged."""
        return {number: self.record(number) for number in self._numbers() if number not in self.damaged}

    def check(self, then: str = "left out; the same `atpid campaign` measures it again") -> None:
        """Name the points that are damaged, with what is done `then`; `records` leaves them out."""
        self.damaged = {number: wrong for number in self._numbers() if (wrong := self._wrong(number))}
        for number, wrong in self.damaged.items():
            to_stderr(f"point {number} is damaged: {wrong}; {then}")
        if old := sum(not (self.place(number) / _DIGESTS).is_file() for number in self.records()):
            to_stderr(f"note: {old} points have no {_DIGESTS}, which older versions did not write: not checked")

    def _numbers(self) -> list[int]:
        return [int(path.name) for path in sorted(self.points.glob("[0-9]*")) if path.name.isdecimal()]

    def _wrong(self, number: int) -> str:
        """Return in which way a point is not as it was measured; empty: it is."""
        place = self.place(number)
        try:
            kept = _read(place / _DIGESTS) if (place / _DIGESTS).exists() else {}
            changed = ", ".join(name for name, digest in kept.items() if _digest(place / name) != digest)
            found = self.record(number).get("number")
        except (ValueError, OSError) as error:
            return str(error).partition(";")[0]
        return f"{changed}: not as measured" if changed else "" if found == number else f"it is point {found}"

    def write_index(self) -> None:
        """Write index.json and index.csv anew: a convenience, from the points that are there."""
        import pandas as pd  # here, since it loads slowly

        rows = list(self.records().values())
        _write(self.path / "index.json", rows)
        table = pd.DataFrame(rows).drop(columns="events", errors="ignore")
        _replace(self.path / "index.csv", table.to_csv(index=False, lineterminator="\n"))


def _digest(path: Path) -> str:
    check(path, 2**60)
    total = hashlib.sha256()
    with path.open("rb") as stream:
        while piece := stream.read(1 << 20):
            total.update(piece)
    return total.hexdigest()


def _read(path: Path) -> Document:
    text = read_text(path, 100_000_000)
    try:
        return dict(json.loads(text).items())
    except (ValueError, AttributeError, RecursionError):
        raise CampaignError(f"{path}: is cut or damaged; copy one of the same campaign there") from None


def _write(path: Path, value: object) -> None:
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
