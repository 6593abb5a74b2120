#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Set up everything the project needs: `.venv`, ROS 2 and the built workspace. Standard library only; a finished set-up is left alone.

Two sources of ROS 2 Jazzy: where a Jazzy installation is sourced it is used as it is, elsewhere its wheels are installed.
Exit status: 0 set up, 2 something is missing on this machine (one line says what to install), 1 a step failed.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, NoReturn

ROOT = Path(__file__).resolve().parent.parent
WORKSPACE = ROOT / "ros2_ws"
VENV = ROOT / ".venv"
PACKAGES = ("atpid_interfaces", "atpid_sim", "atpid_driver", "atpid_control")
SUPPORTED = ("3.10", "3.11", "3.12", "3.13")
SEARCH_ORDER = ("python3", "python3.12", "python3.11", "python3.13", "python3.10")

# What decides how a package is built: contents of these, and names of those that are only installed as links.
BUILD_FILES = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "msg/*", "srv/*", "action/*")
LINKED_FILES = ("launch/*", "config/*", "resource/*", "firmware/**/*")

PROBE = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2], sys.implementation.name, sys.base_prefix)"
ROS_PROBE = "import rclpy, sys; print('ok')"


class SetupError(Exception):
    """A step failed or something is missing: one line to print, and the exit status."""

    def __init__(self, line: str, status: int = 2) -> None:
        super().__init__(line)
        self.status = status


class Interpreter(NamedTuple):
    """A Python that can make the environment."""

    path: str
    version: str  # "3.12"
    prefix: str


class Source(NamedTuple):
    """Where ROS 2 comes from."""

    name: str  # "sourced" or "wheels": the lock in requirements/ to install
    prefixes: str  # AMENT_PREFIX_PATH of the sourced installation, "" for the wheels


# ---------------------------------------------------------------------------------------------- what is on this machine


def output_of(command: list[str], environment: Mapping[str, str] | None = None) -> str | None:
    """Return a command's standard output, or None if it cannot be run or fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    except OSError:
        return None
    return done.stdout if done.returncode == 0 else None


def find_python(requested: str | None) -> Interpreter:
    """Find a supported Python with venv: the requested one, or the first of SEARCH_ORDER."""
    refused = []
    for name in [requested] if requested else SEARCH_ORDER:
        path = shutil.which(name, path=foreign_paths(os.environ.get("PATH", os.defpath)))
        if path is None:
            refused.append(f"{name}: not found")
            continue
        words = (output_of([path, "-c", PROBE]) or "").split(maxsplit=2)
        if len(words) == 3 and words[0] in SUPPORTED and words[1] == "cpython":
            return Interpreter(path, words[0], words[2].strip())
        refused.append(f"{name}: " + (f"{words[1]} {words[0]}" if len(words) == 3 else "has no venv"))
    apt = "sudo apt install python3 python3-venv python3-dev"
    raise SetupError(f"set-up needs Python {SUPPORTED[0]} to {SUPPORTED[-1]} with venv ({'; '.join(refused)}): {apt}")


def find_compiler(environment: Mapping[str, str]) -> str:
    """Find a C++ compiler: `CXX`, or one of the usual names."""
    for name in filter(None, (environment.get("CXX"), "c++", "g++", "clang++")):
        path = shutil.which(name.split()[0])
        if path:
            return path
    raise SetupError("set-up needs a C++ compiler to build the messages, and none was found: sudo apt install g++")


def find_headers(python: Interpreter) -> None:
    """Refuse a Python without its C headers, which the messages are compiled against."""
    code = "import sysconfig, os; print(os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')))"
    if (output_of([python.path, "-c", code]) or "").strip() != "True":
        package = f"python{python.version}-dev"
        raise SetupError(f"set-up needs the C headers of Python {python.version} ({python.path}): sudo apt install {package}")


def find_tools(python: Interpreter, environment: Mapping[str, str]) -> None:
    """Refuse a machine on which the messages cannot be compiled."""
    find_compiler(environment)
    find_headers(python)
    if shutil.which("make") is None:
        raise SetupError("set-up needs make to build the messages, and it was not found: sudo apt install make")


def find_ros(python: Interpreter, environment: Mapping[str, str]) -> Source:
    """Decide where ROS 2 comes from: the sourced Jazzy if this Python can import its `rclpy`, else the wheels."""
    distribution = environment.get("ROS_DISTRO", "")
    if not distribution:
        return Source("wheels", "")
    if distribution != "jazzy":
        raise SetupError(
            f"ROS 2 {distribution} is sourced and this project runs on jazzy: "
            "use a shell without it (the wheels are installed then), or source /opt/ros/jazzy/setup.sh"
        )
    if "ok" not in (output_of([python.path, "-c", ROS_PROBE], dict(environment)) or ""):
        raise SetupError(
            f"ROS 2 jazzy is sourced, but {python.path} cannot import its rclpy: "
            "set PYTHON=/usr/bin/python3 (or the Python your Jazzy was built for), or use a shell without ROS"
        )
    return Source("sourced", foreign_paths(environment.get("AMENT_PREFIX_PATH", "")))


def foreign_paths(paths: str) -> str:
    """Drop this project's own folders from a path list: an activated shell has the same ROS as a fresh one."""
    own = (str(WORKSPACE), str(VENV))
    return os.pathsep.join(path for path in paths.split(os.pathsep) if path and not path.startswith(own))


