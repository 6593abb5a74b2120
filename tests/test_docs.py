# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The documentation is true: its commands are parsed, its links lead somewhere, and what it names exists."""

import fnmatch
import functools
import pkgutil
import re
import shlex
from pathlib import Path

import pytest
from documented import OPTION, ROOT, Piece, anchors, commands, exists, files, links, options, pieces

from atpid_common.cli import Parser, full_parser
from atpid_control.cli import commands as installed
from atpid_control.stand.launching.options import check_names
from studies.cli import COMMANDS as STUDIES
from studies.figures.scenes import key_lists

PROGRAMS = {"atpid ": installed(), "python -m studies ": STUDIES}
options_of = functools.cache(lambda program: options(PROGRAMS[program]))
#: What stands for a word of the reader's, or for a choice of words: such a line is a pattern, and is not parsed.
PATTERN = re.compile(r"[\[|…]|\b[A-Z]+\b(?!\.)|\)$")
#: Lines that name a command in a sentence, or need a file of the reader's package.
NAMED = {
    "calibrate sensor READINGS.csv", "bag export --format parquet", "map ... --header",
    "select scenes/thesis_4_3.yaml --method proportional",
    "bag export --format",
}  # fmt: skip
#: Paths that runs make or the reader gives.
MADE_OR_GIVEN = ("out/", "/", "KEPT/", "path/to/", "scenes/a.yaml", "scenes/NAME.yaml")
_PATH = re.compile(
    r"(?<![\w/$.~-])[\w*.-]+/[\w*./-]*\w\.(?:py|md|yaml|npz|cpp|h|toml|msg|srv|action|png|json)(?![\w(])"
)


@functools.cache
def parser_of(program: str) -> Parser:
    return full_parser(program.strip(), PROGRAMS[program])


#: A command of the package that docs/extend.md has the reader write.
READERS = "atpid largest"
OURS = [each for each in commands() if each.text.startswith(tuple(PROGRAMS)) and not each.text.startswith(READERS)]
OTHERS = [piece for piece in commands() if re.match(r"(sudo )?make |ros2 (launch|run) atpid", piece.text)]


@pytest.mark.parametrize("piece", OURS, ids=lambda piece: f"{piece.page}-{piece.text[:60]}")
def test_the_command_is_there_and_takes_these_options(piece: Piece) -> None:
    (program,) = (program for program in PROGRAMS if piece.text.startswith(program))
    typed, taken = piece.text.removeprefix(program), options_of(program)
    beginnings = [" ".join(typed.split()[:count]) for count in (3, 2, 1)]
    named = next((words for words in beginnings if words in taken), "")
    assert named or typed == "--help"
    assert {*OPTION.findall(typed)} <= taken.get(named, set()) | {"--help"}
    if typed == named or typed in NAMED or PATTERN.search(typed):
        return
    words = shlex.split(typed)
    if words[-1] != "--help":
        assert parser_of(program).parse_args(words).run
        return
    with pytest.raises(SystemExit, match="0"):
        parser_of(program).parse_args(words)


@pytest.mark.parametrize("piece", OTHERS, ids=lambda piece: f"{piece.page}-{piece.text[:60]}")
def test_what_another_program_is_asked_for_exists(piece: Piece) -> None:
    first, second, *more = [*piece.text.removeprefix("sudo ").split(), ""]
    words = [word for word in more if word]
    if first == "make":
        folder = Path(words[0]) if second == "-C" else Path()
        targets = re.findall(r"^([a-z-]+):", (ROOT / folder / "Makefile").read_text(), flags=re.MULTILINE)
        named = [second, *words] if second != "-C" else words[1:]
        assert {word for word in named if "=" not in word} <= {*targets}
    elif piece.text.startswith("ros2 launch atpid"):
        assert (ROOT / words[0] / "launch" / words[1]).is_file()
        given = [word.lstrip("[").partition(":=")[0] for word in words[2:] if ":=" in word]
        check_names(words[1].partition(".")[0], given)
    elif piece.text.startswith("ros2 run atpid"):
        assert exists(f"{words[0]}.executables.{words[1]}")


def test_every_file_and_module_mentioned_exists() -> None:
    there = [f"/{path.relative_to(ROOT)}" for path in files()]
    paths = {Piece(page, name) for page, text in pieces() for name in _PATH.findall(text)}
    sought = [piece for piece in paths if not piece.text.startswith(MADE_OR_GIVEN)]
    assert [piece for piece in sought if not fnmatch.filter(there, f"*/{piece.text.removeprefix('./')}")] == []
    names = {Piece(page, name) for page, text in pieces() for name in re.findall(r"\batpid_\w+(?:\.\w+)+", text)}
    dotted = [piece for piece in names if not re.search(r"\.(py|yaml|npz|md|toml|h|msg)$", piece.text)]
    assert len(dotted) > 50
    assert [piece for piece in dotted if not exists(piece.text)] == []


@pytest.mark.parametrize("page", [p for p in files() if p.suffix == ".md"], ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for target in links(page):
        name, _, anchor = target.partition("#")
        place = (page.parent / name).resolve() if name else page
        if not place.exists() or (anchor and anchor not in anchors(place)):
            broken.append(target)
    assert broken == []


GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").partition("## Terms")[0]
#: Quantity, unit and code of each row.
QUANTITIES = re.findall(r"^\| [^|]+ \| ([^|]+) \| ([^|]+) \| [^|]+ \| ([^|]+) \|$", GLOSSARY, re.MULTILINE)[1:]
#: A product of units: base and derived units of the SI, with powers.
SI = re.compile(r"-|(?:m|kg|s|N|Pa|Hz|J|V|rad)(?:[ /](?:m|kg|s|N|Pa|Hz|J|V|rad)|\^\d(?:\.\d)?)*")


def unit_in_code(name: str) -> str | None:
    """Return the unit in the description of a scene's field or in a message's definition, where there is one."""
    before, _, last = name.rpartition(".")
    if name.startswith("atpid_interfaces.msg."):
        message = ROOT / f"atpid_interfaces/atpid_interfaces/msg/{name.split('.')[2]}.msg"
        (text,) = re.findall(rf"^\S+ {last} +#(.*)$", message.read_text(encoding="utf-8"), flags=re.MULTILINE)
    else:
        field = getattr(pkgutil.resolve_name(before), "model_fields", {}).get(last)
        text = field.description if field is not None else ""
    unit = re.search(r"\[([^\]\[,]+)\]", text)
    return unit[1] if unit else None


@pytest.mark.parametrize(("quantity", "unit", "code"), QUANTITIES)
def test_each_unit_is_si_and_that_of_the_code(quantity: str, unit: str, code: str) -> None:
    units = unit.split(", ")
    assert all(SI.fullmatch(each) for each in units)
    named = re.findall(r"`(atpid_[\w.]+)`", code)
    assert [name for name in named if unit_in_code(name) not in (None, *units)] == [], quantity


def test_the_keys_are_those_of_the_code() -> None:
    page = (ROOT / "docs/scenes.md").read_text(encoding="utf-8")
    assert page.endswith(f"\n{key_lists()}\n"), "end it with what `python -m studies figures scenes` prints"


def test_the_numbers_of_the_example_are_those_of_the_design() -> None:
    """`extensions/atpid_design/test/test_design_page.py` computes them again."""
    table = (ROOT / "docs/what_it_is.md").read_text().partition("| answer | |\n|---|---|\n")[2]
    rows = table.partition("\n\n")[0].splitlines()
    assert len(rows) > 2
    assert {*rows} <= {*(ROOT / "docs/design.md").read_text().splitlines()}
