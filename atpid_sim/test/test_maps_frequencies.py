# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Maps over amplitude, mass fraction and frequency: made, read, and where the damper is of no use."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.commands.map import ratios_of
from atpid_sim.maps import DamperResponse, Failure, HeightMap, MapError, Timing, build_map, header_text
from atpid_sim.maps.response import LEAST_USE
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import amplitude_without_damper

SHIPPED = Path(__file__).parents[2] / "atpid_control" / "config" / "maps" / "standard.npz"
RATIOS = [0.5, 0.98, 1.0, 1.3]
AMPLITUDES = [0.012, 0.02]
SCENE = standard_bench(excitation={"amplitude": 0.015, "frequency": "resonance"}, tolerance=1e-4)


def at(ratio: float, scene: Scene = SCENE) -> Scene:
    return scene.with_(frequency=ratio * scene.natural_frequency_hz)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("maps") / "wide.npz"
    build_map(SCENE, AMPLITUDES, [0.1, 0.2], out, frequency_ratios=RATIOS)
    return out


def test_a_layer_is_the_map_of_its_frequency(made: Path, tmp_path: Path) -> None:
    wide = HeightMap.load(made)
    assert wide.heights.shape == (4, 2, 2)
    one = build_map(SCENE, AMPLITUDES, [0.1, 0.2], tmp_path / "one.npz")
    assert np.array_equal(wide.heights[2], one.heights)
    assert wide.lookup(0.015, 0.1, 1.0) == one.lookup(0.015, 0.1)
    assert wide.lookup(0.012, 0.1, 0.98).height < one.lookup(0.012, 0.1).height


def test_maps_for_one_frequency_are_written_and_read_as_before(made: Path, tmp_path: Path) -> None:
    shipped, again = HeightMap.load(SHIPPED), tmp_path / "again.npz"
    shipped.save(again)
    with np.load(SHIPPED) as old, np.load(again) as new:
        assert set(old.files) == set(new.files)
        assert json.loads(str(new["about"])) == json.loads(str(old["about"]))
    assert shipped.lookup(0.02, 0.1, 1.3) == shipped.lookup(0.02, 0.1)  # the frequency is the hold's to guard
    with np.load(made) as wide:
        assert json.loads(str(wide["about"]))["format"] == 2
        assert wide["frequency_ratios"].tolist() == RATIOS


def test_where_the_grain_is_not_lifted_the_damper_is_closed(made: Path) -> None:
    """Closed form: the closed beam's acceleration against gravity; below it all heights leave the same."""
    wide, damper = HeightMap.load(made), DamperResponse(at(0.5))
    assert damper.closed_over_gravity(0.015) == pytest.approx(
        0.015 * (np.pi * SCENE.natural_frequency_hz) ** 2 / 9.81 / 0.75, rel=2e-3
    )
    assert damper.rests(0.012)
    entry = wide.lookup(0.012, 0.1, 0.5)
    assert entry.height == pytest.approx(0.017)
    assert entry.efficiency == 0.0
    assert entry.amplitude == pytest.approx(damper.closed_amplitude(0.012))
    assert damper.opened(0.012, 0.1, Timing(24.0, 8.0)).amplitude == pytest.approx(entry.amplitude, rel=2e-3)


def test_no_height_is_worth_less_than_what_is_of_use(made: Path) -> None:
    wide = HeightMap.load(made)
    opened = wide.heights > 0.017 + 1e-9
    assert (wide.efficiencies[opened] >= LEAST_USE).all()
    assert (wide.efficiencies[~opened] == 0.0).all()
    assert opened[2].all()


def test_between_frequencies_the_height_lies_between_theirs_or_is_the_lower_of_two_wells(made: Path) -> None:
    wide = HeightMap.load(made)
    low, middle, high = (wide.lookup(0.015, 0.1, ratio) for ratio in (0.98, 0.99, 1.0))
    assert low.height < middle.height < high.height
    assert middle.efficiency == pytest.approx(0.5 * (low.efficiency + high.efficiency))
    assert wide.lookup(0.015, 0.1, 1.2).height == pytest.approx(wide.lookup(0.015, 0.1, 1.3).height)
    assert wide.lookup(0.012, 0.1, 0.8).height == pytest.approx(0.017)  # closed on one side


