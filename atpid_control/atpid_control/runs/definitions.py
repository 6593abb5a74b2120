# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Message definitions and type hashes of the installed packages, as a bag keeps them."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from atpid_control.runs.errors import TypeUnknownError

_SEPARATOR = "=" * 80
_PRIMITIVES = {"bool", "byte", "char", "string", "wstring", "float32", "float64"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_FIELD = re.compile(r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?:\[(?:<=)?\d*\])?\s+\w+(?!\w|\s*=)")  # not a constant
_HANDSHAKE = re.compile(r"^std_msgs/Header +header\b.*\nbool +handshake\b", re.MULTILINE)


@dataclass(frozen=True)
class MessageType:
    """One message type with everything a reader without the workspace needs."""

    name: str  # pkg/msg/Name
    definition: str  # its .msg file and, after separators, those of all types inside it
    hash: str  # RIHS01_...
    has_header: bool  # the first field is a std_msgs/Header, so that the stamp is at a known place
    has_handshake: bool  # and the second is `bool handshake`


@cache
def message_type(name: str) -> MessageType:
    """Return the type `name` ("pkg/msg/Name") of an installed package; raise TypeUnknownError where there is none."""
    text = _text_of(name)
    parts, seen, waiting = [text], {name}, list(_inside(name, text))
    while waiting:
        inner = waiting.pop(0)
        if inner in seen:
            continue
        seen.add(inner)
        inner_text = _text_of(inner)
        parts += [_SEPARATOR, f"MSG: {inner.replace('/msg/', '/')}", inner_text]
        waiting += _inside(inner, inner_text)
    has_header = next(_inside(name, text, all_fields=True), "") == "std_msgs/msg/Header"
    has_handshake = has_header and _HANDSHAKE.search(text) is not None
    described = json.loads(_file_of(name, ".json").read_text(encoding="utf-8"))
    type_hash = next(str(entry["hash_string"]) for entry in described["type_hashes"] if entry["type_name"] == name)
    return MessageType(name, "\n".join(parts), type_hash, has_header, has_handshake)


def split_name(name: str) -> tuple[str, str]:
    """Return package and message of "pkg/msg/Name"; raise TypeUnknownError for anything else."""
    parts = name.split("/")
    if len(parts) != 3 or parts[1] != "msg" or not all(parts):
        raise TypeUnknownError(
            f"message type: given {name!r}; allowed: pkg/msg/Name, as `ros2 interface list` prints it"
        )
    return parts[0], parts[2]


def _file_of(name: str, suffix: str) -> Path:
    # imported here: reading a bag needs neither ROS nor a workspace
    from ament_index_python.packages import get_package_share_directory

    package, message = split_name(name)
    try:
        path = Path(get_package_share_directory(package)) / "msg" / f"{message}{suffix}"
    except (LookupError, OSError):
        raise TypeUnknownError(
            f"message type {name}: the package {package} is not in this shell: source its workspace"
        ) from None
    if not path.is_file():
        raise TypeUnknownError(
            f"message type {name}: {package} has no such message; look at `ros2 interface package {package}`"
        )
    return path


def _text_of(name: str) -> str:
    return _file_of(name, ".msg").read_text(encoding="utf-8")


def _inside(name: str, text: str, all_fields: bool = False) -> Iterator[str]:
    """Yield the full names of the message types among the fields of `text` (primitives too with `all_fields`)."""
    package, _ = split_name(name)
    for line in text.splitlines():
        field = _FIELD.match(line.split("#", 1)[0].strip())
        if field and field["type"] not in _PRIMITIVES:
            parts = field["type"].split("/")
            yield f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}"
        elif field and all_fields:
            yield field["type"]
