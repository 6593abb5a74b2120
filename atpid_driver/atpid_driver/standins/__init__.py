# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for the vendors' libraries, so that their real Python packages run without a device.

`build()` compiles them; `environment()` returns the variables of a process that uses them; a `Feed` supplies voltages
and a `Control` injects faults.
"""

from atpid_driver.standins.device import Control, Feed, StandinError, build, environment

__all__ = ["Control", "Feed", "StandinError", "build", "environment"]
