# SPDX-License-Identifier: Apache-2.0
"""Shares of starts that come to the promised motion: against naive integration, symmetry, and shares that are known."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sim_program import main

from atpid_sim.engine.basin_run import METRIC
from atpid_sim.periodic.basin import Basin, Starts, _Trial, basin, sampled
from atpid_sim.periodic.motion import SteadyState
from atpid_sim.periodic.neighbourhood import PLACES, Flow, cycle_of
from atpid_sim.periodic.return_map import Conditions
from atpid_sim.periodic.steady import steady_state
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

SCENES = Path(__file__).parents[2] / "scenes"
#: Naive steps in a period of the support.
STEPS = 120


def with_impacts(restitution: float, height: float, **changes: Any) -> Scene:
    return standard_bench(contact={"law": "impact", "restitution": restitution}).with_(height=height, **changes)


#: Without gravity the two walls are alike, and each motion has a mirror image half a period later.
MIRRORED = with_impacts(0.72, 0.1222, gravity=0.0, amplitude=0.0078, frequency=4.287, mass_fraction=0.148)
#: A motion of period 2 beside another one, under gravity.
BISTABLE = with_impacts(0.37, 0.0476, amplitude=0.0102, frequency=6.754, mass_fraction=0.337)
MONOSTABLE = with_impacts(0.56, 0.15, amplitude=0.0141, frequency=6.8, mass_fraction=0.063)


def conditions_of(scene: Scene) -> Conditions:
    return Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])


def promised(scene: Scene) -> SteadyState:
    state = steady_state(scene, "impact").state
    assert state is not None
    return state


class Naive:
    """Beams and grains (n,) in steps of one size, impacts at instants interpolated linearly: nothing of the engine."""

    def __init__(self, scene: Scene, phase: float) -> None:
        beam = scene.beam
        self.mass, self.grain, self.gravity = beam.mass, scene.grain_mass, scene.gravity
        self.natural, self.decay = math.sqrt(beam.stiffness / beam.mass), 0.5 * beam.damping / beam.mass
        self.damped = math.sqrt(self.natural**2 - self.decay**2)
        self.clearance = scene.ceiling.heights[-1][1] - 2.0 * scene.grain.radius
        self.restitution = float(scene.contact.model_dump()["restitution"])
        self.omega, self.phase = 2.0 * math.pi * scene.frequency_hz, phase
        support = complex(beam.stiffness, beam.damping * self.omega)
        self.answer = scene.excitation.amplitude_points[-1][1] * support
        self.answer /= complex(beam.stiffness - beam.mass * self.omega**2, beam.damping * self.omega)
        self.step = 2.0 * math.pi / self.omega / STEPS

    def driven(self, time: Array) -> tuple[Array, Array]:
        """Displacement and velocity that the drive alone gives, about the rest of the beam without a grain."""
        turned = self.answer * np.exp(1j * (self.omega * time + 2.0 * math.pi * self.phase))
        return turned.imag - self.gravity / self.natural**2, (1j * self.omega * turned).imag

    def moved(self, states: Array, time: Array, after: Array) -> Array:
        """Free motion of section states (4, n) from times (n,) on."""
        (x, v), (x1, v1) = self.driven(time), self.driven(time + after)
        a, b = states[0] - x, states[1] - v
        s, c, fade = np.sin(self.damped * after), np.cos(self.damped * after), np.exp(-self.decay * after)
        sine = (b + self.decay * a) / self.damped
        swing, rate = a * c + sine * s, (sine * c - a * s) * self.damped
        grain = states[2] + after * (states[3] - 0.5 * self.gravity * after)
        return np.array(
            [x1 + fade * swing, v1 + fade * (rate - self.decay * swing), grain, states[3] - self.gravity * after]
        )

    def stepped(self, states: Array, time: Array) -> Array:
        later = self.moved(states, time, np.full(states.shape[1], self.step))
        for floor in (True, False):
            gap0, gap1 = (
                each[2] - each[0] if floor else self.clearance - each[2] + each[0] for each in (states, later)
            )
            closing = (later[1] - later[3]) * (1.0 if floor else -1.0) > 0.0
            hit = np.flatnonzero((gap1 < 0.0) & closing)
            share = np.clip(gap0[hit] / np.maximum(gap0[hit] - gap1[hit], 1e-300), 0.0, 1.0)
            struck = self.moved(states[:, hit], time[hit], share * self.step)
            impulse = (1.0 + self.restitution) * (struck[1] - struck[3]) * self.mass * self.grain
            impulse /= self.mass + self.grain
            impulse = np.maximum(impulse, 0.0) if floor else np.minimum(impulse, 0.0)
            struck[1] -= impulse / self.mass
            struck[3] += impulse / self.grain
            ended = self.moved(struck, time[hit] + share * self.step, (1.0 - share) * self.step)
            wall = ended[0] + (0.0 if floor else self.clearance)
            ended[2] = np.maximum(ended[2], wall) if floor else np.minimum(ended[2], wall)
            later[:, hit] = ended
        return later

    def run(self, states: Array, begin: NDArray[np.int64], end: int) -> Array:
        """Run states from their step `begin` (n,) to the step `end`."""
        states = states.copy()
        for k in range(int(begin.min()), end):
            on = np.flatnonzero(begin <= k)
            states[:, on] = self.stepped(states[:, on], np.full(len(on), k * self.step))
        return states


def naive_share(scene: Scene, starts: Starts, limit: float, count: int, seed: int) -> float:
    """Share of starts that come to the promised motion, each run to its limit [s], by naive integration."""
    motion, rng = promised(scene), np.random.default_rng(seed)
    naive = Naive(scene, motion.phase)
    begin = rng.integers(0, STEPS * motion.periods, count)
    size = motion.amplitude * np.array([1.0, naive.omega, 1.0, naive.omega])
    if starts.kick is None:
        aside = rng.uniform(-starts.box, starts.box, (3, count))
        rest = -(naive.mass + naive.grain) * naive.gravity / (naive.mass * naive.natural**2)
        beam, velocity = rest + aside[0] * size[0], aside[1] * size[1]
        grain = beam + rng.uniform(0.0, naive.clearance, count)
        states = np.array([beam, velocity, grain, velocity + aside[2] * size[1]])
    else:
        course = [motion.section[:, None]]
        for k in range(STEPS * motion.periods - 1):
            course.append(naive.stepped(course[-1], np.array([k * naive.step])))
        states, way = np.concatenate(course, axis=1)[:, begin], rng.uniform(0.0, 2.0 * math.pi, count)
        states[1] += starts.kick * np.cos(way)
        states[3] += starts.kick * np.sin(way)
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
        (MIRRORED, Starts(None, 1.5), 0.4, 0.6),
        (MIRRORED, Starts(0.5), 0.4, 0.6),
        (BISTABLE, Starts(None, 1.5), 0.85, 0.99),
        (MONOSTABLE, Starts(None, 1.5), 0.96, 1.0),
        (MONOSTABLE, Starts(1.0), 0.96, 1.0),
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
    share = basin(MIRRORED, Starts(0.5), count=20_000, seed=1000).share
    found = [basin(MIRRORED, Starts(0.5), error=0.06, seed=seed) for seed in range(40)]
    assert all(one.high - one.low <= 0.12 for one in found)
    assert len({one.share for one in found}) > 10
    assert sum(one.low <= share <= one.high for one in found) >= 35  # 34 of 95 % by chance once in 250


@pytest.mark.parametrize("share", [0.002, 0.1, 0.5, 0.98])
def test_the_interval_covers_wherever_the_sampling_ends(share: float) -> None:
    covered, sizes = 0, set()
    for seed in range(200):
        came = np.cumsum(np.random.default_rng(seed).random(2000) < share, dtype=np.int64)

        def run(size: int, came: NDArray[np.int64] = came) -> int:
            sizes.add(size)
            return int(came[size - 1])

        low, high = sampled(run, 0.04)
        assert high - low <= 0.08
        covered += low <= share <= high
    assert covered >= 183  # 190 less 2.3 standard deviations
    assert (max(sizes) < 200) == (share == 0.002)


@pytest.mark.parametrize(("scene", "fidelity"), [(BISTABLE, "impact"), (standard_bench(), "finite")])
def test_every_state_of_a_neighbourhood_comes_to_its_motion(scene: Scene, fidelity: str) -> None:
    state, conditions = steady_state(scene, fidelity).state, conditions_of(scene)
    assert state is not None
    integration = Integration(scene, fidelity)
    cycle = cycle_of(integration, conditions, state)
    trial, ways = _Trial(integration, conditions, cycle, Starts(0.1)), np.random.default_rng(7).normal(size=(400, 4))
    place, size = trial.places[0], cycle.amplitude * np.array([1.0, 2.0 * math.pi * conditions.frequency] * 2)
    root = np.linalg.cholesky(place[METRIC : METRIC + 16].reshape(4, 4))
    states = place[:4] + np.linalg.solve(root.T, 0.999 * (ways / np.linalg.norm(ways, axis=1)[:, None]).T).T
    assert np.abs((states - place[:4]) / size).max() > 1e-3
    after = Flow(integration, conditions, cycle.phase).passed(states, cycle.state, 60 * cycle.periods)
    assert after is not None
    assert np.abs((after - cycle.state.y[PLACES]) / size).max() < 1e-3


def test_it_costs_a_tenth_of_running_ten_thousand_starts() -> None:
    found, motion = basin(BISTABLE, Starts(0.5)), promised(BISTABLE)
    integration, conditions = Integration(BISTABLE, "impact"), conditions_of(BISTABLE)
    trial = _Trial(integration, conditions, cycle_of(integration, conditions, motion), Starts(0.5))
    trial.places, trial.shares, trial.own = trial.places[:0], trial.shares[:0], 0  # nowhere to end before the limit
    trial.flow.follow(
        *trial._states(np.random.default_rng(0).random((100, 6))), trial.limit, trial.places, trial.shares
    )
    assert found.steps <= 0.1 * 100 * trial.flow.steps


def test_where_the_own_run_comes_to_none_the_lowest_is_promised() -> None:
    scene = with_impacts(0.45, 0.062, amplitude=0.0054, frequency=4.75, mass_fraction=0.22)
    found = basin(scene, Starts(None, 1.5), error=0.1)
    assert steady_state(scene, "impact").state is None
    assert "lowest amplitude" in found.promised
    assert 0.25 < found.share < 0.55


def of_heights(capsys: pytest.CaptureFixture[str], *extra: str) -> list[dict[str, object]]:
    arguments = ["basin", str(SCENES / "standard.yaml"), "--heights", "0.14:0.24:2", "--kick", "0.1", *extra]
    assert main([*arguments, "--json"]) == 0
    rows: list[dict[str, object]] = json.loads(capsys.readouterr().out)
    return rows


def test_the_command_prints_and_writes_heights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = of_heights(capsys, "--out", str(tmp_path / "shares.csv"))
    assert set(rows[0]) == set(Basin.__dataclass_fields__)
    assert [row["height"] for row in rows] == [0.14, 0.24]
    assert (rows[0]["share"], rows[1]["share"], rows[1]["starts"]) == (1.0, None, 0)  # the second is irregular
    written = list(csv.DictReader((tmp_path / "shares.csv").read_text().splitlines()))
    assert [row["height"] for row in written] == ["0.14", "0.24"]
    assert rows == of_heights(capsys)
    assert main(["basin", str(SCENES / "standard.yaml"), "--height", "0.14", "--box", "1", "--starts", "50"]) == 0
    assert "% of starts in a box of 1 come (" in capsys.readouterr().out


def test_simulate_states_it_beside_the_multipliers(capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "standard.yaml")
    assert main(["simulate", scene, "--steady", "--kick", "0.1"]) == 0
    assert "100.0 % of kicks of 0.1 m/s come back (" in capsys.readouterr().out
    assert main(["simulate", scene, "--steady", "--kick", "0.1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kicked"]["share"] == 1.0
    assert main(["simulate", scene, "--kick", "0.1"]) != 0
    assert "--kick: given 0.1 without --steady" in capsys.readouterr().err


def test_other_excitations_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["basin", str(SCENES / "free_decay.yaml")]) != 0
    assert "excitation: given one that is no tone" in capsys.readouterr().err
