# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A plain `colcon build` of a clone and its tests, in a user's order; those below `removed` have no sources."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import rclpy
from colcon_workspace import PACKAGES, ROOT, clone, differences, environment, run, sourced
from graph_runs import scene_file, wait_until

from atpid_control.stand.processes import START_NODE
from atpid_driver.emulator import missing_tools

pytestmark = [pytest.mark.timeout(1200)]  # of the build and of all packages' tests
COLCON = [sys.executable, "-m", "colcon"]
IMPORT_ALL = """
import importlib, os, pkgutil, sys
sys.modules.update(dict.fromkeys(os.environ["HIDDEN"].split()))  # they cannot be imported
for name in sys.argv[1:]:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, name + "."):
        if module.name.endswith("__main__"):
            continue
        try:
            print(importlib.import_module(module.name).__file__)
        except ModuleNotFoundError as error:  # the wheels have no launch; one module is a plugin of pytest
            if error.name.partition(".")[0] not in ("launch", "launch_ros", "hypothesis"):
                raise
import atpid_control, atpid_sim
assert atpid_sim.open_run is atpid_control.open_run  # what a package adds to the physics
"""
MESSAGES = "atpid_interfaces"
#: Whether `make test-install` runs this: with the messages, C++ for them too, and all of the packages' tests.
EVERYTHING = os.environ.get("ATPID_COLCON_TESTS") == "all"
#: Else the tests of these files only.
FILES = "test_*parameters.py test_copyright_*.py test_hostile_files.py test_channel_state.py"
#: What each executable needs to stay; `{}` is the folder of the inputs.
EXECUTABLES = {
    ("atpid_sim", "plant_node"): ["plant.yaml", "scene:={}/scene.yaml"],
    ("atpid_driver", "labjack_node"): ["labjack.yaml", "backend:=simulated"],
    ("atpid_driver", "ni_node"): ["ni.yaml", "backend:=simulated"],
    ("atpid_driver", "acquisition_node"): [
        "labjack.yaml", "backend:=simulated", "rate:=1000.0", "channels:=[support_displacement]", "terminals:=[x]",
        "calibrations:=[laser_support.yaml]",
    ],
    ("atpid_driver", "feed_node"): ["labjack.yaml", "feed:={}/feed", "calibrations:=[laser_beam.yaml]"],
    ("atpid_driver", "motor_node"): ["motor.yaml"],
    ("atpid_exciter", "excitation_node"): ["excitation.yaml", "backend:=simulated"],
    ("atpid_control", "identifier_node"): ["identifier.yaml"],
    ("atpid_control", "selector_node"): ["selector.yaml", "scene:={}/scene.yaml", "map:={}/map.npz"],
    ("atpid_control", "live_node"): ["live.yaml", "port:=0"],
    ("atpid_control", "recorder_node"): ["recorder.yaml", "bag:={}/new_bag", "scene:={}/scene.yaml"],
    ("atpid_control", "supervisor_node"): ["supervisor.yaml"],
    ("atpid_control", "replay_node"): ["recorder.yaml", "bag:={}/out/bag"],
    ("atpid_lab", "foxglove_node"): ["", "port:=0"],
}  # fmt: skip


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace of a user's own with a clone in it, built without links to the sources."""
    folder = tmp_path_factory.mktemp("workspace")
    clone(folder / "src" / "atpid")
    # the messages as set-up has built them by colcon from the same sources, unless all is asked for: they take most of
    # the time; with symbolic links followed
    only = [] if EVERYTHING else ["--packages-skip", MESSAGES]
    if not EVERYTHING:
        shutil.copytree(ROOT / "ros2_ws/install" / MESSAGES, folder / "install" / MESSAGES)
    assert "Finished <<< atpid_control" in run([*COLCON, "build", *only], folder, environment())
    return folder


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a user brings along: a scene and a map."""
    folder = tmp_path_factory.mktemp("inputs")
    scene_file(ROOT / "scenes/thesis_4_3.yaml", folder, duration=2.0, steady_window=[1.0, 2.0])
    shutil.copy(ROOT / "atpid_control/config/maps/standard.npz", folder / "map.npz")
    return folder


@pytest.fixture(scope="module")
def removed(workspace: Path) -> Path:
    """The workspace with nothing but what is installed."""
    for name in ("src", "build", "log"):
        shutil.rmtree(workspace / name)
    return workspace


@pytest.fixture(scope="module")
def shell(removed: Path) -> dict[str, str]:
    """The environment of a shell that has sourced the installation."""
    return sourced(removed)


@pytest.fixture(scope="module")
def recorded(shell: dict[str, str], inputs: Path) -> Path:
    """The folder of a run of the installed bench."""
    command = ["atpid", "bench", str(inputs / "scene.yaml")]
    run([*command, "--out", str(inputs / "out")], inputs, shell)
    return inputs / "out"


def test_every_file_is_installed(workspace: Path) -> None:
    install = workspace / "install"
    assert {package: found for package in PACKAGES if (found := differences(package, install / package))} == {}
    shared = list(install.glob("*/share/atpid_*/**/"))
    assert [folder for folder in shared if not any(folder.iterdir())] == []
    assert [path for package in PACKAGES for path in (install / package).rglob("*") if path.is_symlink()] == []


def test_colcon_test_runs_the_tests_and_counts_them(workspace: Path) -> None:
    # `make test` has run them from the repository: here a part, unless all are asked for, as by `make test-install`;
    # colcon takes off the blank before a dash
    part = ["--packages-skip", MESSAGES, "--pytest-args", " -o", f"python_files={FILES}"]
    command = [*COLCON, "test", "--return-code-on-test-failure", *([] if EVERYTHING else part)]
    run(command, workspace, environment())
    *files, _, summary = run([*COLCON, "test-result", "--all"], workspace, environment()).splitlines()
    counts = {file.split("/")[1]: int(file.split()[1]) for file in files}
    assert counts.keys() == set(PACKAGES) - {MESSAGES}  # which has no tests
    assert min(counts.values()) > 0
    assert re.search(r" 0 errors, 0 failures, ", summary)


def test_every_module_loads_without_what_only_tests_need(removed: Path, shell: dict[str, str], tmp_path: Path) -> None:
    lock = (ROOT / "ros2_ws/requirements/tests.txt").read_text()
    locked = set(re.findall(r"^([a-z0-9-]+)==", lock, re.MULTILINE))
    made_by = packages_distributions().items()
    hidden = [name for name, makers in made_by if {re.sub("[_.]", "-", maker.lower()) for maker in makers} <= locked]
    assert {"hypothesis", "distributed"} <= {*hidden}
    modules = [name for name in PACKAGES if name != MESSAGES]
    environment = {**shell, "HIDDEN": " ".join(hidden)}
    files = run([sys.executable, "-c", IMPORT_ALL, *modules], tmp_path, environment).splitlines()
    assert len(files) > 200
    assert [file for file in files if not file.startswith(f"{removed}/install/")] == []


@pytest.mark.usefixtures("recorded")  # in `inputs`
def test_every_executable_starts_and_ends(removed: Path, shell: dict[str, str], inputs: Path, tmp_path: Path) -> None:
    """However often and by whichever signal it is asked: status 0, and nothing printed that looks like a failure."""
    context = rclpy.Context()
    context.init()
    observer = rclpy.create_node("observer", context=context)
    install = removed / "install"
    found = {(path.parent.name, path.name) for path in install.glob("*/lib/atpid_*/*")}
    assert found == {*EXECUTABLES}
    processes = {}

    def names() -> set[str]:
        return set(observer.get_node_names())

    try:
        for (package, name), (file, *values) in EXECUTABLES.items():
            command = [*START_NODE, str(install / package / "lib" / package / name)]  # as the bench does
            command += ["--ros-args", "-r", f"__ns:=/{name}"]
            if file:
                command += ["--params-file", str(install / package / "share" / package / "config" / file)]
            command += [word for value in values for word in ("-p", value.format(inputs))]
            with (tmp_path / name).open("w") as log:
                processes[name] = subprocess.Popen(command, cwd=tmp_path, env=shell, stdout=log, stderr=log)
        wait_until(lambda: processes.keys() <= names() or any(one.poll() is not None for one in processes.values()))
        assert processes.keys() <= names()
    finally:
        for process in processes.values():
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGINT):
                process.send_signal(number)
        statuses = {name: process.wait() for name, process in processes.items()}
        observer.destroy_node()
        context.shutdown()
    printed = {name: (tmp_path / name).read_text() for name in processes}
    words = ("Traceback", "Exception ignored", "error")
    failed = [name for name in processes if statuses[name] or any(word in printed[name] for word in words)]
    assert failed == [], [(name, statuses[name], printed[name]) for name in failed]


def test_the_bench_makes_its_report(removed: Path, shell: dict[str, str], recorded: Path) -> None:
    # by the executable of the launch files as well
    assert "--params-file" in run([removed / "install/atpid_control/bin/atpid", "stand", "--help"], ROOT, shell)
    assert json.loads((recorded / "summary.json").read_text())["stages"]
    assert (recorded / "report.html").is_file()


def test_stand_ins_firmware_and_emulator_compile(shell: dict[str, str], tmp_path: Path) -> None:
    run(["atpid", "standin"], tmp_path, {**shell, "XDG_CACHE_HOME": str(tmp_path)})
    assert {path.name for path in tmp_path.rglob("*.so")} == {"libLabJackM.so", "libnidaqmx.so"}
    if missing := missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        pytest.skip(f"needs {', '.join(missing)}")
    code = "from atpid_driver.emulator import build_emulator as e, build_firmware as f; print(e(), f())"
    made = run([sys.executable, "-c", code], tmp_path, {**shell, "XDG_CACHE_HOME": str(tmp_path)}).split()
    assert all(Path(path).is_relative_to(tmp_path) for path in made), "built into the installation"
