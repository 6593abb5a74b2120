# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shares of starts that come to the promised motion: against naive integration, symmetry, and shares that are known."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sim_program import main
from sim_refusals import command_refused
from test_modal_engine import forced

from atpid_dynamics.basin import Starts, basin, sampled
from atpid_dynamics.neighbourhood import Flow, cycle_of, neighbourhoods
from atpid_sim.periodic.return_map import Conditions
from atpid_sim.periodic.solve import SteadyState
from atpid_sim.periodic.steady import steady_state
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

SCENES = Path(__file__).parents[3] / "scenes"
#: Naive steps in a period of the support.
STEPS = 60


def with_impacts(restitution: float, height: float, **changes: Any) -> Scene:
    return standard_bench(contact={"law": "impact", "restitution": restitution}).with_(height=height, **changes)


#: Without gravity the two walls are alike, and each motion has a mirror image half a period later.
MIRRORED = with_impacts(0.72, 0.1222, gravity=0.0, amplitude=0.0078, frequency=4.287, mass_fraction=0.148)
#: A motion of period 2 beside another one, under gravity.
BISTABLE = with_impacts(0.37, 0.0476, amplitude=0.0102, frequency=6.754, mass_fraction=0.337)
MONOSTABLE = with_impacts(0.56, 0.15, amplitude=0.0141, frequency=6.8, mass_fraction=0.063)
FURTHER = [
    {"mass": 2.4, "frequency": 17.0, "damping_ratio": 0.03, "drive_factor": 0.2},
    {"mass": 1.5, "frequency": 29.0, "damping_ratio": 0.02, "drive_factor": -0.15},
    {"mass": 5.0, "frequency": 47.0, "damping_ratio": 0.02, "drive_factor": 0.1},
]


def conditions_of(scene: Scene) -> Conditions:
    return Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])


def promised(scene: Scene) -> SteadyState:
    state = steady_state(scene, "impact").state
    assert state is not None
    return state


class Naive:
    """Structures and grains (n,) in steps of one size, impacts at interpolated instants: nothing of the engine."""

    def __init__(self, scene: Scene, phase: float) -> None:
        modes = [scene.beam, *scene.further_modes]
        self.mass, stiffness, damping = (
            np.array([getattr(mode, name) for mode in modes])[:, None] for name in ("mass", "stiffness", "damping")
        )
        share = np.array([1.0, *(mode.drive_factor for mode in scene.further_modes)])[:, None]
        self.grain, self.gravity = scene.grain_mass, scene.gravity
        self.natural, self.decay = np.sqrt(stiffness / self.mass), 0.5 * damping / self.mass
        self.damped = np.sqrt(self.natural**2 - self.decay**2)
        self.clearance = scene.ceiling.heights[-1][1] - 2.0 * scene.grain.radius
        self.restitution = float(scene.contact.model_dump()["restitution"])
        self.omega, self.phase = 2.0 * math.pi * scene.frequency_hz, phase
        force = share + 0.0j
        if scene.drive == "support":
            share[0] = 1.0 - share[1:].sum()
            force = share * (stiffness + 1j * damping * self.omega)
        self.answer = scene.excitation.amplitude_points[-1][1] * force
        self.answer /= stiffness - self.mass * self.omega**2 + 1j * damping * self.omega
        self.weight = np.where(np.arange(len(modes)) == 0, self.gravity, 0.0)[:, None] / self.natural**2
        self.effective = float(1.0 / np.sum(1.0 / self.mass))
        self.step = 2.0 * math.pi / self.omega / STEPS

    def rest(self) -> Array:
        """Displacements of the modes (modes, 1) under the weight of structure and grain."""
        grain: Array = self.weight + self.grain * self.gravity / (self.mass * self.natural**2)
        return -grain

    def driven(self, time: float | Array) -> tuple[Array, Array]:
        """Displacements and velocities that the drive alone gives, about the rest of the structure without a grain."""
        turned = self.answer * np.exp(1j * (self.omega * time + 2.0 * math.pi * self.phase))
        return turned.imag - self.weight, (1j * self.omega * turned).imag

    def moved(self, states: Array, time: float | Array, after: float | Array) -> Array:
        """Free motion of section states (2 modes + 2, n) from times on, for durations: one of all, or (n,)."""
        (x, v), (x1, v1) = self.driven(time), self.driven(time + after)
        a, b = states[:-2:2] - x, states[1:-2:2] - v
        s, c, fade = np.sin(self.damped * after), np.cos(self.damped * after), np.exp(-self.decay * after)
        sine = (b + self.decay * a) / self.damped
        swing, rate = a * c + sine * s, (sine * c - a * s) * self.damped
        later = np.empty_like(states)
        later[:-2:2], later[1:-2:2] = x1 + fade * swing, v1 + fade * (rate - self.decay * swing)
        later[-2] = states[-2] + after * (states[-1] - 0.5 * self.gravity * after)
        later[-1] = states[-1] - self.gravity * after
        return later

    def stepped(self, states: Array, time: float) -> Array:
        later = self.moved(states, time, self.step)
        for floor in (True, False):
            gap0, gap1 = (
                gap if floor else self.clearance - gap
                for gap in (each[-2] - each[:-2:2].sum(axis=0) for each in (states, later))
            )
            closing = (later[1:-2:2].sum(axis=0) - later[-1]) * (1.0 if floor else -1.0) > 0.0
            hit = np.flatnonzero((gap1 < 0.0) & closing)
            if not len(hit):
                continue
            share = np.clip(gap0[hit] / np.maximum(gap0[hit] - gap1[hit], 1e-300), 0.0, 1.0)
            struck = self.moved(states[:, hit], time, share * self.step)
            impulse = (1.0 + self.restitution) * (struck[1:-2:2].sum(axis=0) - struck[-1]) * self.effective * self.grain
            impulse /= self.effective + self.grain
            impulse = np.maximum(impulse, 0.0) if floor else np.minimum(impulse, 0.0)
            struck[1:-2:2] -= impulse / self.mass
            struck[-1] += impulse / self.grain
            ended = self.moved(struck, time + share * self.step, (1.0 - share) * self.step)
            wall = ended[:-2:2].sum(axis=0) + (0.0 if floor else self.clearance)
            ended[-2] = np.maximum(ended[-2], wall) if floor else np.minimum(ended[-2], wall)
            later[:, hit] = ended
        return later

    def run(self, states: Array, begin: NDArray[np.int64], end: int) -> Array:
        """Run states from their step `begin` (n,) to the step `end`."""
        states, all_run = states.copy(), int(begin.max())
        for k in range(int(begin.min()), all_run):
            on = np.flatnonzero(begin <= k)
            states[:, on] = self.stepped(states[:, on], k * self.step)
        for k in range(all_run, end):
            states = self.stepped(states, k * self.step)
        return states


