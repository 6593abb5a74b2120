# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node graph as processes: which nodes, with which parameters, started, watched and stopped; bench and stand."""
