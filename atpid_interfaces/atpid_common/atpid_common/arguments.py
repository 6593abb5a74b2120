# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Types of command-line arguments: what a number, a path or a name may be, checked once, where it is given.

Each is a function of the text for `type=` of argparse; its error is what was given and what is allowed. Whether a file
is there and can be read or written is checked by what reads or writes it: `atpid_common.files`, `atpid_common.output`.
"""

import math
import os
import re
from argparse import ArgumentTypeError
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

#: Longest path and longest name in one, in bytes, of Linux.
_LONGEST_PATH, _LONGEST_NAME = 4095, 255
#: Longest text in a message.
_SHOWN = 60
#: Largest seed of a random sequence.
MOST_SEED = 2**32 - 1
#: A number, perhaps with a decimal comma; several joined by colons; one with a unit. Digits are matched in one way
#: only: in two, the time to refuse a long text grows with the square of its length.
_NUMBER = r"[-+]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_NUMBERS, _WITH_UNIT = re.compile(rf"{_NUMBER}(?::{_NUMBER})*"), re.compile(rf"{_NUMBER}\s*([^\W\d_]+|%)")
#: A name in the graph: /node, node or ~/topic, with namespaces.
_NAME = re.compile(r"(?:~?/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")


def refuse(text: str, allowed: str) -> NoReturn:
    """Raise argparse's error: `text` was given, `allowed` is what may be."""
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}... ({len(text)} characters)"
    raise ArgumentTypeError(f"given {shown or 'nothing'}; allowed: {allowed}")


def refuse_number(text: str, allowed: str) -> NoReturn:
    """Raise argparse's error of a text that is none of the numbers `allowed`: a decimal comma or a unit is named."""
    if "," in text and _NUMBERS.fullmatch(text):
        allowed = f"a number with a decimal point: {text.replace(',', '.')}"
    elif found := _WITH_UNIT.fullmatch(text.strip()):
        allowed += ", as a share: 1 % is 0.01" if found[1] == "%" else ", without the unit"
    refuse(text, allowed)


def number(text: str) -> float:
    """Return a number, whose range is checked by what it is for."""
    with suppress(ValueError):
        if abs(value := float(text)) <= 1e18:
            return value
    return refuse_number(text, "a number")


def real(low: float, high: float, unit: str = "", *, above: bool = False) -> Callable[[str], float]:
    """Return the type of a finite number from `low`, or `above` it, to `high`."""
    allowed = f"{'above ' if above else ''}{low:g} to {high:g}{unit and ' ' + unit}"

    def read(text: str) -> float:
        with suppress(ValueError):
            value = float(text)
            if low <= value <= high and math.isfinite(value) and not (above and value == low):
                return value
        return refuse_number(text, allowed)

    return read


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return the type of a whole number from `low` to `high`."""

    def read(text: str) -> int:
        with suppress(ValueError):
            if low <= (value := int(text)) <= high:
                return value
        return refuse(text, f"a whole number from {low} to {high}")

    return read


def positive(unit: str = "") -> Callable[[str], float]:
    """Return the type of a number above 0."""
    return real(0.0, 1e9, unit, above=True)


def file_path(text: str) -> Path:
    """Return a path; refuse what no file or folder can be called."""
    if not text or "\0" in text:
        refuse(text.replace("\0", "\\0"), "the path of a file or folder")
    parts = Path(text).parts
    if len(os.fsencode(text)) > _LONGEST_PATH or any(len(os.fsencode(part)) > _LONGEST_NAME for part in parts):
        refuse(text, f"a path of at most {_LONGEST_PATH} bytes, {_LONGEST_NAME} a name")
    return Path(text)


def path_to(*suffixes: str) -> Callable[[str], Path]:
    """Return the type of a file to write, whose name ends in one of `suffixes`: none of another kind is replaced."""

    def read(text: str) -> Path:
        found = file_path(text)
        if found.suffix.lower() not in suffixes:
            refuse(text, f"a file that ends in {' or '.join(suffixes)}")
        return found

    return read


def word(text: str) -> str:
    """Return a word that is not empty and prints as one line."""
    if not text.strip() or not text.isprintable() or len(text) > _LONGEST_NAME:
        refuse(text, f"1 to {_LONGEST_NAME} printable characters")
    return text


def text(given: str) -> str:
    """Return a text, which may be empty, that prints as one line."""
    return word(given) if given else given


def graph_name(text: str) -> str:
    """Return the name of a node or a topic."""
    if len(text) > _LONGEST_NAME or not _NAME.fullmatch(text):
        refuse(text, "the name of a node or topic, such as /motor_node")
    return text


def rising(low: float, high: float, allowed: str, *, closed: bool = True) -> Callable[[str], tuple[float, float]]:
    """Return the type of two rising numbers A:B from `low`, without it where not `closed`, to `high`."""

    def read(text: str) -> tuple[float, float]:
        with suppress(ValueError):
            first, last = (float(part) for part in text.split(":"))
            if low <= first < last <= high and (closed or first > low):
                return first, last
        return refuse_number(text, allowed)

    return read