def naive_share(scene: Scene, starts: Starts, limit: float, count: int, seed: int) -> float:
    """Share of starts that come to the promised motion, each run to its limit [s], by naive integration."""
    motion, rng = promised(scene), np.random.default_rng(seed)
    naive = Naive(scene, motion.phase)
    begin = rng.integers(0, STEPS * motion.periods, count)
    size = motion.amplitude * np.tile([1.0, naive.omega], len(motion.section) // 2)
    if starts.kick is None:
        size[2:-2:2] *= np.minimum(1.0, naive.omega / naive.natural[1:, 0])
        states = rng.uniform(-starts.box, starts.box, (len(size), count)) * size[:, None]
        states[:-2:2] += naive.rest()
        states[-2] = states[:-2:2].sum(axis=0) + rng.uniform(0.0, naive.clearance, count)
        states[-1] += states[1:-2:2].sum(axis=0)
    else:
        course = [motion.section[:, None]]
        for k in range(STEPS * motion.periods - 1):
            course.append(naive.stepped(course[-1], k * naive.step))
        states, way = np.concatenate(course, axis=1)[:, begin], rng.uniform(0.0, 2.0 * math.pi, count)
        states[1:-2:2] += starts.kick * np.cos(way) * naive.effective / naive.mass
        states[-1] += starts.kick * np.sin(way)
    periods = motion.periods * math.ceil(limit * scene.frequency_hz / motion.periods + 1.0)
    states = naive.run(states, begin, STEPS * periods)
    image, near = motion.section, np.zeros(count, dtype=bool)
    for k in range(motion.periods):  # a motion of period 2 may pass the section either way
        near |= (np.abs(states - image[:, None]) < 0.05 * size[:, None]).all(axis=0)
        image = naive.run(image[:, None], np.array([k * STEPS]), (k + 1) * STEPS)[:, 0]
    return float(near.mean())


@pytest.mark.parametrize(
    ("scene", "starts", "least", "most"),
    [
        (MIRRORED, Starts(0.5), 0.4, 0.6),
        (BISTABLE, Starts(None, 1.5), 0.85, 0.99),
        (forced(MIRRORED).with_(further_modes=FURTHER[:1]), Starts(None, 1.5), 0.35, 0.5),
        (forced(MONOSTABLE).with_(further_modes=FURTHER), Starts(1.0), 0.96, 1.0),
    ],
)
def test_a_share_is_that_of_naive_integration(scene: Scene, starts: Starts, least: float, most: float) -> None:
    found, count = basin(scene, starts, fidelity="impact"), 800
    assert least <= found.share <= most
    assert 0.0 <= found.low <= found.share <= found.high <= 1.0
    assert found.high - found.low <= 0.04
    naive = naive_share(scene, starts, found.limit, count, seed=8)
    chance = 2.6 * math.sqrt(naive * (1.0 - naive) / count)
    assert abs(naive - found.share) <= 0.02 + chance


def test_mirror_images_have_shares_alike() -> None:
    found = basin(MIRRORED, Starts(None, 1.5), count=4000, seed=3)
    came = round(found.share * found.starts)
    assert came + found.elsewhere + found.undecided == found.starts == 4000
    assert found.undecided < 100
    assert abs(came - found.elsewhere) <= 3.3 * math.sqrt(4000)


@pytest.mark.parametrize("starts", [Starts(0.1), Starts(2.0), Starts(None, 1.5)])
@pytest.mark.parametrize("name", ["closed_damper", "sticking"])
def test_one_motion_alone_is_come_to_from_everywhere(name: str, starts: Starts) -> None:
    found = basin(load_scene(SCENES / f"{name}.yaml"), starts)
    assert (found.share, found.high, found.elsewhere, found.undecided) == (1.0, 1.0, 0, 0)
    assert found.low == pytest.approx(0.00125 ** (1.0 / found.starts), rel=1e-9)  # Clopper-Pearson, of an early look
    assert 0.0 < found.times[0] <= found.times[1] <= found.times[2] < found.limit


def test_a_held_grain_comes_back_as_fast_as_one_mass_decays() -> None:
    scene = load_scene(SCENES / "closed_damper.yaml")
    slow, fast = (basin(scene, Starts(kick)).times[0] for kick in (8.0, 16.0))
    decay = 0.5 * scene.beam.damping / scene.total_mass
    assert fast - slow == pytest.approx(math.log(2.0) / decay, abs=1.0 / scene.frequency_hz)


def test_intervals_hold_the_share_for_forty_seeds() -> None:
    share = basin(MIRRORED, Starts(0.5), count=10_000, seed=1000).share
    found = [basin(MIRRORED, Starts(0.5), error=0.1, seed=seed) for seed in range(40)]
    assert all(one.high - one.low <= 0.2 for one in found)
    assert len({one.share for one in found}) > 10
    assert sum(one.low <= share <= one.high for one in found) >= 35  # 34 of 95 % by chance once in 250


@pytest.mark.parametrize("share", [0.002, 0.1, 0.5, 0.98])
def test_the_interval_covers_wherever_the_sampling_ends(share: float) -> None:
    covered, sizes = 0, set()
    for seed in range(40):
        came = np.cumsum(np.random.default_rng(seed).random(2000) < share, dtype=np.int64)

        def run(size: int, came: NDArray[np.int64] = came) -> int:
            sizes.add(size)
            return int(came[size - 1])

        low, high = sampled(run, 0.04)
        assert high - low <= 0.08
        covered += low <= share <= high
    assert covered >= 34  # 38 less 2.9 standard deviations
    assert (max(sizes) < 200) == (share == 0.002)


@pytest.mark.parametrize(("scene", "fidelity"), [(BISTABLE, "impact"), (standard_bench(), "finite")])
def test_every_state_of_a_neighbourhood_comes_to_its_motion(scene: Scene, fidelity: str) -> None:
    state, conditions = steady_state(scene, fidelity).state, conditions_of(scene)
    assert state is not None
    integration = Integration(scene, fidelity)
    cycle = cycle_of(integration, conditions, state)
    flow, ways = Flow(integration, conditions, cycle.phase), np.random.default_rng(7).normal(size=(400, 4))
    place = neighbourhoods(flow, cycle)[0][0]
    size = cycle.amplitude * np.array([1.0, 2.0 * math.pi * conditions.frequency] * 2)
    root = np.linalg.cholesky(place[4:20].reshape(4, 4))
    states = place[:4] + np.linalg.solve(root.T, 0.999 * (ways / np.linalg.norm(ways, axis=1)[:, None]).T).T
    assert np.abs((states - place[:4]) / size).max() > 1e-3
    after = flow.passed(states, cycle.state, 60 * cycle.periods)
    assert after is not None
    assert np.abs((after - cycle.state.y[integration.sections.places]) / size).max() < 1e-3


def test_where_the_own_run_comes_to_none_the_lowest_is_promised() -> None:
    scene = with_impacts(0.45, 0.062, amplitude=0.0054, frequency=4.75, mass_fraction=0.22)
    found = basin(scene, Starts(None, 1.5), error=0.1)
    assert steady_state(scene, "impact").state is None
    assert "lowest" in found.promised
    assert 0.25 < found.share < 0.55


def test_a_run_s_kicks_are_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["simulate", str(SCENES / "standard.yaml"), "--kick", "0.1"]
    assert main([*words, "--steady", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kicked"]["share"] == 1.0
    command_refused(capsys, words, 2, "--kick", "0.1", "--steady")
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: [])
    command_refused(capsys, [*words, "--steady"], 2, "--kick", "atpid_dynamics", "not installed")
