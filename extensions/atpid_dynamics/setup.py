# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from setuptools import find_packages, setup

NAME = "atpid_dynamics"

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
    description="Motions over many heights, along branches and cliffs, and shares of starts that come to them.",
    license="Apache-2.0",
    entry_points={
        "atpid.commands": [f"{NAME} = {NAME}.commands:COMMANDS"],
        "atpid.kernels": [f"{NAME} = {NAME}.api:compile_kernels"],
        # what `import atpid_sim` offers beside its own
        "atpid_sim": [f"{name} = {NAME}.api:{name}" for name in ("kicked", "sweep")],
    },
)
