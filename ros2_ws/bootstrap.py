#!/usr/bin/env python3
# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Set up what the project needs: `.venv`, ROS 2 Jazzy and the built workspace. What is finished is left alone.

Where a Jazzy installation is sourced it is used as it is, elsewhere its wheels are installed. PYTHON names another
interpreter; arguments name locks in requirements/ that are installed beside: `bootstrap.py tests`.
Standard library only.

Exit status: 0 set up, 2 something is missing on this machine (one line says what to install), 1 a step failed.
"""

import errno
import fcntl
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from machine import (
    DISK_NEEDED,
    ROOT,
    VENV,
    WORKSPACE,
    Interpreter,
    Ros,
    SetupError,
    choose,
    disk_is_full,
    environment_key,
    foreign_paths,
    output_of,
    package_key,
    read_stamp,
    require_disk,
    require_machine,
    write_stamp,
)
from progress import step

#: The core's packages, the messages first.
CORE = (
    "atpid_interfaces/atpid_interfaces",
    "atpid_interfaces/atpid_common",
    "atpid_sim",
    "atpid_driver",
    "atpid_control",
)
#: Whatever extension is there is built too.
PACKAGES = (*CORE, *sorted(f"extensions/{path.parent.name}" for path in ROOT.glob("extensions/*/package.xml")))
LOG = WORKSPACE / "setup.log"
# Two programs that take as long as each other: the kernels of the plant, and those of the identification. The collector
# frees nothing that matters in a minute, and takes a twelfth of it.
KERNELS = tuple(
    "import gc; gc.disable(); "
    f"from atpid_control.commands import bench; bench.compile_kernels('scenes/thesis_4_3.yaml', {identifier!r})"
    for identifier in (None, "atpid_control/config/identifier.yaml")
)

# The lock is complete. An older pip that resolves dependencies again fails on a package that needs another one with an
# extra as soon as that has a newer release: it takes the newest, which the lock has no hash of.
OF_LOCK = ("--no-deps", "--require-hashes", "-r")
PIP: tuple[str | Path, ...] = (VENV / "bin/python", "-m", "pip", "install", *OF_LOCK)
# It takes an eighth of pip's time, and leaves bytecode to the first import (`keep_bytecode`).
UV: tuple[str | Path, ...] = (VENV / "bin/uv", "pip", "install", "--no-progress", "--no-build-isolation", *OF_LOCK)

UNREACHABLE = re.compile(
    r"Failed to establish a new connection|name resolution|Could not resolve|Connection refused|Network is unreachable|"
    r"ConnectTimeout|ReadTimeout|ProxyError|SSLError|Max retries exceeded|No matching distribution found"
)
FULL_DISK = re.compile(r"No space left on device|Disk quota exceeded|No usable temporary directory")
# Where the wheels were built; their CMake files contain these paths.
BUILD_CONTAINER = re.compile(
    r"/opt/python/cp\d+-cp\d+/(include/python3\.\d+|lib/python3\.\d+/site-packages/numpy/_core/include)"
)


@contextmanager
def alone() -> Iterator[None]:
    """Hold the workspace's lock, so that only one set-up runs at a time.

    The steps inherit it and the kernel frees it with the last of them, also where this process is killed.
    """
    with (WORKSPACE / ".setup.lock").open("w") as handle:
        os.set_inheritable(handle.fileno(), True)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("set-up: another one is at work in this folder, waiting for it", flush=True)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def run(command: list[str | Path], what: str, environment: dict[str, str], cwd: Path = ROOT) -> None:
    """Run one step with its output in the log; raise SetupError with one line on what went wrong."""
    with LOG.open("ab") as stream:
        start = stream.tell()
        done = subprocess.run(
            command, stdout=stream, stderr=subprocess.STDOUT, env=environment, cwd=cwd, check=False, close_fds=False
        )
    if done.returncode != 0:
        with LOG.open("rb") as stream:
            stream.seek(start)
            raise explain_failure(what, stream.read().decode(errors="replace"), done.returncode)


def explain_failure(what: str, text: str, status: int) -> SetupError:
    """Return the line that fits a failed step; the end of its output goes before it where the cause is not known."""
    if what == "pip" and UNREACHABLE.search(text):
        missing = re.search(r"No matching distribution found for (\S+)", text)
        detail = f" ({missing.group(1)} was not found)" if missing else ""
        return SetupError(
            f"set-up cannot get the Python packages from the package index{detail}: connect this machine to it, or "
            "point pip at a mirror (pip config set global.index-url ...), then run the same command again"
        )
    if FULL_DISK.search(text):
        return disk_is_full()
    if what != "uv":  # pip takes over
        sys.stderr.write("".join(f"    {line}\n" for line in text.splitlines()[-25:]))
    return SetupError(f"set-up failed: {what} ended with status {status}; all its output is in ros2_ws/setup.log", 1)


def step_environment() -> dict[str, str]:
    """Return this shell's environment without the settings of this workspace or of another Python environment."""
    kept = dict(os.environ)
    unwanted = ("VIRTUAL_ENV", "PYTHONHOME", "PIP_TARGET", "PIP_USER", "MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    for name in (*unwanted, "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONDONTWRITEBYTECODE"):
        kept.pop(name, None)
    for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH"):
        if name in kept:
            kept[name] = foreign_paths(kept[name])
        if not kept.get(name):
            kept.pop(name, None)
    kept["PATH"] = os.pathsep.join([str(VENV / "bin"), foreign_paths(kept.get("PATH", os.defpath))])
    return kept


def make_environment(python: Interpreter, ros: Ros) -> None:
    """Make `.venv` anew and install the lock in it."""
    environment = step_environment()
    with step(f"making .venv with Python {python.version}"):
        if VENV.exists():
            shutil.rmtree(VENV)
        shared = ["--system-site-packages"] if ros.source == "sourced" else []
        run([python.path, "-m", "venv", *shared, VENV], "venv", environment)
    with step("installing the locked packages (half a minute the first time)"):
        # the first is small, so a missing index is noticed soon
        run([*PIP, "ros2_ws/requirements/backend.txt", "--retries=1"], "pip", environment)
        install(ros.source, environment)
    if ros.source == "wheels":
        repair_wheels(VENV)


def install(name: str, environment: dict[str, str]) -> None:
    """Install what a lock lists."""
    lock = f"ros2_ws/requirements/{name}.txt"
    try:
        run([*UV, lock], "uv", environment | uv_settings(environment))
    except SetupError:  # a mirror that only pip can use
        print("uv could not install them, pip does ... ", end="", flush=True)
        run([*PIP, lock, "--no-build-isolation"], "pip", environment)


def add(name: str) -> None:
    """Install what a lock lists beside the others, unless it is there."""
    stamp, lock = VENV / f"{name}.stamp", ROOT / "ros2_ws/requirements" / f"{name}.txt"
    if read_stamp(stamp) == lock.read_text():
        return
    with step(f"installing the packages of requirements/{name}.txt"):
        install(name, step_environment())
    write_stamp(stamp, lock.read_text())


def uv_settings(environment: dict[str, str]) -> dict[str, str]:
    """Return uv's variables for the package index that pip is set up for: uv does not read pip's files."""
    settings = {"VIRTUAL_ENV": str(VENV), "UV_INDEX_STRATEGY": "unsafe-best-match"}  # hashes decide what is right
    names = {
        "index-url": "UV_DEFAULT_INDEX", "extra-index-url": "UV_INDEX", "cert": "SSL_CERT_FILE", "proxy": "ALL_PROXY",
    }  # fmt: skip
    for line in output_of([str(VENV / "bin/python"), "-m", "pip", "config", "list"], environment).splitlines():
        name, _, value = line.partition("=")
        given = value.strip("'\"")
        variable = names.get(name.rpartition(".")[2])
        if variable and not given.startswith("file:") and variable not in environment:
            settings[variable] = given
    return settings


def repair_wheels(venv: Path) -> None:
    """Put this machine's paths in the wheels' CMake files, which still hold those of the container that built them."""
    code = "import numpy, sysconfig; print(sysconfig.get_path('include')); print(numpy.get_include())"
    found = output_of([str(venv / "bin/python"), "-c", code]).split("\n")
    if len(found) != 2:
        raise SetupError("set-up failed: the Python in .venv does not import numpy; see ros2_ws/setup.log", 1)
    for folder in (venv / "share", venv / "lib/cmake"):
        for path in folder.rglob("*.cmake"):
            text = path.read_text(encoding="utf-8")
            new = BUILD_CONTAINER.sub(lambda match: found["numpy" in match.group(1)], text)
            if new != text:
                path.unlink()  # it may be a link to the installer's cache
                path.write_text(new, encoding="utf-8")


def build_workspace(ros: Ros, fresh: bool) -> None:
    """Build the packages with colcon, where `fresh` from nothing; messages for C++ again where they were (make cpp)."""
    python_only = ros.source == "wheels" and not any(WORKSPACE.glob("install/*/lib/lib*__rosidl_typesupport_cpp.so"))
    if fresh:
        for folder in ("build", "install", "log"):
            shutil.rmtree(WORKSPACE / folder, ignore_errors=True)
    environment = step_environment()
    if ros.source == "wheels":
        environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(VENV)
    python = VENV / "bin/python"
    command: list[str | Path] = [python, "-m", "colcon", "build", "--symlink-install", "--base-paths", "src"]
    arguments = ["--cmake-args", f"-DPython3_EXECUTABLE={python}", "-DBUILD_TESTING=OFF", "-DCMAKE_BUILD_TYPE=Release"]
    arguments.append(f"-DATPID_PYTHON_ONLY={'ON' if python_only else 'OFF'}")
    if fresh:
        with step("building the workspace and its kernels (two minutes the first time)"), kernels_beside(environment):
            run([*command, *arguments], "colcon build", environment, WORKSPACE)
            keep_bytecode(environment)
    else:
        with step("building what changed"):
            run([*command, *arguments], "colcon build", environment, WORKSPACE)
            keep_bytecode(environment)


def keep_bytecode(environment: dict[str, str]) -> None:
    """Have the bytecode written of whatever a program of the workspace may import."""
    code = (
        'COLCON_CURRENT_PREFIX=ros2_ws/install . ros2_ws/install/local_setup.sh && exec python ros2_ws/bytecode.py "$@"'
    )
    run(["sh", "-c", code, "sh", *CORE[1:], *PACKAGES[len(CORE) :]], "compiling bytecode", environment)


@contextmanager
def kernels_beside(environment: dict[str, str]) -> Iterator[None]:
    """Compile the bench's kernels meanwhile, which needs no built workspace; the user's cache keeps them."""
    sources = [str(ROOT / package) for package in CORE[1:]]
    paths = os.pathsep.join(filter(None, [*sources, environment.get("PYTHONPATH")]))
    given = environment | {"PYTHONPATH": paths, "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}
    quiet = subprocess.DEVNULL
    running = {
        code: subprocess.Popen(
            [VENV / "bin/python", "-c", code], stdout=quiet, stderr=quiet, env=given, cwd=ROOT, close_fds=False
        )
        for code in KERNELS
    }
    try:
        yield
        failed = [code for code, process in running.items() if process.wait() != 0]
    finally:
        for process in running.values():
            process.kill()
            process.wait()
    for code in failed:  # alone, since two may have been too much for the memory; and its reason goes into the log
        run([VENV / "bin/python", "-c", code], "compiling the kernels", given)


def set_up(requested: str | None) -> None:
    """Do what is missing, and nothing where nothing is."""
    if re.search(r"\s", str(ROOT)):
        raise SetupError(f"colcon and ROS do not work in a folder with a space in its path: move {str(ROOT)!r}")
    python, ros = choose(requested, os.environ)
    environment_stamp, build_stamp = VENV / "stamp", WORKSPACE / "install" / "stamp"
    keys = [environment_key(ROOT, python, ros), *(package_key(ROOT / package) for package in PACKAGES)]
    current = read_stamp(environment_stamp) == keys[0]
    if current and read_stamp(build_stamp) == "\n".join(keys):
        return
    require_machine(python, ros, os.environ)
    if not VENV.exists():
        require_disk()
    origin = "as sourced" if ros.source == "sourced" else "from its wheels (Linux on x86_64 only)"
    print(f"set-up: Python {python.version}, ROS 2 Jazzy {origin}, {DISK_NEEDED / 1e9:.1f} GB of disk", flush=True)
    LOG.write_text("")
    if not current:
        environment_stamp.unlink(missing_ok=True)
        make_environment(python, ros)
        write_stamp(environment_stamp, keys[0])
    built = read_stamp(build_stamp).split("\n")
    build_stamp.unlink(missing_ok=True)  # so that a build that is killed starts from nothing the next time
    build_workspace(ros, fresh=built[:2] != keys[:2])  # also where messages changed: types that went would stay
    write_stamp(build_stamp, "\n".join(keys))
    print("set-up: done", flush=True)


def main() -> int:
    """Set up; print one line where something is wrong."""
    try:
        with alone():
            set_up(os.environ.get("PYTHON") or None)
            for name in sys.argv[1:]:
                add(name)
    except SetupError as error:
        print(error, file=sys.stderr)
        return error.status
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        print(disk_is_full(), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("set-up: interrupted; the same command goes on where it can", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
