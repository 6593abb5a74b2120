# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulated motor stand: the real firmware on an emulated Mega 2560 behind a pty, for tests and demonstrations."""

from atpid_driver.emulator.emulator import PACKAGES, Emulator, build_emulator, build_firmware, missing_tools

__all__ = ["PACKAGES", "Emulator", "build_emulator", "build_firmware", "missing_tools"]
