# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "atpid_control"
EXECUTABLES = [
    "identifier_node",
    "live_node",
    "recorder_node",
    "replay_node",
    "selector_node",
    "supervisor_node",
]


def shared_files(*folders: str) -> list[tuple[str, list[str]]]:
    """Return every file below the folders with its place in the share folder, as `data_files` takes them."""
    places: dict[str, list[str]] = {}
    for path in sorted(path for folder in folders for path in Path(folder).rglob("*")):
        if path.is_file() and not {"build", "__pycache__"} & set(path.parts):  # made by builds and runs
            places.setdefault(f"share/{NAME}/{path.parent.as_posix()}", []).append(str(path))
    return list(places.items())


setup(
    name=NAME,
    version="1.0.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "data/*", "**/data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["LICENSE", "package.xml"]),
        ("bin", ["bin/atpid"]),  # on the path of every shell that reads the workspace
        *shared_files("config", "launch"),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # makes `colcon test` run pytest
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="Identification, height selection, recording and replay for the tuned particle impact damper.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"{node} = {NAME}.executables:{node}" for node in EXECUTABLES],
        "atpid_sim": [f"open_run = {NAME}.runs.run:open_run"],  # what `import atpid_sim` offers beside its own
    },
)
