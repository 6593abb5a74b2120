# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Backends by name: built in, added by entry points, and those that cannot be used."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from acquisition_bench import Bench

from atpid_common.nodes.parameters import ParameterError
from atpid_driver.acquisition import SetupRefusedError
from atpid_driver.acquisition.registry import backend
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.nodes.labjack_node import LabJackNode

GOOD = """
from atpid_driver.acquisition import Backend
from atpid_driver.acquisition.settings import SimulatedSettings
from atpid_driver.acquisition.simulated import SimulatedAcquisition
BACKEND = Backend(SimulatedSettings, SimulatedAcquisition)
"""


def distribution(folder: Path, name: str, entry: str, module: str = GOOD) -> None:
    """Install a distribution with one module of its own name and one entry point."""
    (folder / f"{name}.py").write_text(module)
    described = folder / f"{name}-1.0.dist-info"
    described.mkdir()
    (described / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (described / "entry_points.txt").write_text(f"[atpid.acquisition]\n{entry} = {name}:BACKEND\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_an_entry_point_is_a_backend_like_the_built_in_ones(site: Path) -> None:
    distribution(site, "registry_good", "good")
    assert backend_names() == ("labjack", "nidaqmx", "simulated", "topic", "good")
    assert backend("good").settings.__name__ == "SimulatedSettings"


@pytest.mark.parametrize(
    ("name", "module", "text"),
    [
        (
            "absent",
            "import no_such_package",
            "cannot be loaded: ModuleNotFoundError: No module named 'no_such_package'",
        ),
        ("broken", "raise ValueError('two\\nlines')", "cannot be loaded: ValueError: two"),
        ("number", "BACKEND = 3", "is a int: it must be an atpid_driver.acquisition.registry.Backend"),
    ],
)
def test_a_plug_in_that_does_not_load_is_one_line(site: Path, name: str, module: str, text: str) -> None:
    distribution(site, f"registry_{name}", "bad", module)
    with pytest.raises(SetupRefusedError) as caught:
        backend("bad")
    assert str(caught.value) == f"backend 'bad' of registry_{name}:BACKEND (registry_{name} 1.0) {text}"


def test_a_name_that_exists_twice_is_refused(site: Path) -> None:
    distribution(site, "registry_one", "same")
    distribution(site, "registry_two", "same")
    distribution(site, "registry_three", "labjack")
    with pytest.raises(SetupRefusedError, match=r"'same' exists more than once: .*registry_one:BACKEND.*; rename"):
        backend("same")
    with pytest.raises(SetupRefusedError, match="'labjack' exists more than once: the built-in one, registry_three"):
        backend("labjack")


def test_an_unknown_backend_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SetupRefusedError, match="'steam' is not known: choose one of labjack, nidaqmx, simulated"):
        backend("steam")


@pytest.mark.parametrize("node", ["acquisition_node", "labjack_node"])
def test_a_node_whose_plug_in_does_not_load_ends_with_one_line_and_status_2(tmp_path: Path, node: str) -> None:
    distribution(tmp_path, "broken", "broken", "import no_such_package")
    wiring = ["rate:=1000.0", "channels:=[a]", "terminals:=[x]", "calibrations:=[a.yaml]"]
    arguments = [word for value in ("backend:=broken", *wiring) for word in ("-p", value)]
    command = [sys.executable, "-m", f"atpid_driver.nodes.{node}", "--ros-args", *arguments]
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, timeout=100.0, check=False
    )
    assert done.returncode == 2
    assert done.stderr == (
        "error: backend 'broken' of broken:BACKEND (broken 1.0) cannot be loaded: ModuleNotFoundError: "
        "No module named 'no_such_package'\n"
    )


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


WIRING = {"channels": ["support_displacement"], "terminals": ["x"], "calibrations": ["laser_support.yaml"]}
OWN_SETTINGS = """
from typing import Literal
from atpid_driver.acquisition import Backend, setting
from atpid_driver.acquisition.settings import SimulatedSettings
from atpid_driver.acquisition.simulated import SimulatedAcquisition
class OwnSettings(SimulatedSettings):
    gain: float = setting(2.0, "gain of the amplifier", "1", 0.1, 100.0)
    filter: Literal["off", "on"] = setting("off", "low-pass filter")
BACKEND = Backend(OwnSettings, SimulatedAcquisition)
"""


def test_the_source_of_the_loop_takes_a_backend_of_an_entry_point(site: Path, bench: Bench) -> None:
    distribution(site, "registry_source", "own", OWN_SETTINGS)
    node = bench.start(LabJackNode, backend="own", rate=1000.0, handshake=False, gain=4.0, **WIRING)
    bench.until(lambda: bench.blocks)
    assert list(bench.blocks[0].channels) == ["support_displacement"]
    assert node.get_parameter("gain").value == 4.0
    assert node.describe_parameter("gain").description == "gain of the amplifier [1]"
    assert node.describe_parameter("filter").additional_constraints == "one of: off, on"


@pytest.mark.parametrize(("change", "text"), [({"gain": 0.0}, "gain"), ({"filter": "x"}, "allowed: 'off', 'on'")])
def test_a_setting_of_a_plug_in_out_of_its_range_is_refused(
    site: Path, bench: Bench, change: dict[str, object], text: str
) -> None:
    distribution(site, "registry_range", "own", OWN_SETTINGS)
    with pytest.raises(ParameterError, match=text):
        bench.start(LabJackNode, backend="own", rate=1000.0, **WIRING, **change)


def test_a_setting_that_is_no_parameter_is_refused(site: Path, bench: Bench) -> None:
    settings = OWN_SETTINGS.replace("gain: float = setting(2.0", "gain: complex = setting(2j")
    distribution(site, "registry_type", "own", settings.replace(', "1", 0.1, 100.0)', ")"))
    with pytest.raises(SetupRefusedError, match="setting gain of OwnSettings is no parameter: its type must be bool"):
        bench.start(LabJackNode, backend="own", rate=1000.0, **WIRING)
