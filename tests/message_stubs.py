# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fields of the project's messages for mypy: `python tests/message_stubs.py` writes atpid_interfaces/stubs anew."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosidl_adapter.parser import parse_action_file, parse_message_file, parse_service_file

ROOT = Path(__file__).resolve().parents[1]
DEFINITIONS = ROOT / "atpid_interfaces" / "atpid_interfaces"
STUBS = ROOT / "atpid_interfaces" / "stubs" / "atpid_interfaces"
#: How each kind of definition is read, and its parts.
KINDS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "msg": (parse_message_file, ()),
    "srv": (parse_service_file, ("Request", "Response")),
    "action": (parse_action_file, ("Goal", "Result", "Feedback")),
}
_HEAD = f"""\
# SPDX-License-Identifier: Apache-2.0
# Made by `python {Path(__file__).relative_to(ROOT)}` from the definitions; a test compares.
"""
_IMPORTS = ("array import array", "collections.abc import Sequence", "typing import Final")
_TYPES = {"float64": "float", "string": "str", "bool": "bool", "Header": "Header"}


def stubs() -> dict[str, str]:
    """Return the text of each stub file by its name."""
    made = {"__init__.pyi": _HEAD}
    for kind, (parse, parts) in KINDS.items():
        lines: list[str] = []
        for path in sorted((DEFINITIONS / kind).glob(f"*.{kind}")):
            read = parse("atpid_interfaces", str(path))
            lines += ["", "", f"class {path.stem}:", *([] if parts else _body(read, "    "))]
            for part in parts:
                lines += [f"    class {part}:", *_body(getattr(read, part.lower()), "        ")]
        words = set(re.findall(r"\w+", "\n".join(lines)))
        imports = "".join(f"from {line}\n" for line in _IMPORTS if line.rpartition(" ")[2] in words)
        if "Header" in words:
            imports += "\nfrom std_msgs.msg import Header\n"
        made[f"{kind}.pyi"] = _HEAD + imports + "\n".join(lines) + "\n"
    return made


def _body(read: Any, indent: str) -> Iterator[str]:
    """Yield the lines of a class: constants, constructor, fields; a sequence is read as rosidl keeps it."""
    for constant in read.constants:
        yield f"{indent}{constant.name}: Final = {json.dumps(constant.value)}"
    fields: list[tuple[str, str, str]] = []
    for field in read.fields:
        kind = _TYPES.get(field.type.type, "int")
        sequence = "list[str]" if kind == "str" else f"array[{kind}]"
        types = (sequence, f"Sequence[{kind}]") if field.type.is_array else (kind, kind)
        fields.append((field.name, *types))
    arguments = "".join(f", {name}: {written} = ..." for name, _, written in fields)
    yield f"{indent}def __init__(self, *{arguments}) -> None: ..."
    for name, read_as, written in fields:
        if read_as == written:
            yield f"{indent}{name}: {read_as}"
        else:
            yield f"{indent}@property"
            yield f"{indent}def {name}(self) -> {read_as}: ..."
            yield f"{indent}@{name}.setter"
            yield f"{indent}def {name}(self, value: {written}) -> None: ..."


if __name__ == "__main__":
    STUBS.mkdir(parents=True, exist_ok=True)
    for file, text in stubs().items():
        (STUBS / file).write_text(text, encoding="utf-8")
