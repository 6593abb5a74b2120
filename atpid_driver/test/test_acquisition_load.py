# SPDX-License-Identifier: Apache-2.0
"""Both devices at full rate through real nodes, briefly; `python -m atpid_driver load` is the long run."""

from __future__ import annotations

import json

import pytest

from atpid_driver.cli import main


@pytest.mark.slow
def test_nothing_is_lost_at_full_rate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["load", "--seconds", "4", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["lost"] == 0
    laser, acceleration = result["topics"]["sensors/laser"], result["topics"]["sensors/accelerometer"]
    assert (laser["channels"], laser["rate"]) == (2, 50_000.0)
    assert (acceleration["channels"], acceleration["rate"]) == (3, 12_800.0)
    for tally in (laser, acceleration):
        assert tally["gaps"] == []
        assert tally["invalid"] == 0
        assert tally["scans"] == tally["next_index"] >= 2.0 * tally["rate"]
