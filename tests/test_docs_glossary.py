# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The glossary names code that exists, in SI units, and with the units that the code gives."""

import re
from typing import NamedTuple

import pytest
from documented import ROOT, exists, owner_and_last

_PAGE = ROOT / "docs/glossary.md"
_NAME = re.compile(r"`(atpid_[\w.]+)`")
#: A product of units: base and derived units of the SI, with powers.
_UNIT = re.compile(r"-|(?:m|kg|s|N|Pa|Hz|J|V|rad)(?:[ /](?:m|kg|s|N|Pa|Hz|J|V|rad)|\^\d(?:\.\d)?)*")


class Quantity(NamedTuple):
    symbol: str
    quantity: str
    unit: str
    thesis: str
    code: str


def quantities() -> list[Quantity]:
    section = _PAGE.read_text(encoding="utf-8").partition("## Quantities")[2].partition("## Terms")[0]
    rows = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    return [Quantity(*(cell.strip() for cell in row)) for row in rows[2:]]


def named() -> list[str]:
    return sorted(set(_NAME.findall(_PAGE.read_text(encoding="utf-8"))))


def unit_in_code(name: str) -> str | None:
    """Return the unit in the description of a scene's field or in a message's definition, where there is one."""
    owner, last = owner_and_last(name)
    field = getattr(owner, "model_fields", {}).get(last)
    if field is not None:
        text = field.description
    elif name.startswith("atpid_interfaces.msg."):
        definition = (ROOT / "atpid_interfaces/atpid_interfaces/msg" / f"{name.split('.')[2]}.msg").read_text(
            encoding="utf-8"
        )
        (text,) = re.findall(rf"^\S+ {last} +#(.*)$", definition, flags=re.MULTILINE)
    else:
        return None
    units = re.findall(r"\[([^\]\[,]+)\]", text)
    return units[0] if units else None


@pytest.mark.parametrize("name", named())
def test_code_named_in_the_glossary_exists(name: str) -> None:
    assert exists(name)


@pytest.mark.parametrize("quantity", quantities(), ids=lambda quantity: quantity.quantity[:40])
def test_each_unit_is_si_and_that_of_the_code(quantity: Quantity) -> None:
    units = quantity.unit.split(", ")
    assert all(_UNIT.fullmatch(unit) for unit in units), quantity.unit
    for name in _NAME.findall(quantity.code):
        assert unit_in_code(name) in (None, *units), name


def test_terms_are_in_alphabetical_order_and_explained() -> None:
    section = _PAGE.read_text(encoding="utf-8").partition("## Terms")[2]
    terms = re.findall(r"^\| ([^|]+) \| [^|]{20,} \|$", section, flags=re.MULTILINE)
    assert len(terms) == section.count("\n| ") - 1
    assert terms == sorted(terms)
