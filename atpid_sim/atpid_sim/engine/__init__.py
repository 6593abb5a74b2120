# SPDX-License-Identifier: Apache-2.0
"""The compiled engine: flights in closed form, contacts integrated (docs/engine.md)."""

from __future__ import annotations

from atpid_sim import kernel_cache as kernel_cache
