# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of a scene: integration, choice of the fidelity level, energy, reproducibility."""
