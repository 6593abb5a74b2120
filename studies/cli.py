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
        "off-resonance": ("studies.off_resonance.command", "selection off resonance against brute force"),
        "random-selection": ("studies.random_selection", "`direct` and its margin on random systems, and brute force"),
        "seeds": ("studies.seeds.command", "scenes through the loop with many noises, without the node graph"),
        "atlas": ("studies.atlas.command", "types of motion, best heights, their stability and the cliff"),
        "designs": ("studies.designs", "promises of designs against an integration of its own"),
        "planar": ("studies.planar.command", "friction on a side wall and the slope of the tip, in the plane"),
        "selection-speed": ("studies.selection_speed", "how fast `direct` is and how good, on systems held out"),
    },
    "The arithmetic": {
        "tradeoff": ("studies.tradeoff.command", "speed against accuracy on one scene: table and picture"),
        "tradeoff-page": ("studies.tradeoff.page", "the page of three such tables"),
        "sweep": ("studies.sweep.command", "simulate the standard task at many heights and time it"),
        "modes": ("studies.modal", "structures of several modes against scipy, and what a mode costs"),
        "peace01": ("studies.peace01", "NLvib's benchmark PEACE01 by the return map, beside harmonic balance"),
        "steady": ("studies.steady.command", "what `simulate --steady` finds, beside long runs of random systems"),
        "extremes": ("studies.extremes.command", "outcomes of random systems far outside the usual range"),
        "rebound": ("studies.rebound_fit", "print the coefficients of the rebound's series"),
    },
    "The stand": {
        "identification": ("studies.identification.command", "how often the identifier's error bars hold the truth"),
        "time-base": ("studies.time_base", "clocks of two devices, sweeps and accelerations against their error bars"),
        "faults": ("studies.fault_matrix.command", "run the fault matrix through the graph, and make its page"),
        "soak": ("studies.soak.command", "run the bench for hours: what grows, what is lost, which rule is broken"),
        "stops": ("studies.stops", "times from a stop to the motor off, on lines that delay, lose and garble"),
        "stop-chain": ("studies.stop_chain", "times from each way to stop to the motor off, over the emulated stand"),
        "exciter-stops": ("studies.exciter_stops", "times from each way to stop to the exciter's output off"),
        "campaign": (
            "studies.campaign",
            "an unattended campaign on the emulated stand, with faults and kills",
        ),
        "load": ("studies.load.command", "stream both devices at full rate through ROS 2, count what is lost"),
        "fuzz": ("studies.firmware.fuzz", "corrupted, truncated and duplicated frames to the firmware"),
        "storm": ("studies.firmware.storm", "random whole requests to the firmware"),
    },
    "Pictures and pages": {
        "figures": ("studies.figures.command", "make the pictures of README and docs"),
        "parameters": ("studies.parameters", "make the page of the parameters and the parameter files"),
    },
}

#: Runs one study, by default that of the process's arguments; returns its exit status (`run_commands`).
main = partial(run_commands, "python -m studies", "What measures the project; not installed.", COMMANDS)
