# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Compile the stand-in libraries once for each version of their source."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from atpid_common.folders import cache_root, content_key
from atpid_driver import DriverError

SOURCES = Path(__file__).parent / "data"
LIBRARIES = ("libLabJackM.so", "libnidaqmx.so")


class StandinError(DriverError):
    """The stand-in libraries cannot be built, or one of their files cannot be used."""


def build() -> Path:
    """Return the folder with both libraries, made in the user's cache; StandinError without tools."""
    sources = (path for path in SOURCES.iterdir() if path.is_file())
    target = cache_root() / "standins" / content_key(SOURCES, sources)
    if all((target / name).is_file() for name in LIBRARIES):
        return target
    for tool in ("make", "cc"):
        if shutil.which(tool) is None:
            raise StandinError(f"{tool} is missing: the stand-ins need a C compiler (apt install build-essential)")
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target) as made:
        command = ["make", "--silent", "--directory", str(SOURCES), f"BUILD={made}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise StandinError(f"the stand-in libraries do not compile: {done.stderr.strip().splitlines()[-1]}")
        for name in LIBRARIES:
            os.replace(Path(made) / name, target / name)  # in one step: another process may be loading it
    return target


def environment(
    libraries: Path,
    *,
    ljm_source: str = "",
    ljm_control: Path | None = None,
    ljm_output: Path | None = None,
    daqmx_source: str = "",
    daqmx_control: Path | None = None,
    daqmx_output: Path | None = None,
) -> dict[str, str]:
    """Return the variables that make a process find the stand-ins instead of the vendors' libraries."""
    path = os.pathsep.join(part for part in (str(libraries), os.environ.get("LD_LIBRARY_PATH", "")) if part)
    values = {
        "LD_LIBRARY_PATH": path,
        "ATPID_LJM_SOURCE": ljm_source,
        "ATPID_LJM_CONTROL": str(ljm_control or ""),
        "ATPID_LJM_OUTPUT": str(ljm_output or ""),
        "ATPID_DAQMX_SOURCE": daqmx_source,
        "ATPID_DAQMX_CONTROL": str(daqmx_control or ""),
        "ATPID_DAQMX_OUTPUT": str(daqmx_output or ""),
    }
    return {key: value for key, value in values.items() if value}
