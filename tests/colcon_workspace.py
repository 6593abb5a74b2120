# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The repository as a ROS user has it: a clone in a workspace of their own, built and sourced like any other."""

import filecmp
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Folder of each package.
PACKAGES = {
    "atpid_interfaces": "atpid_interfaces/atpid_interfaces",
    "atpid_common": "atpid_interfaces/atpid_common",
    "atpid_sim": "atpid_sim",
    "atpid_driver": "atpid_driver",
    "atpid_control": "atpid_control",
    **{path.parent.name: f"extensions/{path.parent.name}" for path in sorted(ROOT.glob("extensions/*/package.xml"))},
}
#: What of a package is for those who read, build or test it. All else is installed.
NOT_INSTALLED = {
    "CHANGELOG.rst", "CMakeLists.txt", "QUALITY_DECLARATION.md", "README.md", "pytest.ini", "setup.cfg", "setup.py",
    "test",
}  # fmt: skip
#: Variables of pytest, of coverage.py and of a colcon workspace that this shell has sourced begin so.
UNWANTED = ("PYTEST_", "COVERAGE_", "COLCON_")


def sources() -> list[Path]:
    """Return the files a clone would have, relative to the root: those git keeps or would add."""
    command = ["git", "-c", "safe.directory=*", "-C", str(ROOT), "ls-files", "-z"]
    command += ["--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, check=True).stdout.decode()
    paths = sorted(Path(name) for name in listed.split("\0") if name)
    return [path for path in paths if (ROOT / path).is_symlink() or (ROOT / path).exists()]


def clone(folder: Path) -> Path:
    """Copy the sources to `folder`; return it."""
    for path in sources():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, folder / path, follow_symlinks=False)
    return folder


def differences(package: str, prefix: Path) -> list[str]:
    """Return the package's files that are not installed below `prefix` with the same name and content."""
    installed: dict[str, list[Path]] = {}
    for path in prefix.rglob("*"):
        installed.setdefault(path.name, []).append(path)
    own = [source for source in sources() if source.is_relative_to(PACKAGES[package]) and (ROOT / source).is_file()]
    kept = [source for source in own if source.relative_to(PACKAGES[package]).parts[0] not in NOT_INSTALLED]
    kept += [source for source in sources() if package == "atpid_sim" and source.parts[0] == "scenes"]  # linked to
    return [
        str(source)
        for source in kept
        if not any(filecmp.cmp(path, ROOT / source, shallow=False) for path in installed.get(source.name, []))
    ]


def environment() -> dict[str, str]:
    """Return this environment without the built workspace of the repository and without pytest's own variables."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(UNWANTED)}
    own = f"{ROOT / 'ros2_ws'}{os.sep}"
    for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PATH", "PYTHONPATH"):
        kept[name] = os.pathsep.join(part for part in kept.get(name, "").split(os.pathsep) if not part.startswith(own))
    return {name: value for name, value in kept.items() if value}


def sourced(workspace: Path) -> dict[str, str]:
    """Return the environment of a shell that has sourced the workspace."""
    script = f". {workspace}/install/local_setup.sh && exec env -0"
    done = subprocess.run(["sh", "-c", script], env=environment(), cwd=workspace, capture_output=True, check=True)
    return dict(line.split("=", 1) for line in done.stdout.decode().split("\0") if line)


def run(command: Sequence[str | Path], cwd: Path, env: dict[str, str]) -> str:
    """Run a command to its end; return what it prints. A failed one fails the test with its last lines."""
    done = subprocess.run(
        command, cwd=cwd, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    failed = "\n".join(line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR", "E  ")))
    assert done.returncode == 0, f"{' '.join(map(str, command))}: {done.returncode}\n{failed}\n{done.stdout[-6000:]}"
    return done.stdout
