# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""YAML read with the numbers of YAML 1.2: `2.1e8` is a number, `1:30` and `yes` are text, no key appears twice.

Only mappings, sequences, text, numbers, true, false and null: no other tags, and no aliases that repeat without end.
What is not right is a `SceneError`, as all that is wrong with a scene.
"""

import re
from collections.abc import Hashable
from typing import Any

import yaml

from atpid_common.errors import InputError
from atpid_common.files import Document


class SceneError(InputError):
    """A scene that cannot be used; the message is one line: file, key, what was given, what is allowed."""

    def __init__(self, message: str) -> None:
        """Write out what does not print in `message`, such as a line's end in a key or a column's name."""
        printable = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
        super().__init__("".join(printable))


_BOOLEAN = re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$")
_INTEGER = re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$")
_FLOAT = re.compile(
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)


#: Tags of the core schema.
_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("map", "seq", "str", "int", "float", "bool", "null")}
#: Values in a document at most, those of aliases counted wherever they stand.
_MOST = 1_000_000
#: Levels of blocks within blocks at most.
_DEEPEST = 50
#: libyaml's loader where PyYAML was built with it: ten times as fast.
_Safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Safe):  # type: ignore[misc]
    """Safe loader with the core schema of YAML 1.2."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 (PyYAML's own attribute)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a key is no word", key.start_mark)
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key {key.value!r} appears twice", key.start_mark)
            seen.add(key.value)
        mapping: dict[Hashable, object] = super().construct_mapping(node, deep)
        return mapping


# the order matters: what is an integer is a float as well
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", _BOOLEAN, list("tTfF"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _INTEGER, list("-+0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
_Loader.add_constructor(
    "tag:yaml.org,2002:int", lambda _, node: int(node.value, 0 if node.value.startswith(("0o", "0x")) else 10)
)


def read_yaml(text: str, source: str) -> Any:
    """Return the document in `text`; raise SceneError naming `source` and the line where it is not YAML."""
    try:
        _check_depth(text, source)
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _values(node, {})
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except SceneError:
        raise
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{source}:{mark.line + 1}" if mark else source
        raise SceneError(f"{where}: not readable as YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError, LookupError, TypeError, OverflowError, RecursionError) as error:
        raise SceneError(f"{source}: not readable as YAML: {' '.join(str(error).split())[:200]}") from None


def _check_depth(text: str, source: str) -> None:
    """Raise SceneError where blocks are nested deeper than any scene's: libyaml's recursion ends the process."""
    depth = 0
    for event in yaml.parse(text, Loader=_Safe):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise SceneError(f"{source}: not readable as YAML: more than {_DEEPEST} levels of blocks")


def _values(node: yaml.Node, known: dict[int, int]) -> int:
    """Return how many values a node holds, aliases expanded; raise ConstructorError for too many or another tag."""
    if id(node) in known:
        if not known[id(node)]:
            raise yaml.constructor.ConstructorError(None, None, "an alias contains itself", node.start_mark)
        return known[id(node)]
    known[id(node)] = 0  # until its own values are counted
    if node.tag not in _TAGS:
        raise yaml.constructor.ConstructorError(None, None, f"tag {node.tag} is not read", node.start_mark)
    inner = node.value if isinstance(node, yaml.SequenceNode) else ()
    if isinstance(node, yaml.MappingNode):
        inner = [part for pair in node.value for part in pair]
    count = 1 + sum(_values(part, known) for part in inner)
    if count > _MOST:
        raise yaml.constructor.ConstructorError(None, None, f"more than {_MOST} values", node.start_mark)
    known[id(node)] = count
    return count


def write_yaml(mapping: Document) -> str:
    """Return `mapping` as YAML text that YAML 1.1 and 1.2 readers understand alike."""
    text: str = yaml.safe_dump(mapping, sort_keys=False, default_flow_style=None, width=120)
    return text
