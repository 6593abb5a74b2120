# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The compiled engine: flights in closed form, contacts integrated (docs/engine.md)."""
