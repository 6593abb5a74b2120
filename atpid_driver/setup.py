# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "atpid_driver"
NODES = ["feed_node", "labjack_node", "motor_node", "ni_node"]


def firmware_files() -> list[tuple[str, list[str]]]:
    """Return the firmware's files folder by folder, as `data_files` wants them, without what a build leaves behind."""
    folders: dict[str, list[str]] = {}
    for path in sorted(Path("firmware").rglob("*")):
        if path.is_file() and "build" not in path.parts:
            folders.setdefault(f"share/{NAME}/{path.parent}", []).append(str(path))
    return list(folders.items())


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "data/*", "**/data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.*"))),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        *firmware_files(),
    ],
    zip_safe=False,
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="The hardware of the tuned particle impact damper: drivers, calibration, firmware.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"{node} = {NAME}.executables:{node}" for node in NODES]},
)
