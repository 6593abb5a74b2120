# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What set-up finds on this machine, and the keys by which it detects changes. Standard library only."""

import hashlib
import os
import platform
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
WORKSPACE = ROOT / "ros2_ws"
VENV = ROOT / ".venv"

DISK_NEEDED = 1.44e9  # of the environment and the workspace [bytes]
SUPPORTED = ("3.10", "3.11", "3.12", "3.13")
SEARCH_ORDER = ("python3", "python3.12", "python3.11", "python3.13", "python3.10")
PYTHON_PROBE = """
import sys, venv, ensurepip
print("%d.%d" % sys.version_info[:2], sys.implementation.name, sys._base_executable, sys.base_prefix, sep="\\n")"""
ROS_PROBE = "import rclpy; print(rclpy.__file__)"
HEADER_PROBE = "import os, sysconfig; print(os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')))"

# What decides how a package is built: contents of these, and names of those that are only installed as links.
BUILD_FILES = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "msg/*", "srv/*", "action/*")
LINKED_FILES = ("launch/**/*", "config/**/*", "resource/*", "firmware/**/*", "bin/*")


class SetupError(Exception):
    """Something is missing, or a step failed: one line to print, and the exit status."""

    def __init__(self, line: str, status: int = 2) -> None:
        super().__init__(line)
        self.status = status


class Interpreter(NamedTuple):
    """A Python that can make the environment."""

    path: str  # not that of a virtual environment, but of the Python behind it
    version: str  # "3.12"
    prefix: str  # where it is installed


class Ros(NamedTuple):
    """Where ROS 2 comes from."""

    source: str  # "wheels" or "sourced": also the lock in ros2_ws/requirements/ that fits
    rclpy: str  # the sourced installation's rclpy, "" for the wheels


def output_of(command: list[str], environment: Mapping[str, str] | None = None) -> str:
    """Return a command's standard output, empty where it cannot be run or fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def foreign_paths(paths: str) -> str:
    """Drop this project's own folders from a path list: an activated shell finds what a fresh one does."""
    own = (f"{WORKSPACE}{os.sep}", f"{VENV}{os.sep}")
    return os.pathsep.join(path for path in paths.split(os.pathsep) if path and not f"{path}{os.sep}".startswith(own))


def probe_python(name: str, search: str) -> Interpreter | str:
    """Return one Python, or in a few words why it cannot be used."""
    path = shutil.which(name, path=search)
    if path is None:
        return "not found"
    lines = output_of([path, "-c", PYTHON_PROBE]).split("\n")
    if len(lines) != 4:
        return "does not run or has no venv"
    version, implementation, base, prefix = lines
    if version not in SUPPORTED or implementation != "cpython":
        return f"is {implementation} {version}"
    return Interpreter(base, version, prefix)


def choose(requested: str | None, environment: Mapping[str, str]) -> tuple[Interpreter, Ros]:
    """Choose the Python and the source of ROS 2: the sourced Jazzy, with a Python it runs on, else the wheels."""
    distribution = environment.get("ROS_DISTRO", "")
    if distribution not in ("", "jazzy"):
        raise SetupError(
            f"ROS {distribution} is sourced and this project runs on ROS 2 jazzy: use a shell in which it is not "
            "sourced (the wheels are installed then), or one with /opt/ros/jazzy/setup.sh"
        )
    search = foreign_paths(environment.get("PATH", os.defpath))
    refused = []
    for name in [requested] if requested else SEARCH_ORDER:
        python = probe_python(name, search)
        if isinstance(python, str):
            refused.append(f"{name} {python}")
        elif not distribution:
            return python, Ros("wheels", "")
        elif rclpy := output_of([python.path, "-c", ROS_PROBE], environment):
            return python, Ros("sourced", rclpy)
        else:
            refused.append(f"{name} cannot import the sourced rclpy")
    raise SetupError(nothing_found(distribution, ", ".join(refused)))


