# SPDX-License-Identifier: Apache-2.0
"""The commands of `python -m atpid_sim COMMAND`."""

from __future__ import annotations

from collections.abc import Sequence

from atpid_common.cli import run_commands

#: Command: (module, what it does).
COMMANDS = {
    "simulate": ("atpid_sim.simulate_command", "run one scene and say how large the beam swings"),
    "map": ("atpid_sim.map_command", "compute the best height over support amplitudes and grain masses"),
    "tradeoff": ("atpid_sim.tradeoff_command", "measure speed against accuracy on one scene: table and picture"),
    "extremes": ("atpid_sim.extremes_command", "run random systems far outside the usual range and count the outcomes"),
    "sweep": ("atpid_sim.sweep_command", "simulate the standard task at many heights and say how fast that goes"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status (`atpid_common.cli.guarded`)."""
    return run_commands("atpid_sim", "The particle impact damper, simulated.", COMMANDS, argv)
