# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Set-up as pure functions and with its steps recorded instead of run; the real run comes before these tests."""

import contextlib
import importlib.metadata
import os
import pty
import re
import subprocess
import sys
import sysconfig
import types
from collections import defaultdict
from pathlib import Path

import pytest

import bootstrap
import machine
import progress

PACKAGES = bootstrap.PACKAGES
HERE = os.path.realpath(sys.executable)
PYTHON = machine.Interpreter("/usr/bin/python3", "3.12", "/usr")
WHEELS = machine.Ros("wheels", "")


def fake_rclpy(folder: Path) -> Path:
    """Make a folder that looks like a sourced installation's Python path."""
    package = folder / "rclpy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    return package / "__init__.py"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small copy of what set-up reads, with set-up pointed at it."""
    for package in PACKAGES:
        (tmp_path / package / "msg").mkdir(parents=True)
        (tmp_path / package / "package.xml").write_text("<package/>")
        (tmp_path / package / "msg" / "A.msg").write_text("float64 a # [m]\n")
    (tmp_path / "ros2_ws/requirements").mkdir(parents=True)
    for lock in ("backend", "wheels", "sourced"):
        (tmp_path / "ros2_ws/requirements" / f"{lock}.txt").write_text(f"{lock}==1\n")
    for module in (bootstrap, machine):
        monkeypatch.setattr(module, "ROOT", tmp_path)
        monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
        monkeypatch.setattr(module, "WORKSPACE", tmp_path / "ros2_ws")
    monkeypatch.setattr(bootstrap, "LOG", tmp_path / "ros2_ws" / "setup.log")
    return tmp_path


