# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from setuptools import find_packages, setup

NAME = "atpid_exciter"

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
    description="The excitation output of a stand: commands in, voltages of a LabJack T7 or an NI module out, with its stops.",
    license="Apache-2.0",
    entry_points={"atpid.commands": [f"{NAME} = {NAME}.commands:COMMANDS"]},
)
