# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Set-up from nothing, with its steps recorded; the real run comes before these tests."""

import contextlib
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest

import bootstrap
import machine

HERE = os.path.realpath(sys.executable)
PYTHON = machine.Interpreter("/usr/bin/python3", "3.12", "/usr")
LOCKS = "ros2_ws/requirements"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small copy of what set-up reads, with set-up pointed at it."""
    for package in bootstrap.PACKAGES:
        (tmp_path / package / "msg").mkdir(parents=True)
        (tmp_path / package / "package.xml").write_text("<package/>")
        (tmp_path / package / "msg" / "A.msg").write_text("float64 a # [m]\n")
    (tmp_path / LOCKS).mkdir(parents=True)
    for lock in ("backend", "wheels", "sourced", "tests"):
        (tmp_path / LOCKS / f"{lock}.txt").write_text(f"{lock}==1\n")
    for module in (bootstrap, machine):
        monkeypatch.setattr(module, "ROOT", tmp_path)
        monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
        monkeypatch.setattr(module, "WORKSPACE", tmp_path / "ros2_ws")
    monkeypatch.setattr(bootstrap, "LOG", tmp_path / "ros2_ws" / "setup.log")
    return tmp_path


class Steps:
    """Stands in for the steps of set-up: leaves behind what each would, and records it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.done: list[str] = []
        self.errors: dict[str, BaseException] = {}

    def __call__(self, command: list[str | Path], what: str, *_: object) -> None:
        words = [str(word) for word in command]
        shared = " shared" * ("--system-site-packages" in words)
        self.done.append(what + shared if what not in ("pip", "uv") else Path(words[words.index("-r") + 1]).stem)
        if what in self.errors:
            raise self.errors[what]
        (self.root / (".venv" if what == "venv" else "ros2_ws/install")).mkdir(parents=True, exist_ok=True)

    def taken(self) -> list[str]:
        """Set up; return the steps that this took."""
        self.done.clear()
        assert bootstrap.main() == 0
        return [*self.done]


@pytest.fixture
def steps(project: Path, monkeypatch: pytest.MonkeyPatch) -> Steps:
    recorder = Steps(project)
    monkeypatch.setattr(sys, "argv", ["bootstrap.py"])
    for name, instead in {
        "run": recorder,
        "repair_wheels": lambda venv: recorder.done.append("repair"),
        "choose": lambda requested, environment: (PYTHON, machine.Ros("wheels", "")),
        "kernels_beside": lambda environment: contextlib.nullcontext(),
        "require_machine": lambda *given: None,
        "require_disk": lambda: None,
    }.items():
        monkeypatch.setattr(bootstrap, name, instead)
    return recorder


BUILT = ["colcon build", "compiling bytecode"]
FULL = ["venv", "backend", "wheels", "repair", *BUILT]


@pytest.mark.parametrize(
    ("changed", "again", "from_nothing"),
    [
        (None, [], False),
        ("atpid_interfaces/atpid_interfaces/msg/A.msg", BUILT, True),
        ("atpid_sim/launch/bench.launch.py", BUILT, False),
        (f"{LOCKS}/wheels.txt", FULL, True),
    ],
)
def test_a_second_run_does_what_has_changed(
    steps: Steps, project: Path, changed: str | None, again: list[str], from_nothing: bool
) -> None:
    assert steps.taken() == FULL
    left = project / "ros2_ws/install/left-by-the-old-message"
    left.write_text("")
    if changed is not None:
        (project / changed).parent.mkdir(parents=True, exist_ok=True)
        (project / changed).write_text("another\n")
    assert steps.taken() == again
    assert left.exists() == (not from_nothing)


@pytest.mark.parametrize("step", ["venv", "colcon build"])
def test_an_interrupted_set_up_is_repaired(steps: Steps, step: str) -> None:
    steps.errors[step] = KeyboardInterrupt()
    assert bootstrap.main() == 130
    steps.errors.clear()
    assert steps.taken() == (BUILT if step == "colcon build" else FULL)


def test_a_sourced_jazzy_is_shared_and_gets_no_wheels(steps: Steps, monkeypatch: pytest.MonkeyPatch) -> None:
    sourced = machine.Ros("sourced", "/opt/ros/jazzy/rclpy/__init__.py")
    monkeypatch.setattr(bootstrap, "choose", lambda requested, environment: (PYTHON, sourced))
    assert steps.taken() == ["venv shared", "backend", "sourced", *BUILT]


def test_no_program_compiles_what_set_up_installed() -> None:
    code = (
        "import atpid_sim.commands.simulate, atpid_control.nodes.selector_node, importlib.util, pathlib, sys\n"
        "files = [getattr(module, '__file__', None) or '' for module in list(sys.modules.values())]\n"
        "installed = [file for file in files if 'site-packages' in file and file.endswith('.py')]\n"
        "cached = importlib.util.cache_from_source\n"
        "print(len(installed), *(file for file in installed if not pathlib.Path(cached(file)).exists()))"
    )
    ran = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True, check=True)
    installed, *uncompiled = ran.stdout.split()
    assert int(installed) > 500
    assert not uncompiled


def test_a_node_that_simulates_nothing_loads_neither_numba_nor_scipy() -> None:
    """They take longer to load than the rest of such a node."""
    nodes = ", ".join(f"atpid_control.nodes.{name}_node" for name in ("live", "recorder", "supervisor"))
    code = f"import {nodes}, sys; print({{'numba', 'scipy'}} & sys.modules.keys())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


