# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the site has beside the written pages: reference from the sources, navigation from the indices.

A page has a comment `<!-- made: NAME -->` where a part of `PARTS` stands on the site.
"""

import argparse
import inspect
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rosidl_adapter.parser import parse_action_file, parse_message_file, parse_service_file
from sphinx.application import Sphinx

import atpid_control
import atpid_dynamics.api
import atpid_sim
import atpid_sim.api
from atpid_common.cli import Commands, full_parser
from atpid_control.cli import commands as installed
from studies.cli import COMMANDS as STUDIES

ROOT = Path(__file__).resolve().parents[2]
INTERFACES = ROOT / "atpid_interfaces" / "atpid_interfaces"
#: Pages whose tables link to what is below them in the navigation.
INDICES = ("docs/changes", "docs/research/README", "docs/decisions/README")
_ROW = re.compile(r"^\|.*\|$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#:]+)\)")


def plain(text: str) -> str:
    """Return text for Markdown: outside of `code` no character has a meaning."""
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([\\*_\[\]<>|{}$~])", r"\\\1", part) for part in parts)


def parsers(program: str, commands: Commands) -> Iterator[tuple[str, str, str, Any]]:
    """Yield heading, name, line of help and parser of each command of a program."""
    whole = full_parser(program, commands)
    for heading, group in commands.items():
        for name, (_, text) in group.items():
            parser: Any = whole
            for word in name.split():
                (inner,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
                parser = inner.choices[word]
            yield heading, name, text, parser


def command_list(program: str, commands: Commands) -> str:
    """Return a section for each command: usage, arguments, example."""
    lines, last = [], ""
    for heading, name, text, parser in parsers(program, commands):
        lines += [f"## {heading}", ""] if heading != last else []
        last = heading
        usage = " ".join(parser.format_usage().split()[1:])  # wrapped by the browser
        lines += [f"### {program} {name}", "", plain(text[0].upper() + text[1:] + "."), "", "```text", usage, "```", ""]
        shape = parser._get_formatter()
        for action in parser._actions:
            if isinstance(action, argparse._HelpAction) or action.help == argparse.SUPPRESS:
                continue
            written = shape._format_action_invocation(action)
            meaning = shape._expand_help(action) if action.help else "see the description above"
            lines += [f"`{written}`", f": {plain(meaning)}", ""]
        lines += ["```sh", parser.epilog.partition("\n")[2].strip(), "```", ""] if parser.epilog else []
    return "\n".join(lines)


def comment(annotations: Any) -> str:
    """Return the comment of a definition or field, with its unit."""
    unit = annotations.get("unit", "")
    return plain(" ".join(annotations.get("comment", []))) + (f" \\[{unit}\\]" if unit else "")


def definition_tables(title: str, part: Any) -> list[str]:
    """Return the constants and fields of a message, or of a part of a service or action."""
    lines = [f"**{title}**" if title else "", "", comment(part.annotations), ""]
    for heading, entries in (("constant", part.constants), ("field", part.fields)):
        rows = [row(each.name, getattr(each, "value", each.type), each.annotations) for each in entries]
        lines += [f"| {heading} | meaning |", "|---|---|", *rows, ""] if rows else []
    return lines


def row(name: str, below: object, annotations: Any) -> str:
    """Return a row of a table: a name, what stands below it, and the comment; two columns are enough for a phone."""
    return f"| `{name}`<br>{plain(str(below))} | {comment(annotations)} |"


#: Headings, with how the definitions below them are read and what they consist of.
KINDS = {
    "msg": ("Messages", parse_message_file, {}),
    "srv": ("Services", parse_service_file, {"Request": "request", "Response": "response"}),
    "action": ("Actions", parse_action_file, {"Goal": "goal", "Result": "result", "Feedback": "feedback"}),
}


def messages() -> str:
    """Return a section for each message, service and action."""
    lines = []
    for kind, (heading, parse, parts) in KINDS.items():
        lines += [f"## {heading}", ""]
        for path in sorted(INTERFACES.glob(f"{kind}/*.{kind}")):
            read = parse("atpid_interfaces", str(path))
            lines += [f"### {path.stem}", ""]
            lines += [line for title, part in parts.items() for line in definition_tables(title, getattr(read, part))]
            lines += [] if parts else definition_tables("", read)
    return "\n".join(lines)


def returned(function: Any) -> Iterator[type]:
    """Yield the project's classes that a function returns."""
    annotation = inspect.signature(function, eval_str=True).return_annotation
    if inspect.isclass(annotation) and annotation.__module__.startswith("atpid_"):
        yield annotation


