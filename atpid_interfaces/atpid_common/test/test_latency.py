# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Percentiles of the latest latencies."""

import math

from hypothesis import given
from hypothesis import strategies as st

from atpid_common.latency import ANOTHER_CLOCK, COUNT, Latencies, percentile

finite = st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=300)


@given(finite, st.floats(0.01, 1.0))
def test_at_least_that_share_of_the_values_is_not_larger(values: list[float], share: float) -> None:
    found = percentile(values, share)
    assert found in values
    assert sum(value <= found for value in values) >= share * len(values) - 1e-9
    assert sum(value < found for value in values) < share * len(values)


def test_of_nothing_there_is_none() -> None:
    assert math.isnan(percentile([], 0.5))
    assert Latencies().values("sample to command")["sample to command p99 [ms]"] == "nan"


def test_the_latest_count_and_those_of_another_clock_do_not() -> None:
    latencies = Latencies()
    for _ in range(COUNT):
        latencies.add(500_000_000)
    for _ in range(COUNT):
        latencies.add(2_000_000)
    latencies.add(round(2.0 * ANOTHER_CLOCK * 1e9))
    assert latencies.values("stage") == {"stage p50 [ms]": "2.0", "stage p99 [ms]": "2.0", "stage max [ms]": "2.0"}
