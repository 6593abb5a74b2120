# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packages as ROS packages: their files agree, name every dependency and are found once."""

import ast
import functools
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml
from catkin_pkg.packages import find_packages
from colcon_workspace import PACKAGES, ROOT, clone, environment, run

from atpid_common.errors import EXTRAS

PYTHON_PACKAGES = [name for name in PACKAGES if name != "atpid_interfaces"]
#: rosdep's keys for Ubuntu 24.04 (rosdistro/rosdep/python.yaml), by module; ROS packages have their own name.
SAME = (
    "hypothesis", "jinja2", "matplotlib", "numba", "numpy", "packaging", "pandas", "pydantic", "pytest", "rich",
    "scipy", "serial", "tornado", "yaml",
)  # fmt: skip
KEYS = {name: f"python3-{name}" for name in SAME} | {"pydantic_core": "python3-pydantic"}
#: Modules that are asked for where they are used, by what pip calls them.
PIP_ONLY = {name: library.partition("[")[0] for name, library in EXTRAS.items() if name not in KEYS}
#: What is needed without an import: by `ros2 launch`, by the messages, by pytest as a plugin, and linters.
WITHOUT_IMPORT = {
    "ros2launch", "rosidl_default_runtime", "action_msgs", "std_msgs", "python3-pytest-timeout",
    "python3-pytest-rerunfailures", "ament_copyright", "ament_lint_auto", "ament_lint_common",
}  # fmt: skip


def folder_of(package: str) -> Path:
    return ROOT / PACKAGES[package]


def manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(folder_of(package) / "package.xml").getroot()


def declared(package: str, *kinds: str) -> set[str]:
    """Return the dependencies of these kinds, and what the comments name that rosdep does not know."""
    text = (folder_of(package) / "package.xml").read_text()
    pip_only = [name for names in re.findall(r"<!-- No rosdep key.*: (.+)\. -->", text) for name in names.split(", ")]
    return {str(tag.text) for kind in kinds for tag in manifest(package).iter(kind)} | set(pip_only)


@functools.cache
def nodes(path: Path) -> list[ast.AST]:
    """Return what a file imports, and its constants."""
    kept = (ast.Import, ast.ImportFrom, ast.Constant)
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kept)]


def imported(files: Iterable[Path]) -> set[str]:
    """Return the names of the modules that the files import from elsewhere."""
    found = set()
    for node in (node for path in files for node in nodes(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"_typeshed"}  # of type checkers only


def started(files: Iterable[Path]) -> set[str]:
    """Return the project's packages that the files name in a string: to start a node, or to find a file."""
    pattern = re.compile(rf"({'|'.join(PACKAGES)})(\.\w+)*")
    constants = (node.value for path in files for node in nodes(path) if isinstance(node, ast.Constant))
    matches = (pattern.fullmatch(value) for value in constants if isinstance(value, str))
    return {match[1] for match in matches if match}


def keys(modules: set[str]) -> set[str]:
    """Return what package.xml calls the modules."""
    return {KEYS.get(name) or PIP_ONLY.get(name, name) for name in modules}


@pytest.mark.parametrize("package", PACKAGES)
def test_what_is_imported_is_a_dependency_and_the_reverse(package: str) -> None:
    folder = folder_of(package)
    code = [*(folder / package).rglob("*.py"), *folder.glob("launch/*.py")]
    tests = [*folder.glob("test/*.py")]
    # pytest and hypothesis are for the package's pytest plugin, which only tests load
    needed = keys((imported(code) | started(code)) - {package, "pytest", "hypothesis"})
    # tests may import what others share, which lies in the repository and is no package
    shared = {
        path.stem
        for place in ("*/test/*.py", "*/*/test/*.py", "tests/*.py", "tests/*/*.py")
        for path in ROOT.glob(place)
    } | {"studies"}
    needed_for_tests = keys(imported(tests) - {path.stem for path in tests} - shared - {package})
    running, for_tests = declared(package, "depend", "exec_depend"), declared(package, "test_depend")
    assert needed - running == set()
    assert needed_for_tests - running - for_tests == set()
    known = needed | WITHOUT_IMPORT | set(PIP_ONLY.values())
    assert running - known == set()
    assert for_tests - known - needed_for_tests - {"python3-hypothesis"} == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_setup_and_changelog_agree(package: str) -> None:
    read = manifest(package)
    assert (read.findtext("name"), read.findtext("license")) == (package, "Apache-2.0")
    assert (folder_of(package) / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    changes = (folder_of(package) / "CHANGELOG.rst").read_text()
    version = re.findall(r"^(\S+) \(\d{4}-\d\d-\d\d\)\n-+$", changes, re.MULTILINE)[0]
    assert read.findtext("version") == version == yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    if package in PYTHON_PACKAGES:
        setup = (folder_of(package) / "setup.py").read_text()
        assert [name for name in ("version", "license") if f'{name}="{read.findtext(name)}"' not in setup] == []


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace of somebody's own, with a clone of the repository in it."""
    folder = tmp_path_factory.mktemp("workspace")
    clone(folder / "src" / "atpid")
    return folder


@pytest.mark.parametrize("place", [".", "src/atpid", "src/atpid/ros2_ws", "src/atpid/ros2_ws/src"])
def test_colcon_and_rosdep_find_every_package_once(place: str, workspace: Path) -> None:
    command = [sys.executable, "-m", "colcon", "--log-base", os.devnull, "list", "--names-only"]
    assert run(command, workspace / place, environment()).split() == sorted(PACKAGES)
    if place != "src/atpid/ros2_ws":  # where rosdep, which asks this function, is called with --from-paths src
        found = find_packages(str(workspace / place)).values()
        assert sorted(package.name for package in found) == sorted(PACKAGES)


@pytest.mark.parametrize(
    ("status", "command"),
    [(2, ["bash", "ros2_ws/activate"]), (2, ["sh", "ros2_ws/activate"]),
     (1, [sys.executable, "atpid_control/bin/atpid", "--help"])],
)  # fmt: skip
def test_a_shell_that_is_not_activated_is_named(status: int, command: list[str]) -> None:
    done = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert re.fullmatch(r".*\. ros2_ws/activate.*\n", done.stderr)


@pytest.mark.parametrize(("reach", "warnings"), [("LOCALHOST", 0), ("OFF", 0), ("SUBNET", 1)])
def test_a_range_beyond_this_machine_is_warned_of_where_ros_comes_from_wheels(reach: str, warnings: int) -> None:
    given = environment() | {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach}
    command = ["sh", "-c", ". ros2_ws/activate"]
    done = subprocess.run(command, cwd=ROOT, env=given, capture_output=True, text=True, check=True)
    wheels = (ROOT / ".venv/share/rclpy").is_dir()
    assert re.findall(r"RANGE=(\w+)", done.stderr) == [reach] * (warnings if wheels else 0)
    assert len(done.stderr.splitlines()) <= 1
