# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Identification, height selection, recording, replay and reports for the tuned particle impact damper."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atpid_control.runs.run import open_run
else:

    def __getattr__(name):
        """Return `open_run`, loaded when it is first used."""
        if name != "open_run":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from atpid_control.runs.run import open_run

        return open_run


__all__ = ["open_run"]
