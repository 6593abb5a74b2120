# SPDX-License-Identifier: Apache-2.0
"""Baseline methods: those in common use, on the same right-hand side, for comparison only."""

from __future__ import annotations

from atpid_sim.studies.baselines.methods import BASELINES
from atpid_sim.studies.baselines.problem import BaselineError
from atpid_sim.studies.baselines.run import BaselineResult, run_baseline

__all__ = ["BASELINES", "BaselineError", "BaselineResult", "run_baseline"]
