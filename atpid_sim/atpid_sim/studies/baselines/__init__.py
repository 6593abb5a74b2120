# SPDX-License-Identifier: Apache-2.0
"""Baseline methods: those in common use, on the same right-hand side, for comparison only."""

from atpid_sim.studies.baselines.methods import BASELINES
from atpid_sim.studies.baselines.problem import BaselineError
from atpid_sim.studies.baselines.run import BaselineResult, half_peak_to_peak, run_baseline

__all__ = ["BASELINES", "BaselineError", "BaselineResult", "half_peak_to_peak", "run_baseline"]