class Steps:
    """Stands in for `bootstrap.run`: leaves behind what the step would, and records it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.done: list[str] = []
        self.killed_at = ""
        self.fails_at = ""

    def __call__(
        self, command: list[str | Path], what: str, environment: dict[str, str], cwd: Path | None = None
    ) -> None:
        words = " ".join(map(str, command))
        self.done.append(
            f"venv {'shared' if '--system-site-packages' in words else 'alone'}" if what == "venv" else what
        )
        if what in ("pip", "uv"):
            self.done[-1] = next(word for word in words.split() if word.endswith(".txt"))
        if what == self.killed_at:
            raise KeyboardInterrupt
        if what == self.fails_at:
            raise machine.SetupError("it failed")
        (self.root / (".venv" if what == "venv" else "ros2_ws/install")).mkdir(parents=True, exist_ok=True)


@pytest.fixture
def steps(project: Path, monkeypatch: pytest.MonkeyPatch) -> Steps:
    recorder = Steps(project)
    monkeypatch.setattr(bootstrap, "run", recorder)
    monkeypatch.setattr(bootstrap, "repair_wheels", lambda venv: recorder.done.append("repair"))
    monkeypatch.setattr(bootstrap, "choose", lambda requested, environment: (PYTHON, WHEELS))
    monkeypatch.setattr(bootstrap, "kernels_beside", lambda environment: contextlib.nullcontext())
    monkeypatch.setattr(bootstrap, "require_machine", lambda *given: None)
    monkeypatch.setattr(bootstrap, "require_disk", lambda: None)
    return recorder


FULL = ["venv alone", "ros2_ws/requirements/backend.txt", "ros2_ws/requirements/wheels.txt", "repair", "colcon build"]


def test_a_second_run_does_nothing(steps: Steps) -> None:
    bootstrap.set_up(None)
    assert steps.done == FULL
    bootstrap.set_up(None)
    assert steps.done == FULL


@pytest.mark.parametrize("step", ["venv", "pip", "colcon build"])
def test_an_interrupted_set_up_is_repaired(steps: Steps, step: str) -> None:
    steps.killed_at = step
    with pytest.raises(KeyboardInterrupt):
        bootstrap.set_up(None)
    steps.killed_at = ""
    steps.done.clear()
    bootstrap.set_up(None)
    assert steps.done == (["colcon build"] if step == "colcon build" else FULL)


def test_where_uv_cannot_install_pip_does(steps: Steps, capsys: pytest.CaptureFixture[str]) -> None:
    steps.fails_at = "uv"
    bootstrap.set_up(None)
    assert steps.done == [*FULL[:3], FULL[2], *FULL[3:]]
    assert "uv could not install them, pip does" in capsys.readouterr().out


def test_what_is_asked_for_beside_is_installed_once_for_each_environment(
    steps: Steps, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = project / "ros2_ws/requirements/tests.txt"
    lock.write_text("tests==1\n")
    monkeypatch.setattr(sys, "argv", ["bootstrap.py", "tests"])
    for _ in range(2):
        assert bootstrap.main() == 0
        assert steps.done == [*FULL, "ros2_ws/requirements/tests.txt"]
    lock.write_text("tests==2\n")
    steps.done.clear()
    assert bootstrap.main() == 0
    assert steps.done == ["ros2_ws/requirements/tests.txt"]
    (project / "ros2_ws/requirements/wheels.txt").write_text("wheels==2\n")
    steps.done.clear()
    assert bootstrap.main() == 0
    assert steps.done == [*FULL, "ros2_ws/requirements/tests.txt"]


def test_uv_gets_the_index_that_pip_has(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = (
        "global.cert='/etc/own.crt'\nglobal.index-url='https://mirror/simple'\n:env:.extra-index-url='file:///disk'\n"
        "global.proxy='http://proxy:3128'"
    )
    monkeypatch.setattr(bootstrap, "output_of", lambda command, environment: listed)
    settings = bootstrap.uv_settings({"SSL_CERT_FILE": "/mine.crt"})
    assert settings == {
        "VIRTUAL_ENV": str(project / ".venv"),
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_DEFAULT_INDEX": "https://mirror/simple",
        "ALL_PROXY": "http://proxy:3128",
    }


@pytest.fixture
def python_of_venv(project: Path) -> None:
    (project / ".venv/bin").mkdir(parents=True)
    (project / ".venv/bin/python").symlink_to(sys.executable)


@pytest.mark.usefixtures("python_of_venv")
def test_kernels_that_fail_beside_the_build_are_compiled_alone(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bootstrap, "KERNELS", ("pass", "raise MemoryError"))
    failure = pytest.raises(machine.SetupError, match="compiling the kernels ended with status 1")
    with failure, bootstrap.kernels_beside(dict(os.environ)):
        (project / "built").mkdir()
    assert (project / "built").exists()
    assert "MemoryError" in capsys.readouterr().err


@pytest.mark.usefixtures("python_of_venv")
def test_a_build_that_fails_ends_the_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bootstrap, "KERNELS", ("import time; time.sleep(1000)",))
    with pytest.raises(machine.SetupError, match="it failed"), bootstrap.kernels_beside(dict(os.environ)):
        raise machine.SetupError("it failed")  # and the test ends


@pytest.mark.slow
@pytest.mark.parametrize("code", bootstrap.KERNELS)
def test_the_kernels_of_set_up_are_compiled_without_ros(code: str) -> None:
    packages = os.pathsep.join(str(machine.ROOT / package) for package in PACKAGES[1:])
    unset = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH")
    environment = {name: value for name, value in os.environ.items() if name not in unset} | {"PYTHONPATH": packages}
    subprocess.run([sys.executable, "-c", code], cwd=machine.ROOT, env=environment, check=True)


def test_changed_messages_are_built_from_nothing(steps: Steps, project: Path) -> None:
    bootstrap.set_up(None)
    left = project / "ros2_ws/install/left-by-the-old-message"
    left.write_text("")
    (project / "atpid_interfaces/atpid_interfaces/msg/A.msg").write_text("float64 b # [m]\n")
    bootstrap.set_up(None)
    assert steps.done == [*FULL, "colcon build"]
    assert not left.exists()


def test_a_new_launch_file_is_linked_by_a_short_build(steps: Steps, project: Path) -> None:
    bootstrap.set_up(None)
    kept = project / "ros2_ws/install/kept"
    kept.write_text("")
    (project / "atpid_sim/launch").mkdir()
    (project / "atpid_sim/launch/bench.launch.py").write_text("")
    bootstrap.set_up(None)
    assert steps.done == [*FULL, "colcon build"]
    assert kept.exists()


def test_a_new_file_in_a_folder_of_a_folder_is_linked(steps: Steps, project: Path) -> None:
    bootstrap.set_up(None)
    (project / "atpid_sim/config/calibration").mkdir(parents=True)
    (project / "atpid_sim/config/calibration/laser.yaml").write_text("")
    bootstrap.set_up(None)
    assert steps.done == [*FULL, "colcon build"]


def test_built_firmware_is_no_change(steps: Steps, project: Path) -> None:
    bootstrap.set_up(None)
    (project / "atpid_driver/firmware/build").mkdir(parents=True)
    (project / "atpid_driver/firmware/build/motor.elf").write_text("")
    bootstrap.set_up(None)
    assert steps.done == FULL


def test_a_new_lock_makes_a_new_environment(steps: Steps, project: Path) -> None:
    bootstrap.set_up(None)
    (project / "ros2_ws/requirements/wheels.txt").write_text("wheels==2\n")
    bootstrap.set_up(None)
    assert steps.done == FULL * 2


def test_a_sourced_jazzy_is_shared_and_gets_no_wheels(steps: Steps, monkeypatch: pytest.MonkeyPatch) -> None:
    sourced = machine.Ros("sourced", "/opt/ros/jazzy/rclpy/__init__.py")
    monkeypatch.setattr(bootstrap, "choose", lambda requested, environment: (PYTHON, sourced))
    bootstrap.set_up(None)
    assert steps.done == [
        "venv shared",
        "ros2_ws/requirements/backend.txt",
        "ros2_ws/requirements/sourced.txt",
        "colcon build",
    ]


def test_a_folder_with_a_space_is_refused(steps: Steps, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bootstrap, "ROOT", project / "a b")
    with pytest.raises(machine.SetupError, match="space in its path"):
        bootstrap.set_up(None)
    assert steps.done == []


def test_a_sourced_jazzy_is_found_by_the_python_that_imports_it(tmp_path: Path) -> None:
    rclpy = fake_rclpy(tmp_path / "jazzy")
    environment = {"PATH": "/usr/bin:/bin", "ROS_DISTRO": "jazzy", "PYTHONPATH": str(tmp_path / "jazzy")}
    python, ros = machine.choose(HERE, environment)
    assert ros == ("sourced", str(rclpy))
    assert python.version == f"{sys.version_info.major}.{sys.version_info.minor}"


def test_an_overlay_does_not_change_the_key(tmp_path: Path) -> None:
    rclpy = fake_rclpy(tmp_path / "jazzy")
    (tmp_path / "overlay").mkdir()
    environment = {"PATH": "/usr/bin:/bin", "ROS_DISTRO": "jazzy", "PYTHONPATH": f"{tmp_path}/overlay:{tmp_path}/jazzy"}
    assert machine.choose(HERE, environment)[1].rclpy == str(rclpy)


@pytest.mark.parametrize(
    ("environment", "requested", "message"),
    [
        ({"ROS_DISTRO": "humble"}, None, "ROS humble is sourced"),
        ({"ROS_DISTRO": "jazzy"}, HERE, "cannot import the sourced rclpy"),
        ({}, "python-that-is-not-there", "python-that-is-not-there not found"),
    ],
)
def test_what_does_not_fit_is_one_line(
    environment: dict[str, str], requested: str | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(machine.SetupError, match=message) as caught:
        machine.choose(
            requested, {"PATH": str(tmp_path), "PYTHONPATH": str(tmp_path), "PYTHONNOUSERSITE": "1", **environment}
        )
    assert caught.value.status == 2
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("tools", "missing"), [((), "g[+][+]"), (("c++",), "make")])
def test_missing_tools_are_named_with_their_package(tmp_path: Path, tools: tuple[str, ...], missing: str) -> None:
    for tool in tools:
        (tmp_path / tool).write_text("#!/bin/sh\n")
        (tmp_path / tool).chmod(0o755)
    with pytest.raises(machine.SetupError, match=f"sudo apt install {missing}$"):
        machine.require_machine(PYTHON, machine.Ros("sourced", "x"), {"PATH": str(tmp_path)})


def test_on_another_processor_ros_has_to_be_sourced(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = types.SimpleNamespace(system=lambda: "Linux", machine=lambda: "aarch64")
    monkeypatch.setattr(machine, "platform", fake)
    with pytest.raises(machine.SetupError, match="Linux on aarch64: install ROS 2 Jazzy"):
        machine.require_machine(PYTHON, WHEELS, {"PATH": "/usr/bin:/bin"})


def test_an_activated_shell_finds_what_a_fresh_one_does() -> None:
    paths = f"{machine.VENV}/bin:/usr/bin:{machine.WORKSPACE}/install/atpid_sim:/opt/ros/jazzy:{machine.VENV}"
    assert machine.foreign_paths(paths) == "/usr/bin:/opt/ros/jazzy"


def test_an_unreachable_index_is_one_line() -> None:
    output = (
        "WARNING: Retrying ... Failed to establish a new connection\nERROR: No matching distribution found for a==1"
    )
    error = bootstrap.explain_failure("pip", output, 1)
    assert error.status == 2
    assert "package index (a==1 was not found): connect this machine" in str(error)


def test_an_unknown_failure_shows_its_last_lines(capsys: pytest.CaptureFixture[str]) -> None:
    error = bootstrap.explain_failure("colcon build", "first\nthe compiler says no\n", 2)
    assert error.status == 1
    assert "colcon build ended with status 2" in str(error)
    assert "the compiler says no" in capsys.readouterr().err


def test_the_first_line_names_what_set_up_needs(steps: Steps, capsys: pytest.CaptureFixture[str]) -> None:
    bootstrap.set_up(None)
    first = capsys.readouterr().out.splitlines()[0]
    assert first == "set-up: Python 3.12, ROS 2 Jazzy from its wheels (Linux on x86_64 only), 1.4 GB of disk"


def test_a_disk_without_room_is_refused_before_anything_is_made(
    steps: Steps, monkeypatch: pytest.MonkeyPatch, project: Path
) -> None:
    monkeypatch.setattr(bootstrap, "require_disk", machine.require_disk)
    monkeypatch.setattr(machine, "DISK_NEEDED", 1e18)
    with pytest.raises(
        machine.SetupError, match=r"^set-up needs 1000000000\.0 GB in .* GB are free: make room"
    ) as caught:
        bootstrap.set_up(None)
    assert caught.value.status == 2
    assert steps.done == []


def test_a_disk_that_fills_up_is_one_line(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writing = "open('/dev/full', 'wb', buffering=0).write(b'wheel')"
    with pytest.raises(machine.SetupError, match=r"a disk is full; it needs 1\.4 GB .* GB free in /") as caught:
        bootstrap.run([sys.executable, "-c", writing], "pip", dict(os.environ))
    assert caught.value.status == 2
    assert capsys.readouterr().err == ""


def test_a_disk_too_full_for_the_log_is_one_line(
    steps: Steps, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bootstrap, "set_up", lambda requested: Path("/dev/full").write_text("x"))
    assert bootstrap.main() == 2
    assert "a disk is full" in capsys.readouterr().err


def test_steps_without_a_terminal_are_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.step("making it"):
        pass
    assert capsys.readouterr().out == "  making it ... 0 s\n"


@pytest.mark.slow
def test_on_a_terminal_the_seconds_are_counted() -> None:
    code = "import sys, progress\nwith progress.step('making it'): sys.stdin.readline()"
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", code]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=theirs, cwd=machine.WORKSPACE)
    os.close(theirs)
    seen = b""
    while not seen.endswith(b"... 2 s"):
        seen += os.read(ours, 1000)
    process.communicate(b"\n")
    with contextlib.suppress(OSError):  # as a terminal ends whose last writer has gone
        while rest := os.read(ours, 1000):
            seen += rest
    os.close(ours)
    assert process.returncode == 0
    assert re.fullmatch(rb"  making it \.\.\.(\r  making it \.\.\.( \d s)?)*( \d s)?\r\n", seen)


def test_the_wheels_get_this_machines_paths(tmp_path: Path) -> None:
    python = tmp_path / "bin/python"
    python.parent.mkdir()
    python.write_text("#!/bin/sh\necho /here/include\necho /here/numpy\n")
    python.chmod(0o755)
    cmake = tmp_path / "share/std_msgs/cmake/exportExport.cmake"
    cmake.parent.mkdir(parents=True)
    container = "/opt/python/cp312-cp312"
    cmake.write_text(
        f'"{container}/include/python3.12;{container}/lib/python3.12/site-packages/numpy/_core/include;/usr/include"'
    )
    cached = tmp_path / "cached"
    os.link(cmake, cached)  # as an installer links its cache, which other clones with another Python share
    bootstrap.repair_wheels(tmp_path)
    assert container in cached.read_text()
    assert cmake.read_text() == '"/here/include;/here/numpy;/usr/include"'


@pytest.mark.parametrize("lock", ["backend", "browser", "docs", "import", "parquet", "tests", "wheels", "sourced"])
def test_every_locked_package_has_hashes_and_no_address(root: Path, lock: str) -> None:
    text = (root / "ros2_ws/requirements" / f"{lock}.txt").read_text()
    entries = [entry for entry in re.split(r"\n(?=\S)", text) if not entry.startswith("#")]
    assert entries
    for entry in entries:
        assert re.match(r"[a-z0-9.-]+==\S+( ; [^\\]+)? \\\n    --hash=sha256:", entry), entry
    assert "://" not in text
    assert not re.search(r"^-|--(index|extra|find)", text, re.MULTILINE)


def test_no_module_of_the_environment_is_of_two_packages() -> None:
    """Which of them is installed last is chance."""
    contents = defaultdict(set)
    for package in importlib.metadata.distributions(path=[sysconfig.get_path("purelib")]):
        for file in package.files or ():
            if file.suffix == ".py" and file.hash is not None:
                contents[str(file)].add(file.hash.value)
    assert contents
    assert not [file for file, hashes in contents.items() if len(hashes) > 1]
