# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from setuptools import find_packages, setup

NAME = "atpid_lab"
#: What reads or writes files of other programs, by the names of the formats.
FORMATS = {
    "csv": "CSV",
    "mat": "MAT",
    "parquet": "PARQUET",
    "tdms": "TDMS",
    "text": "TEXT",
    "uff": "UFF",
    "uff-ascii": "UFF_ASCII",
    "wav": "WAV",
}

setup(
    name=NAME,
    version="1.0.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "data/*", "**/data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["LICENSE", "package.xml"]),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # makes `colcon test` run pytest
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="Modes, beam and contact by a recording, its validation, files of other programs, traces.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"foxglove_node = {NAME}.executables:foxglove_node"],
        "atpid.commands": [f"{NAME} = {NAME}.commands:COMMANDS"],
        "atpid.formats": [f"{name} = {NAME}.formats:{place}" for name, place in FORMATS.items()],
    },
)
