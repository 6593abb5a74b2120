# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package alone, as `atpid` has them among others."""

import sys
from functools import partial

from atpid_common.cli import run_commands

main = partial(run_commands, "atpid", "", {"": {
    "calibrate sensor": ("atpid_driver.calibration.command", "sensor"),
    "calibrate reading": ("atpid_driver.calibration.reading", "reading"),
    "emulator": ("atpid_driver.emulator.command", "emulator"),
    "standin": ("atpid_driver.standins.command", "standin"),
}})  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