# ------------------------------------------------------------------------------------------------------------- stamps


def digest(parts: Iterable[str | bytes]) -> str:
    """Return one hash over a sequence of texts."""
    total = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        total.update(len(data).to_bytes(8, "little") + data)
    return total.hexdigest()


def files_of(package: Path, patterns: Iterable[str]) -> Iterator[Path]:
    """Yield a package's files that match, in a fixed order."""
    for pattern in patterns:
        yield from sorted(path for path in package.glob(pattern) if path.is_file())


def environment_key(root: Path, python: Interpreter, source: Source) -> str:
    """Key of `.venv`: it is made anew when the lock, the Python, the source of ROS, this file or the folder changes."""
    locks = [(root / "requirements" / name).read_bytes() for name in ("backend.txt", f"{source.name}.txt")]
    return digest([str(root), *python, *source, (root / "ros2_ws" / "bootstrap.py").read_bytes(), *locks])


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


# -------------------------------------------------------------------------------------------------------------- steps


def run(command: list[str | Path], what: str, environment: Mapping[str, str] | None = None, cwd: Path = ROOT) -> None:
    """Run one step with its output kept in the log, shown only if it fails."""
    log = WORKSPACE / "setup.log"
    with log.open("ab") as stream:
        start = stream.tell()
        done = subprocess.run(command, stdout=stream, stderr=subprocess.STDOUT, env=environment, cwd=cwd, check=False)
    if done.returncode == 0:
        return
    with log.open("rb") as stream:
        stream.seek(start)
        text = stream.read().decode(errors="replace")
    explain_failure(what, text, done.returncode)


UNREACHABLE = re.compile(
    r"NewConnectionError|Temporary failure in name resolution|Could not resolve|Connection refused|ConnectTimeout|ProxyError|"
    r"Network is unreachable|Max retries exceeded|SSLError|No matching distribution found"
)


def explain_failure(what: str, text: str, status: int) -> NoReturn:
    """Raise the one line that fits a failed step."""
    if what == "pip" and UNREACHABLE.search(text):
        missing = re.search(r"No matching distribution found for (\S+)", text)
        detail = f" ({missing.group(1)} was not found there)" if missing else ""
        raise SetupError(
            f"set-up cannot get the Python packages from the package index{detail}: connect this machine to the network, "
            "or point pip at a mirror (pip config set global.index-url ADDRESS), then run it again"
        )
    sys.stderr.write("".join(f"    {line}\n" for line in text.splitlines()[-25:]))
    raise SetupError(f"set-up failed: {what} ended with status {status}; the whole log is ros2_ws/setup.log", 1)


@contextmanager
def step(text: str) -> Iterator[None]:
    """Say what is being done and how long it took."""
    begin = time.monotonic()
    print(f"  {text} ...", end="", flush=True)
    try:
        yield
    except BaseException:
        print()
        raise
    print(f" {time.monotonic() - begin:.0f} s", flush=True)


def clean_environment() -> dict[str, str]:
    """Return the environment for the steps: this shell's, without another Python's or another workspace's settings."""
    kept = dict(os.environ)
    for name in ("VIRTUAL_ENV", "PYTHONHOME", "PIP_TARGET", "PIP_USER", "PIP_REQUIRE_VIRTUALENV", "COLCON_CURRENT_PREFIX"):
        kept.pop(name, None)
    for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"):
        kept[name] = foreign_paths(kept.get(name, ""))
        if not kept[name]:
            del kept[name]
    kept.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    kept["PATH"] = os.pathsep.join([str(VENV / "bin"), foreign_paths(kept.get("PATH", os.defpath))])
    return kept


