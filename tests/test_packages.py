# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packages as ROS packages: their files agree, name every dependency, install whole and are found once."""

import ast
import functools
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
import yaml
from catkin_pkg.packages import find_packages
from colcon_workspace import PACKAGES, ROOT, clone, differences, environment, run, sources

from atpid_common.errors import EXTRAS

PYTHON_PACKAGES = [name for name in PACKAGES if name != "atpid_interfaces"]
#: rosdep's keys for Ubuntu 24.04 (rosdistro/rosdep/python.yaml), by module; ROS packages have their own name.
KEYS = {
    "hypothesis": "python3-hypothesis",
    "jinja2": "python3-jinja2",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "packaging": "python3-packaging",
    "pandas": "python3-pandas",
    "pydantic": "python3-pydantic",
    "pydantic_core": "python3-pydantic",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "tornado": "python3-tornado",
    "yaml": "python3-yaml",
}
#: Modules that are asked for where they are used, by what pip calls them.
PIP_ONLY = {name: library.partition("[")[0] for name, library in EXTRAS.items() if name not in KEYS}
#: What is needed without an import: by `ros2 launch`, by the messages, by pytest as a plugin, and linters.
WITHOUT_IMPORT = {
    "ros2launch", "rosidl_default_runtime", "action_msgs", "std_msgs", "python3-pytest-timeout",
    "ament_copyright", "ament_lint_auto", "ament_lint_common",
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
    for path in files:
        for node in nodes(path):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"_typeshed"}  # of type checkers only


def started(files: Iterable[Path]) -> set[str]:
    """Return the project's packages that the files name in a string: to start a node, or to find a file."""
    pattern = re.compile(rf"({'|'.join(PACKAGES)})(\.\w+)*")
    constants = (node.value for path in files for node in nodes(path) if isinstance(node, ast.Constant))
    strings = (value for value in constants if isinstance(value, str))
    return {match[1] for match in map(pattern.fullmatch, strings) if match}


def keys(modules: set[str]) -> set[str]:
    """Return what package.xml calls the modules."""
    return {KEYS.get(name) or PIP_ONLY.get(name, name) for name in modules}


def needed(package: str) -> set[str]:
    """Return what the package needs to run. pytest and hypothesis are for its pytest plugin, which only tests load."""
    files = list(code_of(package))
    modules = imported(files) | started(files)
    return keys(modules - {package, "pytest", "hypothesis"})


def needed_for_tests(package: str) -> set[str]:
    files = list(folder_of(package).glob("test/*.py"))
    return keys(imported(files) - {path.stem for path in files} - {package})


