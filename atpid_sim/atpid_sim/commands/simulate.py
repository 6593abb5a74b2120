# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid simulate`: one scene, its result as a table or as JSON, its motion as a file or a picture."""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import atpid_sim
from atpid_common import output
from atpid_common.arguments import file_path, path_to, positive, real
from atpid_common.files import Document
from atpid_common.vocabulary import Drive
from atpid_sim.commands.options import add_accuracy
from atpid_sim.display import working
from atpid_sim.figure_style import drawn
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.excitation import amplitude_at, frequency_at
from atpid_sim.simulation.integration import amplitude_without_damper
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.simulation.simulate import Result, Trajectory, simulate, trajectory
from atpid_sim.simulation.unrepeated import vibration, write_spectrum

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from atpid_sim.periodic import SteadyState

_UNITS = {"followed": "s"} | {name: unit for name, (unit, _) in Result.labels.items()}
_DRIVEN = (
    "rms undamped_rms efficiency_rms bare_rms reduction_rms independent_samples support_rms support_acceleration_rms "
    "deflection undamped_deflection bare_deflection amplitude undamped_amplitude efficiency bare_amplitude reduction "
    "reproducible spread motion impacts resonance fidelity left_out error_estimate energy_residual steps wall_s result"
)
#: The amplitude in a window of a decay depends on the window: the decrement is what it is measured by.
_DECAY = (
    "decrement undamped_decrement decrement_error impacts resonance fidelity left_out energy_residual steps wall_s "
    "result"
)
#: Samples of a series at most: 80 MB a column.
_MOST_SAMPLES = 10_000_000
#: How many periods of the grain's motion the picture shows.
_PERIODS = 4.0
#: Arguments of the example in the help.
EXAMPLE = "scenes/standard.yaml --height 0.15"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="everything the run needs (docs/scenes.md)")
    add_accuracy(parser)
    help_height = "a fixed ceiling at H [m] in place of the scene's"
    parser.add_argument("--height", type=positive("m"), metavar="H", help=help_height)
    help_steady = "solve for the steady motion the run would end in, where it ends in one, with its multipliers"
    parser.add_argument("--steady", action="store_true", help=help_steady)
    help_kick = "with --steady: the share of kicks of V [m/s] after which that motion comes back, as `atpid basin` does"
    parser.add_argument("--kick", type=real(0.0, 1e3, "m/s", above=True), metavar="V", help=help_kick)
    help_series = "write the motion here: .csv, or .npz with impacts"
    parser.add_argument("--series", type=path_to(".csv", ".npz"), metavar="FILE", help=help_series)
    help_rate = "of --series; default: the scene's laser, or 1000 Hz"
    parser.add_argument("--rate", type=real(1e-3, 1e7, "Hz"), metavar="HZ", help=help_rate)
    help_picture = "draw beam, ceiling and grain here"
    parser.add_argument("--picture", type=path_to(".png"), metavar="FILE.png", help=help_picture)
    help_spectrum = "write power spectral densities of the beam here, of a drive that does not repeat itself"
    parser.add_argument("--spectrum", type=path_to(".csv"), metavar="FILE.csv", help=help_spectrum)
    output.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Run the scene and print its result; return 0. Raises SceneError, OutputError, NumericalFailure."""
    scene = load_scene(args.scene)
    if args.height is not None:
        scene = scene.with_(height=args.height)
    if scene.injected:
        print("faults: left out, a single run has neither sensors nor a motor; the bench injects them", file=sys.stderr)
    _check_files(args, scene)
    if args.steady and _show_steady(args, scene):
        return 0
    with working("simulating (the first time the kernels are compiled, a minute or two)"):
        try:
            result = simulate(scene, args.fidelity, args.rtol)
        except NumericalFailure as error:
            raise NumericalFailure(f"{error}{scene.hint()}") from None
        _write_files(args, scene)
    if args.json:
        print(json.dumps(result.to_json(), allow_nan=False))
    else:
        _show(str(args.scene), scene, result)
    return 0


def _show_steady(args: argparse.Namespace, scene: Scene) -> bool:
    """Print the steady motion and return True; where there is none, print why to standard error and return False."""
    if any(given is not None for given in (args.series, args.picture, args.spectrum)):
        raise output.OutputError(
            "--steady: given with --series, --picture or --spectrum; these need the run itself, leave it out"
        )
    from atpid_sim.periodic import steady_state

    with working("solving (the first time the kernels are compiled, a minute or two)"):
        search = steady_state(scene, args.fidelity, args.rtol)
    if search.state is None:
        print(f"steady: {search.ending.value}", file=sys.stderr)
        return False
    values = _steady_values(scene, search.state) | {"result": search.ending.value}
    kicked = None if args.kick is None else atpid_sim.kicked(scene, args.kick, args.fidelity)
    if kicked is not None and args.json:
        values["kicked"] = asdict(kicked)
    if args.json:
        print(json.dumps(output.finite(values), allow_nan=False))
        return True
    _print_table(str(args.scene), {key: _text(key, value) for key, value in values.items()})
    if kicked is not None:
        print(kicked.sentence(args.kick))
    return True


def _steady_values(scene: Scene, state: "SteadyState") -> Document:
    end = scene.steady_window[1]  # settled, as the motion is
    undamped = scene.linear_amplitude(amplitude_at(scene, end), frequency_at(scene, end), grain=True)
    bare = amplitude_without_damper(scene)
    return {
        "amplitude": state.amplitude,
        "undamped_amplitude": undamped,
        "efficiency": efficiency(state.amplitude, undamped),
        "bare_amplitude": bare,
        "reduction": efficiency(state.amplitude, bare),
        "periods": state.periods,
        "multipliers": [float(abs(each)) for each in state.multipliers],
        "stability_margin": state.stability_margin,
        "settling_periods": state.settling_periods,
        "impacts": len(state.impacts),
        "followed": state.followed,
        "fidelity": state.fidelity,
        "method": state.method.value,
        "error_estimate": state.error_estimate,
    }


def _check_files(args: argparse.Namespace, scene: Scene) -> None:
    if args.kick is not None and not args.steady:
        raise output.OutputError(f"--kick: given {args.kick:g} without --steady, whose motion is kicked; give both")
    if args.kick is not None and not hasattr(atpid_sim, "kicked"):
        missing = "which is not installed: colcon build --packages-select atpid_dynamics, or `make setup`"
        raise output.OutputError(f"--kick: comes with the package atpid_dynamics, {missing}")
    if args.series is None and args.rate is not None:
        raise output.OutputError(f"--rate: given {args.rate:g} without --series, whose rate it is; give both")
    if args.series is not None and scene.duration * (args.rate or scene.sensors.laser.rate) > _MOST_SAMPLES:
        raise output.OutputError(f"--rate: more than {_MOST_SAMPLES} samples in {scene.duration:g} s; give a lower one")
    if args.spectrum is not None and not scene.excitation.is_stationary:
        given = f"given for an excitation of kind {scene.excitation.kind}"
        raise output.OutputError(f"--spectrum: {given}; allowed: tones, random, series; leave it out")
    for option in ("series", "picture", "spectrum"):
        if getattr(args, option) is not None:
            output.file(getattr(args, option), f"--{option}", replace=args.force)


def _write_files(args: argparse.Namespace, scene: Scene) -> None:
    if args.series is not None:
        found = trajectory(scene, args.rate or scene.sensors.laser.rate, args.fidelity, args.rtol)
        _write_series(found, args.series, scene.driven_by)
    if args.picture is not None:
        rate, closed = 100.0 * scene.frequency_hz, scene.with_(height=2.0 * scene.grain.radius)
        beside = trajectory(closed, rate, "simplified", args.rtol)
        _draw(scene, trajectory(scene, rate, args.fidelity, args.rtol), beside, args.picture)
    if args.spectrum is not None:
        write_spectrum(vibration(scene, args.fidelity, args.rtol), args.spectrum, scene.driven_by)


def _print_table(title: str, rows: Mapping[str, str]) -> "Console":
    """Print a table of names, texts and units; return where it was printed."""
    from rich.console import Console  # here, as it is not needed with --json
    from rich.table import Table

    table = Table(title=title, show_header=False)
    for key, text in rows.items():
        table.add_row(key, text, _UNITS.get(key, ""))
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print(table)
    return console


def _show(name: str, scene: Scene, result: Result) -> None:
    values, keys = result.to_json(), _DECAY if scene.excitation.is_free else _DRIVEN
    rows = {key: _shown(key, values) for key in keys.split() if values[key] not in (None, [])}
    console = _print_table(name, rows)
    if result.spread is not None and result.undamped_amplitude > 0.0:
        least, most = (100.0 * efficiency(result.spread[k], result.undamped_amplitude) for k in (2, 0))
        console.print(f"not reproducible: single runs give an efficiency of {least:.0f} to {most:.0f} %")
    for line in result.warnings:
        console.print(f"warning: {line}")
    for line in scene.decisive_defaults():
        console.print(f"default: {line}")


def _shown(key: str, values: Document) -> str:
    """Return the text of a key; whether a run is reproducible with the change of the drive that this holds for."""
    change = values["reproducible_for"] if key == "reproducible" else None
    suffix = "" if change is None else f", under changes of the drive up to {change:.1g} of it"
    error = values[f"{key}_error"] if key in ("rms", "efficiency_rms", "reduction_rms") else None
    return _text(key, values[key]) + (suffix if error is None else f" ± {error:.2g}")


def _text(key: str, value: object) -> str:
    if isinstance(value, list) and key == "spread":
        least, median, largest = value
        return f"{least:.4g} to {largest:.4g}, median {median:.4g}"
    if isinstance(value, list):
        return ", ".join(f"{each:.6g}" for each in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _write_series(motion: Trajectory, path: Path, drive: Drive) -> None:
    """Write the series (n,), SI, of what `drive` drives, as CSV with a header line or, with the impacts (k, 3), as NPZ.

    Raises OutputError.
    """
    # by the names that `excitation.series` and `calibrate beam` read
    columns: dict[str, Any] = {
        "time": motion.time,
        drive.channel: motion.support,
        "beam_displacement": motion.beam,
        "beam_velocity": motion.beam_velocity,
        "beam_acceleration": motion.beam_acceleration,
        "grain_displacement": motion.grain,
        "ceiling_height": motion.ceiling,
    }
    with output.writing(path, "--series"):
        if path.suffix.lower() == ".npz":
            with path.open("wb") as file:
                np.savez(file, impacts=motion.impacts, **columns)
        else:
            table = np.column_stack(list(columns.values()))
            np.savetxt(path, table, fmt="%.10g", delimiter=",", header=",".join(columns), comments="")


def _draw(scene: Scene, motion: Trajectory, closed: Trajectory, path: Path) -> None:
    """Draw beam, ceiling and the grain's last periods; `closed`: the same beam, damper closed. Raises OutputError."""
    with drawn(path, "--picture", nrows=3, figsize=(10.0, 9.0), height_ratios=(3.0, 1.2, 2.2)) as (_, axes):
        _beam(axes[0], scene, motion, closed)
        axes[1].plot(motion.time, 1e3 * motion.ceiling, "C0", linewidth=1.4)
        axes[1].set(xlim=(0.0, scene.duration), ylim=(0.0, None))
        axes[1].set(ylabel="mm", xlabel="time [s]", title="Ceiling height")
        _grain(axes[2], scene, motion)


