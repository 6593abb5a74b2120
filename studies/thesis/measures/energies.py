# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Energies and works of a driven beam (Figs 3.18 to 3.22)."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import Trajectory
from atpid_sim.system import Array
from studies.theory.energy import (
    BeamMotion,
    Structure,
    balance_residual,
    contact_force,
    grain_energy,
    impact_span,
    summary_energy,
    work_of_excitation,
    work_on_grain,
)
from studies.theory.impacts import CEILING, FLOOR, visits
from studies.thesis.measured import Measured, curve
from studies.thesis.measures.motion import FINE, beam_of, soft, structure_of
from studies.thesis.points import Job

#: Before this time the damper is closed and the beam has settled [s].
_CLOSED = (4.0, 6.0)


def energies(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the beam's energy, its change in impacts, and the works of grain and excitation."""
    del options
    scene = job.scene
    trajectory = soft(scene, FINE)
    beam, motion = structure_of(scene), beam_of(trajectory)
    energy, onto, into = (f(beam, motion) for f in (summary_energy, work_on_grain, work_of_excitation))
    begin, end = scene.steady_window
    closed = (motion.time >= _CLOSED[0]) & (motion.time <= _CLOSED[1])
    steady = (motion.time >= begin) & (motion.time <= end)
    values: dict[str, float | str] = {
        "energy_closed": float(energy[closed].max()),
        "energy_open": float(energy[steady].max()),
        **_shares(scene, beam, motion.between(begin, end), trajectory.impacts),
        "work_on_grain": float(onto[-1]),
        **_works(scene, trajectory, onto, into),
        "residual": balance_residual(beam, motion),
    }
    late = motion.time >= end - 1.0
    return Measured(
        values,
        {
            "energy": curve(motion.time, energy, 4000),
            "energy_late": curve(motion.time[late], energy[late], 4000),
            "work_on_grain": curve(motion.time, onto),
            "work_late": curve(motion.time[late], onto[late] - onto[late][0], 4000),
            "work_excitation": curve(motion.time, into, 6000),
        },
    )


def _works(scene: Scene, motion: Trajectory, onto: Array, into: Array) -> dict[str, float]:
    """Return the works over the last whole periods of the steady window, and against the ledger of the engine."""
    samples = FINE / scene.frequency_hz
    begin, end = scene.steady_window
    periods = int((end - begin) * scene.frequency_hz)
    places = len(onto) - 1 - np.rint(samples * np.arange(periods, -1, -1)).astype(int)
    loss = _contact_loss(scene, float(motion.time[places[0]]), float(motion.time[-1]))
    work = float(onto[-1] - onto[places[0]])
    own = grain_energy(scene.grain_mass, scene.gravity, motion.time, motion.grain)
    gain = float(own[-1] - own[places[0]])
    swings = [np.ptp(into[left:right]) for left, right in pairwise(places)]
    return {
        "work_steady": work,
        "work_excitation": float(into[-1] - into[places[0]]),
        "work_swing": float(np.mean(swings)),
        "least_work": float(np.diff(onto[places]).min()),
        "loss_ratio": (work - gain) / loss,
    }


def _contact_loss(scene: Scene, begin: float, end: float) -> float:
    """Return what the contacts absorb between two times [J], by the engine's own ledger."""
    integration = Integration(scene.with_(duration=end, steady_window=[begin, end]), "soft")
    whole = integration.run().ledger.contact_loss
    before = Integration(scene.with_(duration=begin, steady_window=[0.0, begin]), "soft").run().ledger.contact_loss
    return whole - before


def _shares(scene: Scene, beam: Structure, motion: BeamMotion, impacts: Array) -> dict[str, float]:
    """Return the mean change of the beam's energy in first impacts on ceiling and floor, in % of its largest."""
    energy, force = summary_energy(beam, motion), contact_force(beam, motion)
    period = 1.0 / scene.frequency_hz
    longest = int(0.1 * period * FINE)
    found: dict[float, list[float]] = {FLOOR: [], CEILING: []}
    for visit in visits(impacts, period):
        start = int((visit.begin - motion.time[0]) * FINE)
        if 0 < start < len(energy) - longest:
            left, right = impact_span(force, start, longest)
            found[visit.wall].append(100.0 * (energy[right] - energy[left]) / energy.max())
    means = {wall: float(np.mean(shares)) if shares else 0.0 for wall, shares in found.items()}
    every = found[FLOOR] + found[CEILING]
    return {
        "lower_share": means[FLOOR],
        "upper_share": means[CEILING],
        "impact_share": float(np.mean(every)) if every else 0.0,
    }
