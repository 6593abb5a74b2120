# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measures of motions that do not repeat themselves: root mean square with its error, spectrum, peak after a shock."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from atpid_common.output import writing
from atpid_common.vocabulary import Drive
from atpid_sim.engine import columns
from atpid_sim.scene import Scene
from atpid_sim.scene.excitation import RandomExcitation
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import Integration, Observation, drive_table, sample_series
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.simulation.signals import root_mean_squares
from atpid_sim.system import Array

#: Samples a period of the resonance, and of the highest frequency of a random drive; samples at most.
_A_PERIOD, _A_PERIOD_OF_DRIVE, _MOST = 64, 2.5, 2_000_000
#: Lags in correlation times over which an autocorrelation is summed (Sokal, "Monte Carlo methods", 1997, section 3).
_LAGS = 6.0
#: Independent samples below which an error bar is a guess.
_FEW = 20.0
#: Parts of the steady window of which a spectrum is the mean; they overlap by half.
_PARTS = 8


class Vibration(NamedTuple):
    """Motions in the steady window at the same instants, (n,) [m]."""

    period: float  # between samples [s]
    support: Array  # of a force [N]
    beam: Array
    closed: Array  # the beam with the damper closed
    bare: Array  # the structure as it is without the damper


def observation_of(scene: Scene) -> Observation:
    """Return what is recorded of a run: the steady window, finer than the resonance and a random drive need."""
    begin, end = scene.steady_window
    rate = _A_PERIOD * scene.frequency_hz
    if isinstance(scene.excitation, RandomExcitation):
        rate = max(rate, _A_PERIOD_OF_DRIVE * scene.excitation.random.psd[-1][0])
    period = max(1.0 / rate, (end - begin) / _MOST)
    return Observation((begin, end), begin, period, sample_series(int((end - begin) / period)))


def vibration(scene: Scene, fidelity: str = "auto", rtol: float | None = None) -> Vibration:
    """Run a scene; see `simulate`. Raises NumericalFailure and SceneError as that does."""
    table = drive_table(scene, scene.steady_window)
    run = Integration(scene, choose(scene, fidelity).fidelity, rtol, table=table)
    return beside(scene, table, run.run(observation_of(scene)).samples)


def beside(scene: Scene, table: Array, samples: Array) -> Vibration:
    """Return the motions of a run (SAMPLE_ROWS, n), of the closed damper and of the structure without it."""
    closed, bare = linear_motions(scene, table)
    count = min(len(closed), len(bare), samples.shape[1])
    support, beam = samples[columns.S_SUPPORT, :count], samples[columns.S_BEAM, :count]
    return Vibration(observation_of(scene).period, support, beam, closed[:count], bare[:count])


def linear_motions(scene: Scene, table: Array) -> tuple[Array, Array]:
    """Return the container with the damper closed and without it, (n,) each [m], under the drive of a table."""
    without = scene.with_(gravity=0.0, initial=None)
    closed, bare = (
        Integration(one, "simplified", mass=mass, table=table).run(observation_of(scene)).samples[columns.S_BEAM]
        for one, mass in ((scene, scene.total_mass), (without, scene.beam.mass))
    )
    return closed, bare


