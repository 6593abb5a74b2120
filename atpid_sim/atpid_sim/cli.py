# SPDX-License-Identifier: Apache-2.0
"""The commands of `python -m atpid_sim COMMAND`."""

from functools import partial

from atpid_common.cli import run_commands

#: Command: (module, what it does).
COMMANDS = {
    "simulate": ("atpid_sim.commands.simulate", "run one scene: amplitude, error estimate, energy"),
    "map": ("atpid_sim.commands.map", "compute the best height over support amplitudes and grain masses"),
    "atlas": ("atpid_sim.commands.atlas", "compute types of motion, best heights, their stability and the cliff"),
    "tradeoff": ("atpid_sim.commands.tradeoff", "measure speed against accuracy on one scene: table and picture"),
    "extremes": ("atpid_sim.commands.extremes", "count the outcomes of random systems far outside the usual range"),
    "sweep": ("atpid_sim.commands.sweep", "simulate the standard task at many heights and time it"),
}

#: Runs one command, by default that of the process's arguments; returns its exit status (`run_commands`).
main = partial(run_commands, "atpid_sim", "The particle impact damper, simulated.", COMMANDS)
