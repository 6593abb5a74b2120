# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package, as the entry point of the group `atpid.commands` gives them."""

from atpid_common.cli import Commands

_MODES = "atpid_lab.modes.command"
COMMANDS: Commands = {
    "Modes of a structure": {
        "modes cantilever": (f"{_MODES}:CANTILEVER", "modes of a beam with the damper at its tip, for a scene"),
        "modes fit": (f"{_MODES}:RUN", "modes of a recorded run, with their error bars"),
        "modes file": (f"{_MODES}:FILE", "the same of modes in a universal file, computed or measured"),
    },
    "Read, check and mend bags": {
        "bag compare": ("atpid_lab.comparison", "two bags overlaid, their differences in a table"),
        "bag validate": ("atpid_lab.validation", "simulate a recording with its measured support, and compare"),
        "bag export": ("atpid_lab.export.command", "write a bag as CSV, UFF 58, MATLAB or Parquet"),
        "bag import": ("atpid_lab.imports.command", "make a bag of TDMS, UFF 58, MATLAB, CSV or WAV files"),
        "bag traces": ("atpid_lab.traces.command", "write a bag as Foxglove and PlotJuggler plot it"),
    },
    "Calibrate": {
        "calibrate beam": ("atpid_lab.beam.command", "a beam's stiffness, damping and mass from a recording"),
        "calibrate contact": ("atpid_lab.contact.command", "restitution and modulus of a contact from a drop or run"),
    },
}
