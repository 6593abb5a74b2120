# SPDX-License-Identifier: Apache-2.0
"""Settings of the loop that contradict themselves, each in one line."""

from __future__ import annotations

from atpid_common.errors import InputError


class HoldError(InputError):
    """Settings of the hold or the step back."""


class WatchError(InputError):
    """Settings of the monitoring: rumble or drift."""