def test_kernels_that_fail_beside_the_build_are_compiled_alone(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (project / ".venv/bin").mkdir(parents=True)
    (project / ".venv/bin/python").symlink_to(sys.executable)
    monkeypatch.setattr(bootstrap, "KERNELS", ("pass", "raise MemoryError"))
    with pytest.raises(machine.SetupError, match=r"kernels.* 1;"), bootstrap.kernels_beside(dict(os.environ)):
        (project / "built").mkdir()
    assert (project / "built").exists()
    assert "MemoryError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("environment", "requested", "words"),
    [
        ({"ROS_DISTRO": "humble"}, None, {"humble", "jazzy"}),
        ({"ROS_DISTRO": "jazzy"}, HERE, {HERE, "rclpy", "ros-jazzy-ros-base"}),
        ({}, "python-that-is-not-there", {"python-that-is-not-there", "3.10", "3.13", "python3-venv"}),
    ],
)
def test_what_does_not_fit_is_one_line(
    environment: dict[str, str], requested: str | None, words: set[str], tmp_path: Path
) -> None:
    given = {"PATH": str(tmp_path), "PYTHONPATH": str(tmp_path), "PYTHONNOUSERSITE": "1", **environment}
    with pytest.raises(machine.SetupError) as caught:
        machine.choose(requested, given)
    assert caught.value.status == 2
    assert words <= set(re.findall(r"[\w./-]*\w", str(caught.value)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("system", "source", "tools", "missing"),
    [
        ("x86_64", "sourced", (), "g++"),
        ("x86_64", "sourced", ("c++",), "make"),
        ("aarch64", "wheels", ("c++", "make"), "ros-jazzy-ros-base"),
    ],
)
def test_what_a_machine_lacks_is_named_with_its_package(
    system: str, source: str, tools: tuple[str, ...], missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "platform", types.SimpleNamespace(system=lambda: "Linux", machine=lambda: system))
    for tool in tools:
        (tmp_path / tool).write_text("#!/bin/sh\n")
        (tmp_path / tool).chmod(0o755)
    with pytest.raises(machine.SetupError, match=rf"install.*\b{re.escape(missing)}"):
        machine.require_machine(PYTHON, machine.Ros(source, "x"), {"PATH": str(tmp_path)})


@pytest.mark.parametrize("unfit", ["path", "disk"])
def test_a_place_that_does_not_do_is_refused_before_anything_is_made(
    unfit: str, steps: Steps, monkeypatch: pytest.MonkeyPatch, project: Path
) -> None:
    if unfit == "path":
        monkeypatch.setattr(bootstrap, "ROOT", project / "a b")
    else:
        monkeypatch.setattr(bootstrap, "require_disk", machine.require_disk)
        monkeypatch.setattr(machine, "DISK_NEEDED", 1e18)
    with pytest.raises(machine.SetupError, match="a b'" if unfit == "path" else r"1000000000\.0 GB") as caught:
        bootstrap.set_up(None)
    assert caught.value.status == 2
    assert steps.done == []


def test_a_disk_that_fills_up_is_one_line(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    writing = "open('/dev/full', 'wb', buffering=0).write(b'wheel')"
    with pytest.raises(machine.SetupError, match=r"disk is full.* 1\.4 GB .* GB free in /") as caught:
        bootstrap.run([sys.executable, "-c", writing], "pip", dict(os.environ))
    assert caught.value.status == 2
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(bootstrap, "set_up", lambda requested: Path("/dev/full").write_text("x"))  # as its log may
    assert bootstrap.main() == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_an_unreachable_index_is_one_line_and_an_unknown_failure_shows_its_last_lines(
    capsys: pytest.CaptureFixture[str],
) -> None:
    output = "WARNING: Failed to establish a new connection\nERROR: No matching distribution found for a==1"
    error = bootstrap.explain_failure("pip", output, 1)
    assert error.status == 2
    assert re.fullmatch(r".*\bindex\b.*\ba==1\b.*", str(error))
    assert capsys.readouterr().err == ""
    error = bootstrap.explain_failure("colcon build", "first\nerror: 1\n", 2)
    assert error.status == 1
    assert re.search(r"colcon build.*\b2\b.*setup\.log", str(error))
    assert capsys.readouterr().err.split() == ["first", "error:", "1"]


def test_the_wheels_get_this_machines_paths(tmp_path: Path) -> None:
    python = tmp_path / "bin/python"
    python.parent.mkdir()
    python.write_text("#!/bin/sh\necho /here/include\necho /here/numpy\n")
    python.chmod(0o755)
    cmake = tmp_path / "share/std_msgs/cmake/exportExport.cmake"
    cmake.parent.mkdir(parents=True)
    container = "/opt/python/cp312-cp312"
    built = f"{container}/include/python3.12;{container}/lib/python3.12/site-packages/numpy/_core/include;/usr/include"
    cmake.write_text(built)
    cached = tmp_path / "cached"
    os.link(cmake, cached)  # as an installer links its cache, which other clones with another Python share
    bootstrap.repair_wheels(tmp_path)
    assert cached.read_text() == built
    assert cmake.read_text() == "/here/include;/here/numpy;/usr/include"


@pytest.mark.parametrize("lock", ["backend", "browser", "docs", "import", "parquet", "tests", "wheels", "sourced"])
def test_every_locked_package_has_hashes_and_no_address(root: Path, lock: str) -> None:
    text = (root / LOCKS / f"{lock}.txt").read_text()
    entries = [entry for entry in re.split(r"\n(?=\S)", text) if not entry.startswith("#")]
    assert entries
    locked = re.compile(r"[a-z0-9.-]+==\S+( ; [^\\]+)? \\\n    --hash=sha256:")
    assert [entry for entry in entries if not locked.match(entry)] == []
    assert "://" not in text
    assert not re.search(r"^-|--(index|extra|find)", text, re.MULTILINE)
