# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Modes of a structure from its dimensions or a file of modes, as a scene has them."""
