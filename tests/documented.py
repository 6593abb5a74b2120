# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contents of the documentation: its commands, links, headings and the names it mentions."""

import dataclasses
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("bags/*.md"))]
MADE = {"build", "install", "log", "out", "src", "__pycache__"}

_COMMAND = re.compile(r"(?:sudo )?(?:make(?!\()|python -m|ros2|atpid(?= [a-z-])|\. ros2_ws/activate)\b.*")
_LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)")


class Piece(NamedTuple):
    """A piece of text and the page it stands on."""

    page: str
    text: str


def files() -> list[Path]:
    """Return every file of the project that is not made by set-up or a run."""

    def below(folder: Path) -> Iterator[Path]:
        for path in folder.iterdir():
            if path.name in MADE or path.is_symlink() or (path.name.startswith(".") and path.name != ".ci"):
                continue
            yield from below(path) if path.is_dir() else [path]

    return list(below(ROOT))


def code(page: Path) -> Iterator[str]:
    """Return each indented or fenced line, and each `span` of the other lines."""
    fenced = False
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            yield line.strip()
        else:
            yield from re.findall(r"`([^`]+)`", line)


def pieces() -> list[Piece]:
    """Return all code of all pages."""
    return [Piece(page.name, text.replace("\\|", "|")) for page in PAGES for text in code(page)]


def commands() -> list[Piece]:
    """Return what a reader may type, without the remark after it."""
    found = [(page, _COMMAND.search(text)) for page, text in pieces()]
    whole = [Piece(page, match[0]) for page, match in found if match and match.start() <= len('eval "$(')]
    return [Piece(page, re.split(r"\s+# ", text)[0].strip()) for page, text in whole]


def links(page: Path) -> list[str]:
    """Return the targets of a page's links that lie in the project."""
    return [target for target in _LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]


def anchors(page: Path) -> set[str]:
    """Return the anchors a page's headings get."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def owner_and_last(name: str) -> tuple[object, str]:
    """Return the module or class that a dotted name's last part belongs to, and that part.

    Raises ModuleNotFoundError or AttributeError where there is no such owner.
    """
    parts = name.split(".")
    for count in range(len(parts) - 1, 0, -1):
        try:
            owner: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:-1]:
            owner = getattr(owner, part)
        return owner, parts[-1]
    raise ModuleNotFoundError(name)


def exists(name: str) -> bool:
    """Whether a dotted name is a module, something in one, or an attribute or field of a class there."""
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        pass
    else:
        return True
    try:
        owner, last = owner_and_last(name)
    except (ModuleNotFoundError, AttributeError):
        return False
    fields = set(getattr(owner, "model_fields", ()))  # pydantic's are no attributes of their class
    if dataclasses.is_dataclass(owner):
        fields |= {field.name for field in dataclasses.fields(owner)}
    return hasattr(owner, last) or last in fields
