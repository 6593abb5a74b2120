# SPDX-License-Identifier: Apache-2.0
"""The one error a height map can raise."""

from __future__ import annotations

from atpid_common.errors import InputError


class MapError(InputError):
    """A map that cannot be made, read or used; one line: what was given, what is allowed, what to do."""
