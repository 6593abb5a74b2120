# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The latency of a recorded run: each stage against the stamps, and nothing where stamps are the clock."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import block, make

from atpid_control.recording.session import RecordingSession
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.run import open_run
from atpid_control.runs.topics import DEFAULT, parse
from atpid_control.views.report.latency import STAGES, latency_of, summary_line
from atpid_control.views.report.page import page
from atpid_control.views.report.view import view_of

START, RATE, SCANS = 1_700_000_000_123_456_789, 1000.0, 50
MS = 1_000_000


def recorded(folder: Path, delays: list[tuple[int, int, int]]) -> Path:
    """Record blocks whose messages arrive so many ns after the last sample, the block and the estimate."""
    topics = [type(topic)(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, False)]
    session = RecordingSession(
        folder, new_run(None, clock="real time"), topics, lockstep=False, offered=lambda _topic: (Qos(),)
    )
    for k, (to_block, to_estimate, to_command) in enumerate(delays):
        last = START + round((k * SCANS + SCANS - 1) / RATE * 1e9)
        now = last + to_block
        session.receive("/sensors/laser", block(k * SCANS, np.zeros((SCANS, 2)), RATE, START), now)
        session.receive("/excitation", make("Excitation", last, "plant:laser"), now + to_estimate)
        session.receive("/ceiling/command", make("CeilingCommand", last, "plant:laser"), now + to_estimate + to_command)
    session.close()
    return folder


def test_each_stage_is_measured_from_the_last_sample_on(tmp_path: Path) -> None:
    delays = [(2 * MS, 3 * MS, 1 * MS)] * 198 + [(2 * MS, 40 * MS, 1 * MS), (2 * MS, 3 * MS, 300 * MS)]
    latency = latency_of(open_run(recorded(tmp_path / "bag", delays)))
    assert tuple(latency) == STAGES
    assert latency["sample_to_block"] == pytest.approx({"p50": 2e-3, "p99": 2e-3, "max": 2e-3})
    assert latency["block_to_estimate"] == pytest.approx({"p50": 3e-3, "p99": 3e-3, "max": 40e-3})
    assert latency["estimate_to_command"] == pytest.approx({"p50": 1e-3, "p99": 1e-3, "max": 300e-3})
    assert latency["sample_to_command"] == pytest.approx({"p50": 6e-3, "p99": 6e-3, "max": 305e-3})
    assert summary_line(latency).startswith(
        "sample to command: median 6.0, 99 % 6.0, largest 305.0 ms (99 % of sample to"
    )


def test_a_run_without_commands_has_no_latency(tmp_path: Path) -> None:
    run = open_run(recorded(tmp_path / "bag", [(2 * MS, 3 * MS, 1 * MS)]))
    sensors = {name: table for name, table in run.tables.items() if name != "ceiling/command"}
    latency = latency_of(replace(run, tables=sensors))
    assert latency == {}
    assert summary_line(latency) == ""


def test_the_report_of_a_run_in_real_time_shows_it(tmp_path: Path) -> None:
    delays = [(2 * MS, 3 * MS, 1 * MS)] * 99 + [(2 * MS, 40 * MS, 1 * MS)]
    text = page(view_of(recorded(tmp_path / "bag", delays)))
    assert "<h2>Latency</h2>" in text
    assert "<td>block to estimate</td><td>3.0</td><td>3.0</td><td>40.0</td>" in text