def make_environment(python: Interpreter, source: Source) -> None:
    """Make `.venv` anew and install the lock in it."""
    if VENV.exists():
        shutil.rmtree(VENV)
    system = ["--system-site-packages"] if source.name == "sourced" else []
    environment = clean_environment()
    with step(f"making .venv with Python {python.version}"):
        run([python.path, "-m", "venv", *system, VENV], "venv", environment)
    pip: list[str | Path] = [VENV / "bin/python", "-m", "pip", "--disable-pip-version-check", "install", "--require-hashes"]
    where = "ROS 2 Jazzy from its wheels" if source.name == "wheels" else "beside the sourced ROS 2 Jazzy"
    with step(f"installing the locked packages ({where}; a minute or two the first time)"):
        run([*pip, "-r", "requirements/backend.txt"], "pip", environment)
        run([*pip, "--no-build-isolation", "-r", f"requirements/{source.name}.txt"], "pip", environment)
    if source.name == "wheels":
        repair_wheels(VENV)


BUILD_CONTAINER = re.compile(r"/opt/python/cp\d+-cp\d+/(include/python3\.\d+|lib/python3\.\d+/site-packages/numpy/_core/include)")


def repair_wheels(venv: Path) -> None:
    """Replace the paths of the container the wheels were built in, which their CMake files still hold, by this machine's."""
    code = "import numpy, sysconfig; print(sysconfig.get_path('include')); print(numpy.get_include())"
    found = output_of([str(venv / "bin/python"), "-c", code])
    if found is None:
        raise SetupError("set-up failed: the Python in .venv does not import numpy; the whole log is ros2_ws/setup.log", 1)
    python_include, numpy_include = found.split("\n")[:2]
    for folder in (venv / "share", venv / "lib/cmake"):
        for path in folder.rglob("*.cmake"):
            text = path.read_text(encoding="utf-8")
            new = BUILD_CONTAINER.sub(lambda m: numpy_include if "numpy" in m.group(1) else python_include, text)
            if new != text:
                path.write_text(new, encoding="utf-8")


def build_workspace(source: Source, interfaces_changed: bool) -> None:
    """Build the four packages with colcon; from nothing where the interfaces changed, since stale types would stay otherwise."""
    for folder in ("build", "install", "log"):
        if interfaces_changed and (WORKSPACE / folder).exists():
            shutil.rmtree(WORKSPACE / folder)
    environment = clean_environment()
    if source.name == "wheels":
        environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(VENV)
    environment["Python3_EXECUTABLE"] = str(VENV / "bin/python")
    options = ["--symlink-install", "--event-handlers", "console_direct+", "--cmake-args"]
    arguments = [f"-DPython3_EXECUTABLE={VENV / 'bin/python'}", "-DBUILD_TESTING=OFF", "-DCMAKE_BUILD_TYPE=Release"]
    with step("building the workspace (the messages take most of it)"):
        command: list[str | Path] = [VENV / "bin/python", "-m", "colcon", "build", *options, *arguments]
        run(command, "colcon build", environment, WORKSPACE)


# --------------------------------------------------------------------------------------------------------------- main


@contextmanager
def alone() -> Iterator[None]:
    """Hold the workspace's lock, so that two set-ups never work at once; the kernel frees it when a process dies."""
    with (WORKSPACE / ".setup.lock").open("w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("another set-up is running here: waiting for it", flush=True)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def set_up(requested: str | None) -> None:
    """Do what is missing."""
    python = find_python(requested)
    source = find_ros(python, os.environ)
    environment_stamp, build_stamp = VENV / "stamp", WORKSPACE / "install" / "stamp"
    environment = environment_key(ROOT, python, source)
    keys = [environment, *(package_key(ROOT / package) for package in PACKAGES)]
    if read_stamp(environment_stamp) == environment and read_stamp(build_stamp) == "\n".join(keys):
        return
    find_tools(python, os.environ)
    print(f"set-up: Python {python.version}, ROS 2 Jazzy {'as sourced' if source.name == 'sourced' else 'from wheels'}")
    (WORKSPACE / "setup.log").write_text("")
    if read_stamp(environment_stamp) != environment:
        environment_stamp.unlink(missing_ok=True)
        make_environment(python, source)
        write_stamp(environment_stamp, environment)
    built = read_stamp(build_stamp).split("\n")
    build_stamp.unlink(missing_ok=True)  # a build that is killed starts from nothing the next time
    build_workspace(source, interfaces_changed=built[:2] != keys[:2])
    write_stamp(build_stamp, "\n".join(keys))
    print("set-up: done")


def main() -> int:
    """Set up, and say in one line what is wrong where something is."""
    try:
        with alone():
            set_up(os.environ.get("PYTHON") or None)
    except SetupError as error:
        print(error, file=sys.stderr)
        return error.status
    except KeyboardInterrupt:
        print("set-up: interrupted; run it again to go on", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
