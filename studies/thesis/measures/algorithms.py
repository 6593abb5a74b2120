# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search, adaptive runs, and the predictive control algorithm step by step."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from atpid_control.selection.map_cache import map_for
from atpid_control.selection.pca import PcaSelector
from atpid_control.selection.pca_models import ComplexModel, simplified
from atpid_control.selection.protocol import Excitation, Selection
from atpid_control.selection.search import Plan, SearchSelector
from atpid_control.views.report.stages import WINDOW, constant_intervals
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse
from atpid_sim.simulation.excitation import amplitude_at
from atpid_sim.simulation.quantities import efficiency, half_peak_to_peak
from atpid_sim.simulation.simulate import simulate
from studies.pure_loop import run_loop
from studies.seeds.measure import configured
from studies.theory.energy import natural_frequency
from studies.thesis.measured import Measured, curve
from studies.thesis.points import Job
from studies.thorough_search import thorough_best

#: Tolerance of the runs, as in the methods themselves.
_RTOL = 1e-5


def search(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the steps of the thesis's search on the simulated plant (section 4.2)."""
    amplitude = float(job.point["amplitude"])
    plan = Plan(
        float(options["step"]), float(options["dwell"]), 2.0 * job.scene.grain.radius, float(options["highest"])
    )
    chosen = SearchSelector(job.scene, plan).select(Excitation(amplitude))
    steps = [stage for stage in chosen.stages if stage.name != "result"]
    best = thorough_best(DamperResponse(job.scene, _RTOL), amplitude)
    numbers = np.arange(1.0, len(steps) + 1.0)
    return Measured(
        {
            "search_height": chosen.height,
            "search_steps": float(len(steps)),
            "search_last": "a larger amplitude" if steps[-1].note else "the end of the range",
            "best_height": best.height,
            "height_over_best": chosen.height / best.height,
            "reduction": 100.0 * chosen.efficiency,
        },
        {
            "heights": np.array([numbers, [stage.height for stage in steps]]),
            "amplitudes": np.array([numbers, [stage.amplitude for stage in steps]]),
        },
    )


def loop(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return every stage of a scene run through identifier, selector and ceiling (sections 4.3)."""
    del options
    scene = job.scene
    ran = run_loop(scene, configured(), map_for(scene))
    rate, beam = scene.sensors.laser.rate, ran.beam
    damper, rest = DamperResponse(scene, _RTOL), scene.static_deflection
    values: dict[str, float | str] = {}
    for number, (t0, t1) in enumerate(constant_intervals(scene, scene.duration), start=1):
        amplitude = half_peak_to_peak(beam[round((t1 - WINDOW) * rate) : round(t1 * rate)])
        closed = damper.closed_amplitude(amplitude_at(scene, t0))
        values |= {
            f"stage_height_{number}": ran.heights[int(np.searchsorted(ran.time, t1)) - 1],
            f"stage_amplitude_{number}": amplitude,
            f"stage_closed_{number}": closed,
            f"stage_reduction_{number}": 100.0 * efficiency(amplitude, closed),
        }
    time = np.arange(len(beam)) / rate
    excitation = np.array([amplitude_at(scene, t) for t in ran.time])
    return Measured(
        values,
        {
            "beam": curve(time, beam + rest, 4000),
            "height": np.array([ran.time, ran.heights]),
            "excitation": np.array([ran.time, excitation]),
        },
    )


def pca_steps(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the models of the algorithm one by one (Figs 4.14 to 4.34)."""
    del options
    scene, amplitude = job.scene, float(job.point["amplitude"])
    damper, system = DamperResponse(scene, _RTOL), system_of(scene)
    model = simplified(system, scene.frequency_hz, amplitude)
    first = model.first_height()
    t, back = model.first_return(first)
    impact = ComplexModel(damper, amplitude, t, back, first).next_floor_impact(4.0)
    closed = simulate(scene.with_(height=2.0 * scene.grain.radius), check=False)
    radius = scene.grain.radius
    values: dict[str, float | str] = {
        "f": scene.frequency_hz,
        "f0": natural_frequency(scene.beam.mass, scene.beam.stiffness),
        "a_pred": model.amplitude,
        "top_speed": model.top_speed,
        "first_height": first,
        "return_beam": back.beam,
        "return_grain": back.beam + radius,
        "return_beam_velocity": back.beam_velocity,
        "return_grain_velocity": back.grain_velocity,
        "best_height": thorough_best(damper, amplitude).height,
        "sm_agreement": damper.closed_amplitude(amplitude) / closed.amplitude,
        "first_motion": simulate(scene.with_(height=first), check=False).motion,
    }
    if impact is not None:
        values |= {
            "impact_beam": impact.beam,
            "impact_grain": impact.beam + radius,
            "impact_beam_velocity": impact.beam_velocity,
            "impact_grain_velocity": impact.grain_velocity,
            "second_height": model.next_height(impact),
        }
    chosen = PcaSelector(scene).select(Excitation(amplitude))
    return Measured(values | _selected(job, chosen), _tuning(chosen))


def pca(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the heights before and after tuning, and how far they are apart (Figs 4.35 to 4.46)."""
    del options
    chosen = PcaSelector(job.scene).select(Excitation(float(job.point["amplitude"])))
    return Measured(_selected(job, chosen))


def _selected(job: Job, chosen: Selection) -> dict[str, float | str]:
    before = next(stage.height for stage in chosen.stages if stage.name == "PCA")
    scene = job.scene.with_(height=before)
    return {
        "pca_height": before,
        "pca_motion": simulate(scene, check=False).motion,
        "tuned_height": chosen.height,
        "tunings": float(sum(stage.name.startswith("tuning") for stage in chosen.stages)),
        "pca_error": 100.0 * abs(before / chosen.height - 1.0),
        "reduction": 100.0 * chosen.efficiency,
    }


def _tuning(chosen: Selection) -> dict[str, Any]:
    tried = [stage for stage in chosen.stages if stage.name == "PCA" or stage.name.startswith("tuning")]
    numbers = np.arange(len(tried), dtype=float)
    finite = [stage.amplitude if math.isfinite(stage.amplitude) else 0.0 for stage in tried]
    return {
        "tuning_heights": np.array([numbers, [stage.height for stage in tried]]),
        "tuning_amplitudes": np.array([numbers, finite]),
    }
