# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A run as Foxglove and PlotJuggler plot it: one number a message, states as text, the damper in three dimensions."""

from atpid_lab.traces.file import Tracer, write_traces
from atpid_lab.traces.records import PREFIX

__all__ = ["PREFIX", "Tracer", "write_traces"]