def code_of(package: str) -> Iterator[Path]:
    yield from (folder_of(package) / package).rglob("*.py")
    yield from folder_of(package).glob("launch/*.py")


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_setup_and_changelog_agree(package: str) -> None:
    read = manifest(package)
    assert read.get("format") == "3"
    assert read.findtext("name") == package
    assert read.findtext("version") == "1.0.0"
    assert read.findtext("license") == "Apache-2.0"
    assert {url.get("type") for url in read.iter("url")} == {"website", "repository", "bugtracker"}
    newest = re.findall(r"^(\S+) \((\d{4}-\d\d-\d\d)\)\n-+$", (folder_of(package) / "CHANGELOG.rst").read_text(), re.M)[
        0
    ]
    assert newest[0] == read.findtext("version")
    if package in PYTHON_PACKAGES:
        setup = (folder_of(package) / "setup.py").read_text()
        for name, tag in (("version", "version"), ("license", "license"), ("maintainer", "maintainer")):
            assert f'{name}="{read.findtext(tag)}"' in setup
        assert f'maintainer_email="{next(read.iter("maintainer")).get("email")}"' in setup


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_can_go_alone(package: str) -> None:
    assert (folder_of(package) / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    readme = (folder_of(package) / "README.md").read_text()
    assert readme.startswith(f"# {package}\n")
    assert "Copyright" in readme
    assert "Quality Level" in (folder_of(package) / "QUALITY_DECLARATION.md").read_text()
    if package != "atpid_interfaces":  # which has no tests of its own
        assert (folder_of(package) / "pytest.ini").read_text() == (ROOT / "atpid_sim/pytest.ini").read_text()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_import_is_a_dependency(package: str) -> None:
    running = declared(package, "depend", "exec_depend")
    assert needed(package) - running == set()
    assert needed_for_tests(package) - running - declared(package, "test_depend") == set()


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_every_dependency_is_needed(package: str) -> None:
    running = declared(package, "depend", "exec_depend")
    known = needed(package) | WITHOUT_IMPORT | set(PIP_ONLY.values())
    assert running - known == set()
    assert declared(package, "test_depend") - known - needed_for_tests(package) - {"python3-hypothesis"} == set()


def test_every_node_has_its_analyzer() -> None:
    """diagnostic_aggregator puts what no analyzer takes under Other."""
    text = (folder_of("atpid_control") / "config/diagnostics.yaml").read_text()
    (parameters,) = (block["ros__parameters"] for block in yaml.safe_load(text).values())
    taken = [name for analyzer in parameters.values() if isinstance(analyzer, dict) for name in analyzer["contains"]]
    scripts = (folder_of(package) / package / "executables.py" for package in PYTHON_PACKAGES)
    nodes = re.findall(r"\.nodes\.(\w+)\"", "".join(path.read_text() for path in scripts if path.exists()))
    assert sorted(taken) == sorted(f"{node}: " for node in nodes)


def test_every_source_file_names_its_licence() -> None:
    endings = {".py", ".c", ".h", ".cpp", ".xml", ".toml", ".ini"}
    named = [path for path in sources() if path.suffix in endings or path.name in ("Makefile", "CMakeLists.txt")]
    assert [str(path) for path in named if "SPDX-License-Identifier: Apache-2.0" not in read(path)] == []


def test_every_file_of_code_has_the_notice_that_ament_copyright_reads() -> None:
    notice = re.compile(r"^(#|//) Copyright \d{4} ATPID maintainers\n\1 SPDX-License-Identifier: Apache-2\.0$", re.M)
    code = [path for path in sources() if path.suffix in (".py", ".c", ".h", ".cpp") and read(path)]
    assert [str(path) for path in code if not notice.search(read(path)[:300])] == []


def read(path: Path) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def cloned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone whose packages set-ups build in."""
    return clone(tmp_path_factory.mktemp("setup") / "clone")


@pytest.mark.slow
@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_setup_installs_every_file(package: str, cloned: Path, tmp_path: Path) -> None:
    folder, prefix = cloned / PACKAGES[package], tmp_path / "prefix"
    command = [sys.executable, "setup.py", "-q", "install", f"--prefix={prefix}", "--single-version-externally-managed"]
    run([*command, f"--record={tmp_path / 'record'}"], folder, {**os.environ, "PYTHONWARNINGS": "ignore"})
    assert differences(package, prefix) == []


@pytest.mark.slow
def test_what_a_package_adds_to_the_physics_is_there(tmp_path: Path) -> None:
    run(
        [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(tmp_path)],
        folder_of("atpid_control"),
        dict(os.environ),
    )
    text = "import atpid_sim, atpid_control; assert atpid_sim.open_run is atpid_control.open_run"
    given = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
    run([sys.executable, "-c", text], tmp_path, given)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace of somebody's own, with a clone of the repository in it."""
    folder = tmp_path_factory.mktemp("workspace")
    clone(folder / "src" / "atpid")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("place", [".", "src", "src/atpid", "src/atpid/ros2_ws", "src/atpid/ros2_ws/src"])
def test_colcon_finds_every_package_once(place: str, workspace: Path) -> None:
    command = [sys.executable, "-m", "colcon", "--log-base", os.devnull, "list", "--names-only"]
    assert run(command, workspace / place, environment()).split() == sorted(PACKAGES)


@pytest.mark.parametrize("place", [".", "src", "src/atpid", "src/atpid/ros2_ws/src"])
def test_rosdep_finds_every_package_once(place: str, workspace: Path) -> None:
    # rosdep asks this function; within ros2_ws it is called with --from-paths src
    assert sorted(package.name for package in find_packages(str(workspace / place)).values()) == sorted(PACKAGES)


def test_the_workspace_links_to_the_packages() -> None:
    links = {path.name: path.readlink() for path in (ROOT / "ros2_ws/src").iterdir()}
    folders = {folder.partition("/")[0] for folder in PACKAGES.values()}
    assert links == {folder: Path("../..") / folder for folder in folders}


@pytest.mark.parametrize("shell", ["bash", "sh"])
def test_activate_asks_to_be_sourced(shell: str) -> None:
    done = subprocess.run([shell, "ros2_ws/activate"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "this file changes the shell that reads it, so it has to be sourced: . ros2_ws/activate\n"


@pytest.mark.parametrize(("reach", "warnings"), [("LOCALHOST", 0), ("OFF", 0), ("SUBNET", 1)])
def test_a_range_beyond_this_machine_is_warned_of_where_ros_comes_from_wheels(reach: str, warnings: int) -> None:
    given = environment() | {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach}
    command = ["sh", "-c", ". ros2_ws/activate"]
    done = subprocess.run(command, cwd=ROOT, env=given, capture_output=True, text=True, check=True)
    wheels = (ROOT / ".venv/share/rclpy").is_dir()
    assert done.stderr.count(f"DISCOVERY_RANGE={reach} goes beyond this machine") == (warnings if wheels else 0)
    assert len(done.stderr.splitlines()) <= 1


def test_a_shell_that_is_not_activated_is_named() -> None:
    command = [sys.executable, "atpid_control/bin/atpid", "--help"]
    done = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "'. ros2_ws/activate' first" in done.stderr
    assert len(done.stderr.splitlines()) == 1
