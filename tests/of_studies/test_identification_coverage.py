# SPDX-License-Identifier: Apache-2.0
"""The study of the identifier's error bars: it counts and prints."""

import pytest

from studies.identification import coverage


def test_the_command_prints_its_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage, "CASES", {"white noise, 1 %": coverage.CASES["white noise, 1 %"]})
    assert coverage.table(2, 1)[-1].startswith("| white noise, 1 % | 2 |")
