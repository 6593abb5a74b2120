# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Both devices at full rate through real nodes, briefly: every scan arrives or is counted as dropped.

That none is dropped depends on what else the machine does; `python -m studies load` measures it.
"""

import json

import pytest

from studies.cli import main


@pytest.mark.slow
def test_every_scan_at_full_rate_arrives_or_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["load", "--seconds", "4", "--json"])
    result = json.loads(capsys.readouterr().out)
    laser, acceleration = result["topics"]["sensors/laser"], result["topics"]["sensors/accelerometer"]
    assert (laser["channels"], laser["rate"]) == (2, 50_000.0)
    assert (acceleration["channels"], acceleration["rate"]) == (3, 12_800.0)
    for tally in (laser, acceleration):
        assert tally["gaps"] == []
        assert tally["lost"] == 0
        assert tally["invalid"] == tally["channels"] * tally["dropped"]
        assert tally["scans"] == tally["next_index"] >= 2.0 * tally["rate"]
    assert result["lost"] == laser["dropped"] + acceleration["dropped"]
    assert status == (1 if result["lost"] else 0)