def nothing_found(distribution: str, refused: str) -> str:
    """Return the line that names the Python to install, or how to get at the one the sourced ROS runs on."""
    if distribution:
        return (
            f"ROS 2 {distribution} is sourced but no Python here fits it ({refused}): sudo apt install "
            "ros-jazzy-ros-base python3-venv, or use a shell in which it is not sourced (the wheels are installed then)"
        )
    return (
        f"set-up needs Python {SUPPORTED[0]} to {SUPPORTED[-1]} with venv ({refused}): "
        "sudo apt install python3 python3-venv python3-dev"
    )


def require_machine(python: Interpreter, ros: Ros, environment: Mapping[str, str]) -> None:
    """Refuse a machine for which there are no wheels, or on which the messages cannot be compiled."""
    if ros.source == "wheels" and (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise SetupError(
            f"there are wheels of ROS 2 for Linux on x86_64 only, and this is {platform.system()} on "
            f"{platform.machine()}: install ROS 2 Jazzy (ros-jazzy-ros-base), source its setup.sh and try again"
        )
    names = (environment.get("CXX", "").split(" ")[0], "c++", "g++", "clang++")
    search = environment.get("PATH", os.defpath)
    if not any(shutil.which(name, path=search) for name in names if name):
        raise SetupError("set-up needs a C++ compiler for the messages and found none: sudo apt install g++")
    if shutil.which("make", path=search) is None:
        raise SetupError("set-up needs make for the messages and found none: sudo apt install make")
    if output_of([python.path, "-c", HEADER_PROBE]) != "True":
        package = "python3-dev" if python.path == "/usr/bin/python3" else f"python{python.version}-dev"
        raise SetupError(f"set-up needs the C headers of {python.path} for the messages: sudo apt install {package}")


def require_disk() -> None:
    """Refuse a disk on which the environment has no room."""
    free = shutil.disk_usage(ROOT).free
    if free < DISK_NEEDED:
        raise SetupError(
            f"set-up needs {DISK_NEEDED / 1e9:.1f} GB in {ROOT} and {free / 1e9:.1f} GB are free: make room, or move "
            "the folder to a larger disk"
        )


def disk_is_full() -> SetupError:
    """Return the line for a step that ended at a full disk: what is needed, and what is free where set-up writes."""
    places = dict.fromkeys((str(ROOT), os.environ.get("TMPDIR", "/tmp")))
    free = ", ".join(f"{shutil.disk_usage(place).free / 1e9:.1f} GB free in {place}" for place in places)
    return SetupError(
        f"set-up failed: a disk is full; it needs {DISK_NEEDED / 1e9:.1f} GB ({free}): make room, then run the same "
        "command again"
    )


def digest(parts: Iterable[str | bytes]) -> str:
    """Return one hash over a sequence of texts."""
    total = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        total.update(len(data).to_bytes(8, "little") + data)
    return total.hexdigest()


def files_of(package: Path, patterns: Iterable[str]) -> Iterator[Path]:
    """Yield a package's files that match, in a fixed order, without what other builds leave beside them."""
    for pattern in patterns:
        found = (path for path in package.glob(pattern) if path.is_file())
        yield from sorted(path for path in found if "build" not in path.relative_to(package).parts)


def environment_key(root: Path, python: Interpreter, ros: Ros) -> str:
    """Key of `.venv`: it is made anew when the folder, the Python, the ROS, the lock or set-up itself changes."""
    scripts = sorted((root / "ros2_ws").glob("*.py"))
    locks = [root / "ros2_ws/requirements" / name for name in ("backend.txt", f"{ros.source}.txt")]
    return digest([str(root), python.version, python.prefix, *ros, *(path.read_bytes() for path in (*scripts, *locks))])


def package_key(package: Path) -> str:
    """Key of a built package: contents of what its build reads, names of what it links."""
    parts: list[str | bytes] = []
    for path in files_of(package, BUILD_FILES):
        parts += [path.relative_to(package).as_posix(), path.read_bytes()]
    parts += [path.relative_to(package).as_posix() for path in files_of(package, LINKED_FILES)]
    return digest(parts)


def read_stamp(path: Path) -> str:
    """Return a stamp's text, empty where the step has never been finished."""
    return path.read_text() if path.is_file() else ""


def write_stamp(path: Path, text: str) -> None:
    """Write a stamp in one step, so that a kill leaves the old one or the new one."""
    new = path.with_suffix(".new")
    new.write_text(text)
    new.replace(path)
