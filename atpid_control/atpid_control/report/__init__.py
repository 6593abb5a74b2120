# SPDX-License-Identifier: Apache-2.0
"""Reports of recorded runs: stages, tables, pictures and one page (docs/recording.md)."""

from atpid_control.report.make import Report, report
from atpid_control.report.run import Run, read_run
from atpid_control.report.stages import Stage, stages

__all__ = ["Report", "Run", "Stage", "read_run", "report", "stages"]