def measures_of(scene: Scene, table: Array, samples: Array) -> dict[str, float]:
    """Return what the motion of a run (SAMPLE_ROWS, n) is measured by, by the names of `simulate.Result`.

    After a shock that is the largest deflection from rest, else root mean squares about the mean. Standard errors are
    those of a window of finite length: of mean squares over each period of the resonance, with their autocorrelation;
    of a ratio from the differences of both runs' mean squares, since both have the same drive.
    """
    motion = beside(scene, table, samples)
    if scene.excitation.kind == "shock":
        rest = scene.static_deflection
        beam, closed, bare = motion.beam + rest, motion.closed + rest, motion.bare
        deflections = (float(np.abs(one - motion.support).max()) for one in (beam, closed, bare))
        return dict(zip(("deflection", "undamped_deflection", "bare_deflection"), deflections, strict=True))
    length = max(1, round(1.0 / (scene.natural_frequency_hz * motion.period)))
    squares, closed, bare = (mean_squares(one, length) for one in (motion.beam, motion.closed, motion.bare))
    rms, undamped, without = (math.sqrt(np.mean(each)) for each in (squares, closed, bare))
    error, independent = mean_error(squares)
    support, acceleration = root_mean_squares(table, *scene.steady_window)
    return {
        "rms": rms,
        "rms_error": 0.5 * error / max(rms, 1e-300),
        "undamped_rms": undamped,
        "efficiency_rms": efficiency(rms, undamped),
        "efficiency_rms_error": ratio_error(squares, closed),
        "bare_rms": without,
        "reduction_rms": efficiency(rms, without),
        "reduction_rms_error": ratio_error(squares, bare),
        "independent_samples": independent,
        "support_rms": support,
        "support_acceleration_rms": acceleration,
    }


def few_samples(measures: dict[str, float]) -> list[str]:
    """Return a warning where the window is too short for an error bar; else nothing."""
    found = measures.get("independent_samples", math.inf)
    usual = f"(usual: at least {_FEW:g}): error bars are a guess; lengthen it"
    return [f"the steady window holds {found:.2g} independent samples of the mean square {usual}"] * (found < _FEW)


def write_spectrum(motion: Vibration, path: Path, drive: Drive) -> None:
    """Write one-sided power spectral densities [m^2/Hz, of a force N^2/Hz] as CSV with a header. Raises OutputError."""
    from scipy.signal import welch

    names = (drive.channel, "beam_displacement", "beam_damper_closed", "beam_without_damper")
    series = (motion.support, motion.beam, motion.closed, motion.bare)
    length = max(8, 2 * len(motion.beam) // (_PARTS + 1))
    with writing(path, "--spectrum"):
        found = [welch(one, 1.0 / motion.period, nperseg=min(length, len(one))) for one in series]
        table = np.column_stack([found[0][0], *(density for _, density in found)])
        np.savetxt(path, table, fmt="%.10g", delimiter=",", header=",".join(("frequency", *names)), comments="")


def mean_error(values: Array) -> tuple[float, float]:
    """Return the standard error of the mean of correlated values (n,), and how many independent ones they are worth.

    NaN and 0 where the values are correlated over their whole length.
    """
    from scipy.signal import correlate

    count, off = len(values), values - np.mean(values)
    if count < 4:
        return math.nan, 0.0
    covariance = correlate(off, off, method="fft")[count - 1 :] / count
    if not covariance[0] > 0.0:
        return 0.0, float(count)
    times = 0.5 + np.cumsum(covariance[1:] / covariance[0])
    settled = np.flatnonzero(np.arange(1, count) >= _LAGS * times)
    # correlation adds; alternation is not taken to take away
    time = max(0.5, float(times[settled[0]])) if len(settled) else math.inf
    independent = count / (2.0 * time)
    if independent <= 2.0:
        return math.nan, 0.0
    return math.sqrt(covariance[0] / (independent - 1.0)), independent


def mean_squares(displacement: Array, length: int) -> Array:
    """Return mean squares (k,) [m^2] about the mean of (n,) [m] over pieces of `length` samples."""
    count = max(1, len(displacement) // length)
    kept = displacement[: count * length]
    squares: Array = np.mean((kept - np.mean(kept)).reshape(count, -1) ** 2, axis=1)
    return squares


def ratio_error(squares: Array, reference: Array) -> float:
    """Return the standard error of the ratio of two root mean squares, of mean squares (k,) of the same pieces [-]."""
    mean, other = float(np.mean(squares)), float(np.mean(reference))
    if not min(mean, other) > 0.0:
        return math.nan
    return 0.5 * math.sqrt(mean / other) * mean_error(squares / mean - reference / other)[0]
