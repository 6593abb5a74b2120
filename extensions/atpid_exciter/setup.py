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
        (f"share/{NAME}/config", ["config/excitation.yaml"]),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # makes `colcon test` run pytest
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="The excitation output of a stand: commands in, the voltage of a LabJack T7 or an NI module out.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"excitation_node = {NAME}.executables:excitation_node"],
        "atpid.commands": [f"{NAME} = {NAME}.commands:COMMANDS"],
        "atpid.nodes": [f"excitation_node = {NAME}.part:PART"],
        "atpid.checks": [f"{NAME} = {NAME}.commands:CHECKS"],
    },
)
