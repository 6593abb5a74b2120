# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A mutation: one change of the safety path that must not pass unseen, and the tests that fail by it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


class MutationError(Exception):
    """A mutation that cannot be made in the files as they are."""


@dataclass(frozen=True)
class Mutation:
    """A change of one place in one file.

    name: unique; file: in the repository; old: text that the file has exactly once; new: what takes its place; tests:
    pytest's names of those that fail by it, the quickest first; why: what would happen at the stand.
    """

    name: str
    file: str
    old: str
    new: str
    tests: Sequence[str]
    why: str

    def applied(self, text: str) -> str:
        """Return the file's text with the change. Raises `MutationError` where it is not this change's place."""
        places = text.count(self.old)
        if places != 1 or self.old == self.new:
            raise MutationError(f"{self.name}: {self.file} has the old text {places} times; allowed: once, changed")
        changed = text.replace(self.old, self.new)
        if self.file.endswith(".py"):
            try:
                compile(changed, self.file, "exec")
            except SyntaxError as error:
                raise MutationError(f"{self.name}: {self.file} is no Python any more: {error}") from None
        return changed


def listed() -> tuple[Mutation, ...]:
    """Return all mutations of the tables beside this file, each named after the file that it changes."""
    return tuple(
        Mutation(f"{Path(group['file']).stem}: {change.pop('name')}", group["file"], **change)
        for table in sorted(Path(__file__).parent.glob("*.yaml"))
        for group in yaml.safe_load(table.read_text(encoding="utf-8"))
        for change in group["changes"]
    )
