# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The vocabulary has the constants of the message files, all of them, with their values."""

import re
from enum import IntEnum
from pathlib import Path

import pytest

from atpid_common.vocabulary import EventKind, ExciterKind, ExciterMode, Mode, Origin, Quality, RunState, Severity

MESSAGES = Path(__file__).resolve().parents[2] / "atpid_interfaces" / "msg"
KINDS = {name: value for name, value in vars(EventKind).items() if isinstance(value, str) and name.isupper()}


def numbers(*kinds: type[IntEnum]) -> dict[str, object]:
    return {constant.name: int(constant) for kind in kinds for constant in kind}


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("CeilingState", numbers(Mode)),
        ("Excitation", numbers(Quality, Origin)),
        ("ExcitationCommand", numbers(ExciterKind)),
        ("ExcitationState", numbers(ExciterMode)),
        ("SupervisorState", numbers(RunState)),
        ("Event", numbers(Severity) | KINDS),
    ],
)
def test_its_constants_are_those_of_the_message(message: str, expected: dict[str, object]) -> None:
    text = (MESSAGES / f"{message}.msg").read_text()
    found = re.findall(r"^(?:uint8|string) ([A-Z_]+)=(\S+)", text, re.MULTILINE)
    assert {name: value.strip('"') if '"' in value else int(value) for name, value in found} == expected


def test_a_quality_that_no_message_has_is_poor() -> None:
    assert Quality(17) is Quality.POOR