def interface() -> str:
    """Return a section for each name of `import atpid_sim as ap`, and for the classes of what it returns."""
    objects = {f"atpid_sim.{name}": getattr(atpid_sim, name) for name in atpid_sim.api.__all__}
    objects |= {f"atpid_dynamics.api.{name}": getattr(atpid_dynamics.api, name) for name in ("kicked", "sweep")}
    objects["atpid_control.open_run"] = atpid_control.open_run
    functions = {name: each for name, each in objects.items() if not inspect.isclass(each)}
    classes = {each for each in objects.values() if inspect.isclass(each)}
    classes |= {made for each in functions.values() for made in returned(each)}
    lines = ["## Functions", ""]
    for name in functions:
        lines += [f"### {name.rpartition('.')[2]}", "", "```{eval-rst}", f".. autofunction:: {name}", "```", ""]
    lines += ["## Classes", ""]
    for each in sorted(classes, key=lambda one: one.__name__):
        place = f"{each.__module__}.{each.__qualname__}"
        members = ["   :members:", "   :inherited-members: BaseModel, Exception, tuple, object"]
        lines += [f"### {each.__name__}", "", "```{eval-rst}", f".. autoclass:: {place}", *members, "```", ""]
    return "\n".join(lines)


PARTS = {
    "atpid": lambda: command_list("atpid", installed()),
    "studies": lambda: command_list("python -m studies", STUDIES),
    "messages": messages,
    "interface": interface,
}


def tree(caption: str, pages: Iterable[str]) -> str:
    """Return a hidden tree of contents."""
    return "\n".join(["", "```{toctree}", ":hidden:", f":caption: {caption}", *pages, "```", ""])


def linked(page: str, text: str) -> list[str]:
    """Return the pages in the tables of an index, as documents named from the root."""
    targets = [target for row in _ROW.findall(text) for target in _LINK.findall(row)]
    places = [(ROOT / page).parent.joinpath(target).resolve() for target in targets]
    return [f"/{place.relative_to(ROOT).with_suffix('')}" for place in places]


def navigation() -> str:
    """Return the trees of the front page: one for each table of docs/README.md, and the packages' own pages."""
    index = (ROOT / "docs/README.md").read_text(encoding="utf-8")
    trees = [tree("Contents", ["All pages </docs/README>"])]
    for table in re.split(r"^\| (?=[a-z][^|]*\| \|$)", index, flags=re.MULTILINE)[1:]:
        heading = table.partition(" |")[0]
        trees.append(tree(heading[0].upper() + heading[1:], linked("docs/README", table)))
    return "".join(trees)


def fill(_app: Sphinx, document: str, content: list[str]) -> None:
    """Put in what is made: the parts a page asks for, and the navigation."""
    text = re.sub(r"<!-- made: (\w+) -->", lambda found: PARTS[found[1]](), content[0])
    if document == "README":
        text += navigation()
    elif document in INDICES:
        text += tree("Below", linked(document, text))
    content[0] = text


def outdated(*_given: Any) -> list[str]:
    """Return the pages to read again at every build: those with parts that are made from other files."""
    made = [page for page in (ROOT / "docs").glob("*.md") if "<!-- made: " in page.read_text(encoding="utf-8")]
    return ["README", *INDICES, *(f"docs/{page.stem}" for page in made)]


def code_spans(*given: Any) -> None:
    """Write `code` of a docstring as reStructuredText does; pydantic's and the dataclasses' own texts are left out."""
    lines: list[str] = given[-1]
    lines[:] = [re.sub(r"(?<![`:\w])`([^`]+)`(?!`)", r"``\1``", line).replace("*", "\\*") for line in lines]


def versions(app: Sphinx, failure: Exception | None) -> None:
    """List the versions that lie beside this one, for their switch, and begin at its front page."""
    if failure is not None or app.builder.format != "html":
        return
    site = Path(app.outdir).parent
    begin = '<!doctype html><meta http-equiv="refresh" content="0; url={}"><title>ATPID</title>\n'
    (Path(app.outdir) / "index.html").write_text(begin.format("README.html"), encoding="utf-8")
    there = sorted((path.parent.name for path in site.glob("*/README.html")), reverse=True)
    (site / "versions.js").write_text(f"var ATPID_VERSIONS = {json.dumps(there)};\n", encoding="utf-8")
    (site / "index.html").write_text(begin.format(f"{app.config.release}/README.html"), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the above with Sphinx."""
    app.connect("source-read", fill)
    app.connect("env-get-outdated", outdated)
    app.connect("autodoc-process-docstring", code_spans)
    app.connect("build-finished", versions)
    return {"parallel_read_safe": False}
