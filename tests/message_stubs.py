# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fields of the project's messages for mypy: `python tests/message_stubs.py` writes atpid_interfaces/stubs anew.

rosidl's classes carry no types, so that a misspelt field would be found by a test alone, where its line runs.
"""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEFINITIONS = ROOT / "atpid_interfaces" / "atpid_interfaces"
STUBS = ROOT / "atpid_interfaces" / "stubs" / "atpid_interfaces"
#: Parts of a definition, between lines of `---`.
PARTS = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
_FIELD = re.compile(r"(?P<type>[\w/]+)(?P<array>\[\])?\s+(?P<name>\w+)(?:=(?P<constant>\"[^\"]*\"|\S+))?")
_HEAD = f"""\
# SPDX-License-Identifier: Apache-2.0
# Made by `python {Path(__file__).relative_to(ROOT)}` from the definitions; a test compares.
"""
_IMPORTS = """\
from array import array
from collections.abc import Sequence
from typing import Final

from std_msgs.msg import Header
"""


def stubs() -> dict[str, str]:
    """Return the text of each stub file by its name."""
    made = {"__init__.pyi": _HEAD}
    for kind, parts in PARTS.items():
        lines: list[str] = []
        for path in sorted((DEFINITIONS / kind).glob(f"*.{kind}")):
            texts = path.read_text(encoding="utf-8").split("\n---\n")
            if kind == "msg":
                lines += ["", "", f"class {path.stem}:", *_body(texts[0], "    ")]
                continue
            lines += ["", "", f"class {path.stem}:"]
            for part, text in zip(parts, texts, strict=True):
                lines += [f"    class {part}:", *_body(text, "        ")]
        body = "\n".join(lines)
        used = "\n".join(line for line in _IMPORTS.splitlines() if not line or _imported(line) & _words(body))
        made[f"{kind}.pyi"] = f"{_HEAD}{used.strip()}\n{body}\n".replace("\n\n\n\n", "\n\n\n")
    return made


def _imported(line: str) -> set[str]:
    return set(line.partition(" import ")[2].split(", "))


def _words(text: str) -> set[str]:
    return set(re.findall(r"\w+", text))


def _body(definition: str, indent: str) -> Iterator[str]:
    """Yield the lines of a class: constants, constructor, fields; a sequence is read as rosidl keeps it."""
    fields: list[tuple[str, str, str]] = []
    for line in definition.splitlines():
        field = _FIELD.match(line)
        if field is None:
            continue
        kind = _plain(field["type"])
        if field["constant"]:
            yield f"{indent}{field['name']}: Final = {field['constant']}"
        elif field["array"]:
            read = "list[str]" if kind == "str" else f"array[{kind}]"
            fields.append((field["name"], read, f"Sequence[{kind}]"))
        else:
            fields.append((field["name"], kind, kind))
    arguments = "".join(f", {name}: {written} = ..." for name, _, written in fields)
    yield f"{indent}def __init__(self, *{arguments}) -> None: ..."
    for name, read, written in fields:
        if read == written:
            yield f"{indent}{name}: {read}"
        else:
            yield f"{indent}@property"
            yield f"{indent}def {name}(self) -> {read}: ..."
            yield f"{indent}@{name}.setter"
            yield f"{indent}def {name}(self, value: {written}) -> None: ..."


def _plain(kind: str) -> str:
    if kind.startswith(("uint", "int")):
        return "int"
    return {"float64": "float", "string": "str", "bool": "bool", "std_msgs/Header": "Header"}[kind]


if __name__ == "__main__":
    STUBS.mkdir(parents=True, exist_ok=True)
    for file, written in stubs().items():
        (STUBS / file).write_text(written, encoding="utf-8")