def _beam(axes: "Axes", scene: Scene, motion: Trajectory, closed: Trajectory) -> None:
    rest = scene.static_deflection
    axes.plot(closed.time, 1e3 * (closed.beam + rest), "0.7", linewidth=0.7, label="damper closed")
    axes.plot(motion.time, 1e3 * (motion.beam + rest), "C0", linewidth=0.8, label="this scene")
    axes.axvspan(*scene.steady_window, color="0.93", zorder=0, label="steady window")
    axes.set(xlim=(0.0, scene.duration), ylabel="mm", title="Beam displacement from rest")
    axes.legend(fontsize=8, loc="upper right")


def _grain(axes: "Axes", scene: Scene, motion: Trajectory) -> None:
    shown = motion.time >= motion.time[-1] - _PERIODS / scene.frequency_hz
    time = motion.time[shown]
    floor, grain = (1e3 * (one[shown] + scene.static_deflection) for one in (motion.beam, motion.grain))
    ceiling = floor + 1e3 * (motion.ceiling[shown] - 2.0 * scene.grain.radius)
    axes.plot(time, floor, "0.4", linewidth=1.2, label="floor")
    axes.plot(time, ceiling, "0.4", linewidth=1.2, linestyle="--", label="ceiling")
    axes.plot(time, grain, "C0", linewidth=1.8, label="grain")
    axes.set(xlim=(time[0], time[-1]), xlabel="time [s]", ylabel="mm", title="The grain between floor and ceiling")
    axes.legend(fontsize=8, loc="upper right")
