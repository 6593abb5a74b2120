# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The studies of `python -m studies NAME`, from the repository."""

from functools import partial

from atpid_common.cli import Commands, run_commands

#: Study: (module, what it measures).
COMMANDS: Commands = {
    "The method": {
        "thesis": ("studies.thesis.command", "compute the figures and tables of the thesis beside its own numbers"),
        "methods": ("studies.methods.command", "methods of selection and passive dampers on the same scenes"),
        "atlas": ("studies.atlas.command", "types of motion, best heights, their stability and the cliff"),
    },
    "The arithmetic": {
        "tradeoff": ("studies.tradeoff.command", "speed against accuracy on one scene: table and picture"),
        "tradeoff-page": ("studies.tradeoff.page", "the page of three such tables"),
    },
    "The stand": {
        "faults": ("studies.fault_matrix.command", "run the fault matrix through the graph, and make its page"),
        "load": ("studies.load.command", "stream both devices at full rate through ROS 2, count what is lost"),
    },
    "Pictures and pages": {
        "figures": ("studies.figures.command", "make the pictures of README and docs"),
        "parameters": ("studies.parameters", "make the page of the parameters and the parameter files"),
    },
}

#: Runs one study, by default that of the process's arguments; returns its exit status (`run_commands`).
main = partial(run_commands, "python -m studies", "What measures the project; not installed.", COMMANDS)
