# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid calibrate contact`: a drop test or a run in, restitution, modulus and the scene's `contact:` block out."""

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
from atpid_control.runs.run import BEAM, Run, open_run
from atpid_control.runs.signal import Signal
from atpid_lab.contact.drop import DURATION, IMPACT, ContactFit, fit_drop, impacts_of, read_impacts
from atpid_lab.contact.estimate import ContactError, ContactEstimate
from atpid_lab.contact.in_run import fit_part

EXAMPLE = "drop.csv --mass 0.0202 --radius 0.0085 --out contact.yaml"
#: Channels in which a contact is a pulse, in the order they are looked for.
_PULSES = ("force", "acceleration", "beam_acceleration")
#: Poisson's ratio of the block: its modulus is such that the effective one is what was measured.
_POISSON = 0.3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add(
        "recording",
        type=file_path,
        help=f"a ball that bounces on a fixed wall: a .csv of {IMPACT} [s], with {DURATION} [s] and drop where known; "
        "or its force or acceleration, a .csv with time [s] or a bag; or the bag of a run of the damper",
    )
    add("--mass", type=positive("kg"), metavar="KG", help="the ball's mass [kg]; for the modulus of a drop")
    add("--radius", type=positive("m"), metavar="M", help="its radius [m]; for the modulus of a drop")
    add("--gravity", type=positive("m/s^2"), default=9.81, metavar="G", help="gravity of a drop [m/s^2]; default: 9.81")
    height = "standard deviation of the ceiling's height in a run [m]; default: 1e-4"
    add("--height-std", type=real(1e-9, 1.0, "m"), default=1e-4, metavar="M", help=height)
    add_part(parser, "begin of the part used of a run")
    add("--channel", type=word, help=f"the channel of a drop's force or acceleration; default: {', '.join(_PULSES)}")
    add_block(parser, "the contact: block")


def run(args: argparse.Namespace) -> int:
    """Calibrate and print; raise ContactError for bad input."""
    if (args.mass is None) != (args.radius is None):
        raise ContactError("--mass and --radius: given one; allowed: both or none")
    if args.out is not None:
        output.file(args.out, replace=args.force)
    path = bag_of(args.recording)
    fit = _fitted(path, args)
    return give_block(args, to_yaml(fit), _plain(fit), _text(fit))


def _fitted(path: Path, args: argparse.Namespace) -> ContactFit:
    """Return what a table of impacts, a run of the damper or a drop's force determines."""
    if _is_table(path):
        return fit_drop(read_impacts(path), args.gravity, args.mass, args.radius)
    recorded = open_run(path)
    if args.channel is None and recorded.scene is not None and BEAM in _channels(recorded):
        signals, missing = signals_of(recorded)
        print_missing(missing, sys.stderr)
        return fit_part(recorded, signals.between(args.begin, args.end), args.height_std)
    return fit_drop(impacts_of(_pulses(recorded, args.channel)), args.gravity, args.mass, args.radius)


def _is_table(path: Path) -> bool:
    """Whether a file is a table of impacts, by its header; what cannot be read is left to its reader."""
    if path.suffix.lower() != ".csv":
        return False
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        return IMPACT in lines.readline(10_000)


def _channels(recorded: Run) -> set[str]:
    return {column.name for table, _ in recorded.streams() for column in table.values}


def _pulses(recorded: Run, channel: str | None) -> Signal:
    """Return the recorded force or acceleration. Raises BagError: no such channel; ContactError: none at all."""
    if channel is not None:
        return recorded.signal(channel)
    present = _channels(recorded)
    for name in _PULSES:
        if name in present:
            return recorded.signal(name)
    raise ContactError(
        f"{recorded.path}: channels {', '.join(sorted(present)) or 'none'}; needed: of a drop one of "
        f"{', '.join(_PULSES)} in which each contact has 8 samples, or a table of {IMPACT}; of a run of the damper a "
        f"bag with its scene ({recorded.scene_problem or 'there is one'}) and the laser's channels"
    )


def to_yaml(fit: ContactFit) -> str:
    """Return a scene's `contact:` block; error bars are in comments, since a scene has values only."""
    e = fit.restitution
    speeds = f"{fit.speeds[0]:.3g} to {fit.speeds[1]:.3g} m/s, mean {fit.at_speed:.3g} m/s"
    lines = [f"# restitution {_shown(e)}, at {speeds}"]
    if fit.modulus is None:
        return "\n".join([*lines, f"contact: {{law: impact, restitution: {min(e.value, 1.0):.5f}}}", ""])
    modulus = f"{2.0 * (1.0 - _POISSON**2) * fit.modulus.value:.5e}"
    values = f"young_modulus: {modulus}, poisson_ratio: {_POISSON}, damping_ratio: {fit.damping_ratio:.5f}"
    found = f"effective modulus {_shown(fit.modulus)} Pa"
    lines.append(f"# {found}; only it counts, not how it is shared by grain and wall")
    return "\n".join([*lines, f"contact: {{law: tsuji, {values}}}", ""])


def _plain(fit: ContactFit) -> Document:
    found: Document = asdict(fit)
    for name in ("restitution", "contact_time", "modulus"):
        value: ContactEstimate | None = getattr(fit, name)
        found[name] = None if value is None else value._asdict()
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in found.items()}


def _text(fit: ContactFit) -> str:
    lines = [f"# {fit.restitution.number} impacts or flights; intervals are of 95 %"]
    if fit.contact_time is not None:
        lines.append(f"# contact time at {fit.at_speed:.3g} m/s {_shown(fit.contact_time)} s")
    return "\n".join([*lines, *(f"# not determined: {line}" for line in fit.missing), to_yaml(fit).rstrip()])


def _shown(one: ContactEstimate) -> str:
    return f"{one.value:.5g} ({one.low:.5g} to {one.high:.5g})"
