# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outside references: systems with a closed form, computed by the same engine."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import Integration, Observation, impact_log, sample_series
from studies.theory.closed_forms import bouncing_time, hertz_impact, thornton_gamma
from studies.theory.impact_sink import ImpactSink
from studies.theory.two_impacts import TwoImpacts, symmetric_motions
from studies.thesis.measured import Measured
from studies.thesis.measures.shaking import shaking_table
from studies.thesis.points import Job

#: Tolerance of these runs.
_RTOL = 1e-12

#: The heaviest beam a scene takes [kg], as a wall.
_WALL = 1e6
#: Mass of the wall over that of a light grain: a scene takes no smaller share of grain than 1e-6.
_HEAVIER = 1e5
#: Mass of a wall held by a spring [kg].
_STIFF_WALL = 1e3

#: Samples a cycle, of which the fundamental is taken.
_A_CYCLE = 64
#: Samples of a contact, from which its deepest overlap is read by a parabola.
_SAMPLES = 20_000


def reference(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return what the case of a point gives, simulated, and in closed form with the prefix `closed_`."""
    case = dict(options[str(job.point["case"])])
    return Measured(_KINDS[case.pop("kind")](**case))


def two_impacts(
    mass_ratio: float, restitution: float, clearance: float, damping_ratio: float = 0.01, periods: int = 400
) -> dict[str, float | str]:
    """Return peak and stability of two impacts a cycle (Masri and Caughey 1966), begun at rest on the floor.

    The support moves with amplitude A = 1, so the force on the primary mass is larger than 1 by its damper's share.
    """
    force = math.hypot(1.0, 2.0 * damping_ratio)
    system = TwoImpacts(mass_ratio, restitution, clearance / force, damping_ratio)
    stable = [motion for motion in symmetric_motions(system) if motion.multiplier < 1.0]
    duration = 2.0 * math.pi * periods
    scene = standard_bench(
        beam={"mass": 1.0, "stiffness": 1.0, "damping": 2.0 * damping_ratio},
        grain={"mass_fraction": mass_ratio / (1.0 + mass_ratio), "radius": 0.5},
        contact={"law": "impact", "restitution": restitution},
        excitation={"amplitude": 1.0, "frequency": 0.5 / math.pi}, ceiling={"height": 1.0 + clearance}, gravity=0.0,
        duration=duration, steady_window=[duration - 40.0 * math.pi, duration],
    )  # fmt: skip
    run = Integration(scene, "impact", _RTOL)
    return {
        "peak": run.run(Observation(scene.steady_window)).last.amplitude,
        "closed_peak": force * stable[0].peak if stable else math.nan,
        "multiplier": stable[0].multiplier if stable else math.nan,
    }


def impact_sink(
    mass_share: float, damping_ratio: float, restitution: float, clearance: float, frequency_ratio: float,
    periods: int = 3000,
) -> dict[str, float | str]:  # fmt: skip
    """Return the amplitude of an oscillator with a vibro-impact sink under a force, over half the sink's clearance.

    The grain begins in the middle. clearance: half of it, over the resonance's amplitude with the grain held.
    """
    sink = ImpactSink(mass_share, damping_ratio, restitution)
    cycle = 2.0 * math.pi / frequency_ratio
    scene = standard_bench(
        beam={"mass": 1.0 - mass_share, "stiffness": 1.0, "damping": 2.0 * damping_ratio},
        grain={"mass_fraction": mass_share, "radius": 0.5}, contact={"law": "impact", "restitution": restitution},
        drive="force", excitation={"amplitude": 2.0 * damping_ratio / clearance, "frequency": 1.0 / cycle},
        ceiling={"height": 3.0}, gravity=0.0, initial={"grain_height": 1.0, "grain_velocity": 0.0},
        duration=periods * cycle, steady_window=[(periods - 20) * cycle, periods * cycle],
    )  # fmt: skip
    samples = sample_series(20 * _A_CYCLE)
    seen = Observation(scene.steady_window, scene.steady_window[0], cycle / _A_CYCLE, samples)
    beam = Integration(scene, "impact", _RTOL).run(seen).samples[columns.S_BEAM]
    turn = np.exp(-2j * math.pi * np.arange(len(beam)) / _A_CYCLE)
    found = sink.amplitudes(clearance, frequency_ratio)
    return {"over_gap": float(2.0 * abs(np.mean(beam * turn))), "closed_over_gap": found[0] if found else math.nan}


def hertz(radius: float, modulus: float, poisson: float, density: float, speed: float) -> dict[str, float | str]:
    """Return force, overlap and duration of an elastic impact of a sphere on a rigid wall.

    Only the relative motion counts: a free wall with the grain's reduced mass in place of its mass is a rigid one.
    """
    mass = density * 4.0 / 3.0 * math.pi * radius**3
    wall = min(_WALL, _HEAVIER * mass)
    contact = {"law": "hertz", "young_modulus": modulus, "poisson_ratio": poisson,
               "wall_young_modulus": 1e18, "wall_poisson_ratio": 0.0}  # fmt: skip
    scene = _thrown(mass * wall / (wall - mass), radius, contact, wall)
    stiffness = float(contact_of(scene).parameters[0])
    closed = hertz_impact(stiffness, mass, speed)
    integration = Integration(scene, "soft", _RTOL)
    state, samples = _falling(speed), sample_series(_SAMPLES)
    spacing = 1.1 * closed.duration / _SAMPLES
    integration.advance(state, integration.table, Observation((0.0, scene.duration), 0.0, spacing, samples))
    overlap = _top(samples[columns.S_BEAM] - samples[columns.S_GRAIN])
    return {
        "force": stiffness * overlap**1.5, "closed_force": closed.force,
        "overlap": overlap, "closed_overlap": closed.overlap,
        "duration": float(state.y[columns.CONTACT_TIME]), "closed_duration": closed.duration,
    }  # fmt: skip


def rebound(law: str, restitution: float, speed: float = 1.0) -> dict[str, float | str]:
    """Return the rebound of a grain from a wall for a prescribed restitution."""
    contact: dict[str, Any] = {"law": law, "restitution": restitution}
    if law != "impact":
        contact["stiffness"] = 1e6
    scene = _thrown(2.0, 0.0085, contact)
    integration = Integration(scene, "impact" if law == "impact" else "soft", _RTOL)
    state = _falling(speed)
    integration.advance(state, integration.table)
    return {"restitution": (state.grain_velocity - state.beam_velocity) / speed, "closed_restitution": restitution}


def thornton(restitution: float, speed: float = 1.0) -> dict[str, float | str]:
    """Return the rebound from a wall where Tsuji's damping is by Thornton's polynomial for a wanted restitution.

    Thornton's gamma is of the tangent stiffness, c = 2 gamma sqrt(1.5 k m), the thesis's beta of k.
    """
    damping_ratio = math.sqrt(1.5) * thornton_gamma(restitution)
    scene = _thrown(2.0, 0.0085, {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2,
                                  "damping_ratio": damping_ratio})  # fmt: skip
    state = _falling(speed)
    integration = Integration(scene, "soft", _RTOL)
    integration.advance(state, integration.table)
    return {"rebound": (state.grain_velocity - state.beam_velocity) / speed}


def bouncing(restitution: float, speed: float, impact: int, gravity: float = 9.81) -> dict[str, float | str]:
    """Return when a ball thrown up from a wall strikes it for the `impact`-th time, and when it rests.

    The wall is as stiff and damped as a scene allows, and so light that it has stopped before the next impact; the mass
    it does have lowers the ball's own restitution.
    """
    scene = standard_bench(
        beam={"mass": _STIFF_WALL, "stiffness": 1e12, "damping": 1e9}, grain={"mass_fraction": 2e-6, "radius": 0.0085},
        contact={"law": "impact", "restitution": restitution}, excitation={"amplitude": 0.0, "frequency": 1.0},
        ceiling={"height": 1e3}, initial={"grain_velocity": speed}, gravity=gravity, duration=10.0,
        steady_window=[0.0, 10.0],
    )  # fmt: skip
    log = impact_log(1000)
    last = Integration(scene, "impact", _RTOL).run(Observation((0.0, 10.0), impacts=log)).last
    share = scene.grain_mass / _STIFF_WALL
    own = (restitution - share) / (1.0 + share)
    return {
        "impact_time": float(log[impact - 1, columns.E_TIME]),
        "closed_impact_time": bouncing_time(speed, own, gravity) * (1.0 - own**impact),
        "rest_time": 10.0 - float(last.y[columns.CONTACT_TIME]),
        "closed_rest_time": bouncing_time(speed, own, gravity),
    }


def _thrown(grain_mass: float, radius: float, contact: dict[str, Any], wall: float = _WALL) -> Scene:
    """Return a scene of a grain and a free, heavy wall of a mass [kg], the ceiling far away."""
    return standard_bench(
        beam={"mass": wall, "stiffness": 1e-6, "damping": 0.0},
        grain={"mass_fraction": grain_mass / (grain_mass + wall), "radius": radius}, contact=contact,
        excitation={"amplitude": 0.0, "frequency": 1.0}, ceiling={"height": 1e3}, gravity=0.0, duration=0.01,
        steady_window=[0.0, 0.01],
    )  # fmt: skip


def _falling(speed: float) -> State:
    """Return a grain just above the floor, moving down at a speed [m/s]."""
    state = State.resting(0.0, 0.0)
    state.y[columns.GRAIN], state.y[columns.GRAIN_VELOCITY] = 1e-12, -speed
    state.n[columns.MODE] = columns.FREE
    return state


def _top(values: Any) -> float:
    """Return the vertex of a parabola through the largest sample and its neighbours."""
    place = int(np.argmax(values))
    left, middle, right = values[place - 1 : place + 2]
    return float(middle - 0.125 * (left - right) ** 2 / (left - 2.0 * middle + right))


_KINDS: dict[str, Callable[..., dict[str, float | str]]] = {
    "two_impacts": two_impacts,
    "impact_sink": impact_sink,
    "hertz": hertz,
    "rebound": rebound,
    "thornton": thornton,
    "bouncing": bouncing,
    "shaking_table": shaking_table,
}
