# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports of recorded runs: stages, tables, pictures and one page (docs/recording.md)."""

from atpid_control.views.report.page import Report, report
from atpid_control.views.report.stages import Stage, stages

__all__ = ["Report", "Stage", "report", "stages"]
