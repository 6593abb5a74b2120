# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures and tables of the documentation, each made by a command."""
