# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Baseline methods: those in common use, on the same right-hand side, for comparison only."""

from pathlib import Path

from atpid_sim.kernel import KERNEL_SOURCES, share_cache

share_cache("baselines", Path(__file__).parent.glob("*.py"), KERNEL_SOURCES)  # before any of them is imported

from studies.baselines.methods import BASELINES  # noqa: E402
from studies.baselines.problem import BaselineError  # noqa: E402
from studies.baselines.run import BaselineResult, half_peak_to_peak, run_baseline  # noqa: E402

__all__ = ["BASELINES", "BaselineError", "BaselineResult", "half_peak_to_peak", "run_baseline"]
