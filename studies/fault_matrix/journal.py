# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rows of a matrix that were run, in a folder: a run that was interrupted is taken up again."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from atpid_common.errors import InputError
from studies.fault_matrix.run import Row, Seen

_NAME = "rows.jsonl"


class Journal:
    """Rows by part and kind, each on the disk as soon as it was run."""

    def __init__(self, folder: Path) -> None:
        """Take up the rows in `folder`. Raises InputError where something else is in it."""
        self._file = folder / _NAME
        self.rows: dict[tuple[str, str], Row] = {}
        if not self._file.exists() and any(folder.iterdir()):
            raise InputError(f"--out: given {folder}, which has files but no rows of a matrix; give another folder")
        if self._file.exists():
            for line in self._file.read_text(encoding="utf-8").splitlines():
                self._take(json.loads(line))
        self._file.touch()

    def add(self, row: Row) -> None:
        """Keep a row."""
        self.rows[row.part, row.kind] = row
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(row)) + "\n")

    def _take(self, values: dict[str, Any]) -> None:
        for name in ("detected", "recovered"):
            values[name] = None if values[name] is None else Seen(**values[name])
        row = Row(**values)
        self.rows[row.part, row.kind] = row
