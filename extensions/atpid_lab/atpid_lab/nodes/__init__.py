# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node of this package: a running graph for Foxglove and PlotJuggler."""
