# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How many tests there are, of which kind, and what they lean on: `python tests/inventory.py [REPOSITORY]`."""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACES = ("tests/**/*.py", "atpid_*/test/**/*.py", "atpid_interfaces/*/test/**/*.py", "extensions/*/test/**/*.py")
#: Four words in a row: an assertion on these is one on a sentence.
SENTENCE = re.compile(r"[A-Za-z]+[,;:]? [a-z]+[,;:]? [a-z]+[,;:]? [a-z]+")
#: Names that begin with an underscore and are public: of named tuples, argparse, ctypes and notebooks.
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_fields_", "_repr_html_"}
#: A test is of the first kind whose text its file has.
KINDS = {"of the firmware": "emulator", "of nodes": "rclpy", "of processes": "subprocess", "of functions": ""}


@dataclass
class Inventory:
    """Counts over files: lines, test functions by kind, property tests, assertions on sentences, private names."""

    lines: int
    functions: dict[str, int]
    properties: int
    sentences: int
    private: int


def _texts(tree: ast.AST) -> Iterator[str]:
    yield from (n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str))


def _on_a_sentence(node: ast.AST) -> bool:
    """Return whether this asserts a sentence, itself or by `match=`."""
    asserted = isinstance(node, ast.Assert) or (isinstance(node, ast.keyword) and node.arg == "match")
    return asserted and any(SENTENCE.search(text) for text in _texts(node))


def _private(node: ast.AST) -> int:
    """Return how many private names of others this reaches."""
    hidden = re.compile("_(?!_)")
    if isinstance(node, ast.Attribute) and hidden.match(node.attr) and node.attr not in PUBLIC:
        return not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"))
    if isinstance(node, ast.ImportFrom):
        return sum(bool(hidden.match(each.name)) for each in node.names)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "setattr":
        return any(re.search(r"(^|\.)_(?!_)", text) for each in node.args[:2] for text in _texts(each))
    return 0


def inventory(folder: Path = ROOT) -> Inventory:
    """Count over all test files of a repository."""
    found = Inventory(0, dict.fromkeys(KINDS, 0), 0, 0, 0)
    for path in sorted({path for place in PLACES for path in folder.glob(place)}):
        text = path.read_text(encoding="utf-8")
        found.lines += text.count("\n")
        kind = next(kind for kind, word in KINDS.items() if word in text)
        for node in ast.walk(ast.parse(text)):
            found.sentences += _on_a_sentence(node)
            found.private += _private(node)
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                found.functions[kind] += 1
                found.properties += any("given(" in ast.unparse(each) for each in node.decorator_list)
    return found


if __name__ == "__main__":
    counts = inventory(Path(sys.argv[1]) if sys.argv[1:] else ROOT)
    print(f"{counts.lines} lines, {sum(counts.functions.values())} test functions, of them")
    for name, count in counts.functions.items():
        print(f"  {count:5} {name}")
    print(f"{counts.properties} are properties, tried with many examples")
    print(f"{counts.sentences} assertions on a sentence, {counts.private} private names reached")