def test_a_frequency_of_the_map_is_that_one_however_it_is_rounded(made: Path) -> None:
    """Also beside a frequency whose heights lie in another well, and at both ends."""
    wide, rounding = HeightMap.load(made), 2.0**-50
    for ratio in RATIOS:
        for near in (ratio * (1.0 - rounding), ratio * (1.0 + rounding)):
            assert wide.lookup(0.012, 0.1, near) == wide.lookup(0.012, 0.1, ratio)


def test_outside_its_frequencies_it_gives_no_height(made: Path) -> None:
    wide = HeightMap.load(made)
    for ratio in (0.499, 1.301, float("nan")):
        with pytest.raises(MapError, match=r"of the natural one is outside its 0\.5 to 1\.3 of the natural"):
            wide.lookup(0.015, 0.1, ratio)
    assert wide.covers(0.012, 0.02, 0.1, (0.5, 1.3))
    assert not wide.covers(0.012, 0.02, 0.1, (0.5, 1.4))
    assert not HeightMap.load(SHIPPED).covers(0.012, 0.02, 0.1, (0.9, 1.1))


def test_it_holds_for_its_system_at_any_frequency(made: Path) -> None:
    wide = HeightMap.load(made)
    for ratio in (0.7, 1.0, 1.2):
        wide.check(at(ratio))
    with pytest.raises(MapError, match=r"beam\.damping"):
        wide.check(standard_bench(beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.6}))


def test_a_header_for_the_firmware_is_that_of_resonance(made: Path, tmp_path: Path) -> None:
    one = build_map(SCENE, AMPLITUDES, [0.1, 0.2], tmp_path / "one.npz")
    assert header_text(HeightMap.load(made), 0.1).splitlines()[-3:] == header_text(one, 0.1).splitlines()[-3:]


def test_a_point_that_cannot_be_computed_is_missing_at_its_frequency_only(made: Path, tmp_path: Path) -> None:
    wide = HeightMap.load(made)
    grids = {name: getattr(wide, name).copy() for name in ("heights", "beam_amplitudes", "efficiencies")}
    for grid in grids.values():
        grid[1, 0, 1] = np.nan
    lost = replace(wide, **grids, failures=(Failure(0.1, 0.02, "pressed too deep", 0.98),))
    lost.save(tmp_path / "lost.npz")
    again = HeightMap.load(tmp_path / "lost.npz")
    assert again.failures == lost.failures
    with pytest.raises(MapError, match="pressed too deep"):
        again.lookup(0.018, 0.1, 0.99)
    assert again.lookup(0.018, 0.1, 1.0) == wide.lookup(0.018, 0.1, 1.0)


@pytest.mark.parametrize("ratios", [[[1.0]], [1.0, 0.9], [0.0, 1.0], [1.0, np.inf], [0.5, 1.0]])
def test_a_damaged_axis_is_refused(made: Path, tmp_path: Path, ratios: object) -> None:
    with np.load(made) as stored:
        arrays = dict(stored)
    np.savez(tmp_path / "bad.npz", **(arrays | {"frequency_ratios": np.array(ratios)}))
    with pytest.raises(MapError):
        HeightMap.load(tmp_path / "bad.npz")


def test_the_command_takes_ratios_from_half_to_twice_the_natural_frequency() -> None:
    assert ratios_of("0.5:2:4") == [0.5, 1.0, 1.5, 2.0]
    for text in ("0.4:1:3", "0.5:2.1:3", "1:1:2", "0.5:1", "a:b:c"):
        with pytest.raises(argparse.ArgumentTypeError, match="R0:R1:N"):
            ratios_of(text)


@pytest.mark.parametrize("over_frequencies", [True, False])
def test_reductions_are_against_the_structure_without_the_damper(
    made: Path, tmp_path: Path, over_frequencies: bool
) -> None:
    heights = HeightMap.load(made) if over_frequencies else build_map(SCENE, AMPLITUDES, [0.1, 0.2], tmp_path / "m.npz")
    for place, value in np.ndenumerate(heights.reductions):
        fraction, amplitude = heights.mass_fractions[place[-2]], heights.amplitudes[place[-1]]
        ratio = RATIOS[place[0]] if over_frequencies else 1.0
        scene = at(ratio, SCENE.with_(mass_fraction=float(fraction)))
        bare = amplitude_without_damper(scene) * amplitude / 0.015
        assert value == pytest.approx(1.0 - heights.beam_amplitudes[place] / bare, rel=1e-9)
