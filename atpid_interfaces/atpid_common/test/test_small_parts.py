# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the packages share in small: percentiles of latencies, the words of the messages, notes of what takes long."""

import math
import re
from enum import IntEnum
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.latency import ANOTHER_CLOCK, COUNT, Latencies, percentile
from atpid_common.vocabulary import EventKind, ExciterKind, ExciterMode, Mode, Origin, Quality, RunState, Severity

MESSAGES = Path(__file__).resolve().parents[2] / "atpid_interfaces" / "msg"


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_at_least_that_share_of_the_values_is_not_larger(values: list[float], share: float) -> None:
    found = percentile(values, share)
    assert found in values
    assert sum(value <= found for value in values) >= share * len(values) - 1e-9
    assert sum(value < found for value in values) < share * len(values)


def test_only_the_latest_count_of_one_clock_and_of_nothing_there_is_none() -> None:
    latencies = Latencies()
    for nanoseconds in (500_000_000, 2_000_000):
        for _ in range(COUNT):
            latencies.add(nanoseconds)
    latencies.add(round(2.0 * ANOTHER_CLOCK * 1e9))
    names = [f"stage {which} [ms]" for which in ("p50", "p99", "max")]
    assert latencies.values("stage") == dict.fromkeys(names, "2.0")
    assert Latencies().values("stage") == dict.fromkeys(names, "nan")
    assert math.isnan(percentile([], 0.5))


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
        ("Event", numbers(Severity) | {name: kind for name, kind in vars(EventKind).items() if name.isupper()}),
    ],
)
def test_the_constants_are_those_of_the_message(message: str, expected: dict[str, object]) -> None:
    text = (MESSAGES / f"{message}.msg").read_text()
    found = re.findall(r"^(?:uint8|string) ([A-Z_]+)=(\S+)", text, re.MULTILINE)
    assert {name: value.strip('"') if '"' in value else int(value) for name, value in found} == expected


def test_a_quality_that_no_message_has_is_poor() -> None:
    assert Quality(17) is Quality.POOR
