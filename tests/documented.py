# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contents of the documentation: its commands, code, links, headings and the names it mentions."""

import argparse
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from colcon_workspace import sources

from atpid_common.cli import Commands, Parser, load

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted(page for place in ("docs", "docs/research", "bags") for page in ROOT.glob(f"{place}/*.md"))

_COMMAND = re.compile(r"(?:sudo )?(?:make(?!\()|python -m|ros2|atpid(?= [a-z-])|\. ros2_ws/activate)\b.*")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
_LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)")


class Piece(NamedTuple):
    """A piece of text and the page it stands on."""

    page: str
    text: str


def files() -> list[Path]:
    """Return every file of the project that is not made by set-up or a run."""
    return [ROOT / path for path in sources() if not (ROOT / path).is_symlink()]


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


def blocks(page: Path, language: str) -> list[str]:
    """Return what stands in a page's fences of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def pieces() -> list[Piece]:
    """Return all code of all pages."""
    return [Piece(page.name, text.replace("\\|", "|")) for page in PAGES for text in code(page)]


def commands() -> list[Piece]:
    """Return what a reader may type, without the remark after it, each once."""
    found = [(page, _COMMAND.search(text)) for page, text in pieces()]
    whole = [Piece(page, match[0]) for page, match in found if match and match.start() <= len('eval "$(')]
    return sorted({Piece(page, re.split(r"\s+# ", text)[0].strip().removesuffix(')"')) for page, text in whole})


def links(page: Path) -> list[str]:
    """Return the targets of a page's links that lie in the project."""
    return [target for target in _LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]


def anchors(page: Path) -> set[str]:
    """Return the anchors a page's headings get."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def exists(name: str) -> bool:
    """Whether a dotted name is a module, something in one, or an attribute or field of a class there."""
    try:
        pkgutil.resolve_name(name)
    except (ImportError, AttributeError):
        before, _, last = name.rpartition(".")
        try:
            owner = pkgutil.resolve_name(before)
        except (ImportError, AttributeError, ValueError):
            return False
        return last in {*getattr(owner, "model_fields", ()), *getattr(owner, "__dataclass_fields__", ())}
    return True


class OpenParser(Parser):
    """A parser that shows what it takes."""

    @property
    def arguments(self) -> list[argparse.Action]:
        """Every argument."""
        return [*self._actions]


def parsers_of(commands: Commands) -> Iterator[tuple[str, OpenParser]]:
    """Yield each command's own parser, and those of its own subcommands."""
    for name, (place, _) in (item for group in commands.values() for item in group.items()):
        parser = OpenParser(prog=name)
        load(place).add_arguments(parser)
        yield name, parser
        for action in parser.arguments:
            if isinstance(action.choices, dict):
                yield from ((f"{name} {inner}", one) for inner, one in action.choices.items())


def options(commands: Commands) -> dict[str, set[str]]:
    """Return the long options of each command of a program, and of its own subcommands."""
    return {name: set(OPTION.findall(parser.format_usage())) for name, parser in parsers_of(commands)}
