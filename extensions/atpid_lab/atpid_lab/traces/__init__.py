# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A run as Foxglove and PlotJuggler plot it: one number a message, states as text, the damper in three dimensions."""
