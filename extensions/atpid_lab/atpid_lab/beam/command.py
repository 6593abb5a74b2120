# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid calibrate beam`: a recording in, the scene's `beam:` block out."""

import argparse
import math
import sys
from dataclasses import asdict
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import file_path, positive, real, word
from atpid_common.files import Document
from atpid_control.analysis.signals import signals_of
from atpid_control.commands.results import add_block, add_part, give_block, print_missing
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import BEAM, SUPPORT, open_run
from atpid_lab.beam.fit import BeamCalibrationError, BeamFit, BeamParameters, fit_beam, from_added_mass, from_known_mass

EXAMPLE = "decay.csv --moving-mass 0.9 --grain-mass 0.08 --out beam.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    free = "a decay or sweep with the damper closed or empty: a bag, of one that is cut off what is there, or a .csv"
    add("recording", type=file_path, help=free)
    moving = "the moving mass: reduced beam mass, container, grain [kg]"
    add("--moving-mass", type=positive("kg"), metavar="KG", help=moving)
    add("--moving-mass-std", type=real(0.0, 1e9, "kg"), default=0.0, metavar="KG", help="its standard deviation [kg]")
    grain = "the grain's part of it; a scene's beam is without [kg]"
    add("--grain-mass", type=real(0.0, 1e9, "kg"), default=0.0, metavar="KG", help=grain)
    add("--added-mass", type=positive("kg"), metavar="KG", help="mass added to the beam for the second recording [kg]")
    add("--with-added", type=file_path, metavar="RECORDING", help="the second recording")
    add_part(parser, "begin of the part used")
    add("--support-channel", type=word, default=SUPPORT, help="name of the support's channel")
    add("--beam-channel", type=word, default=BEAM, help="name of the beam's channel")
    add_block(parser, "the beam: block")


def run(args: argparse.Namespace) -> int:
    """Calibrate and print; raise CalibrationError for bad input."""
    if (args.added_mass is None) != (args.with_added is None):
        raise BeamCalibrationError("--added-mass and --with-added: given one; allowed: both or none")
    if args.added_mass is not None and args.moving_mass is not None:
        raise BeamCalibrationError("--moving-mass and --added-mass: given both; allowed: one of them")
    recording = bag_of(args.recording)
    args.with_added = None if args.with_added is None else bag_of(args.with_added)
    if args.out is not None:
        output.file(args.out, replace=args.force)
    fit = _fitted(recording, args)
    parameters = None
    if args.with_added is not None:
        parameters = from_added_mass(fit, _fitted(args.with_added, args), args.added_mass, args.grain_mass)
    elif args.moving_mass is not None:
        parameters = from_known_mass(fit, args.moving_mass, args.moving_mass_std, args.grain_mass)
    elif args.out is not None:
        raise BeamCalibrationError(
            "--out: a beam: block needs a mass, and a recording determines k/m and c/m only; give --moving-mass, "
            "or --added-mass with --with-added"
        )
    block = "" if parameters is None else parameters.to_yaml()
    return give_block(args, block, _plain(fit, parameters), _text(fit, block))


def _fitted(path: Path, args: argparse.Namespace) -> BeamFit:
    signals, missing = signals_of(open_run(path), args.support_channel, args.beam_channel, both=False)
    print_missing(missing, sys.stderr)
    return fit_beam(signals.between(args.begin, args.end))


def _plain(fit: BeamFit, parameters: BeamParameters | None) -> Document:
    stiffness_std, damping_std = (math.sqrt(fit.covariance[i, i]) for i in (0, 1))
    found: Document = {"stiffness_over_mass": fit.stiffness, "stiffness_over_mass_std": stiffness_std}
    found |= {"damping_over_mass": fit.damping, "damping_over_mass_std": damping_std}
    same = "frequency", "damping_ratio", "residual", "samples", "driven", "origin"
    found |= {name: getattr(fit, name) for name in same}
    return found | {"beam": None if parameters is None else asdict(parameters)}


def _text(fit: BeamFit, block: str) -> str:
    found = _plain(fit, None)
    lines = [
        f"# {'driven' if fit.driven else 'free'} motion, {fit.samples} samples, residual {fit.residual:.3g} m",
        f"# k/m = {fit.stiffness:.7g} +- {found['stiffness_over_mass_std']:.2g} 1/s^2, "
        f"c/m = {fit.damping:.5g} +- {found['damping_over_mass_std']:.2g} 1/s",
        *([f"# origin of the samples: {fit.origin}"] if fit.origin else []),
        f"# natural frequency {fit.frequency:.5f} Hz, damping ratio {fit.damping_ratio:.5f}",
    ]
    needed = "a known mass: --moving-mass or --added-mass"
    return "\n".join([*lines, block.rstrip() or f"# stiffness, damping and mass cannot be separated without {needed}"])
