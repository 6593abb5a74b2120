# SPDX-License-Identifier: Apache-2.0
"""The commands of `python -m atpid_control COMMAND`."""

from collections.abc import Sequence

from atpid_common.cli import run_commands

#: Command: (module, what it does).
COMMANDS = {
    "bench": ("atpid_control.commands.bench", "run a scene through the whole node graph: bag, summary and report"),
    "soak": ("atpid_control.commands.soak", "run the bench for hours: what grows, what is lost, which rule is broken"),
    "stand": ("atpid_control.commands.stand", "run the test stand: hardware nodes, identifier, selector and recorder"),
    "seeds": ("atpid_control.commands.seeds", "run scenes through the loop with many noises, without the node graph"),
    "replay": ("atpid_control.commands.replay", "play a bag through identifier and selector again, and compare"),
    "traces": ("atpid_control.commands.traces", "write a bag as Foxglove and PlotJuggler plot it"),
    "report": ("atpid_control.commands.report", "make the report of a bag: an HTML page and pictures"),
    "export": ("atpid_control.commands.export", "write a bag as CSV, UFF 58, MATLAB or Parquet"),
    "analyse": ("atpid_control.commands.analyse", "frequency response, spectra, decrement and orders of a bag"),
    "select": ("atpid_control.commands.select", "select the ceiling height for a scene's excitation"),
    "compare": ("atpid_control.commands.compare", "compare the methods with passive dampers on the same scenes"),
    "compare-bags": ("atpid_control.commands.compare_bags", "two bags overlaid, their differences in a table"),
    "off-resonance": (
        "atpid_control.commands.off_resonance",
        "compare selection off resonance with brute force, in random systems",
    ),
    "learn": ("atpid_control.commands.learn", "train the method `learned` from simulated systems"),
    "design": ("atpid_control.commands.design", "design a damper for a structure: grain, heights, motor, reduction"),
    "calibrate-beam": (
        "atpid_control.commands.calibrate_beam",
        "find a beam's stiffness, damping and mass from a recording",
    ),
    "validate": ("atpid_control.commands.validate", "simulate a recording with its measured support, and compare"),
    "study": ("atpid_control.commands.study", "compute the figures and tables of the thesis beside its own numbers"),
    "faults": ("atpid_control.commands.faults", "run the fault matrix through the graph, and make its page"),
    "figures": ("atpid_control.commands.figures", "make the figures of the documentation"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status (`atpid_common.cli.guarded`)."""
    return run_commands("atpid_control", "Control of the tuned particle impact damper.", COMMANDS, argv)
