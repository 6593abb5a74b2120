# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament and `ros2 run` expect it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "atpid_control"
NODES = ["identifier_node", "recorder_node", "replay_files", "replay_node", "selector_node"]

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
        (f"share/{NAME}/config/maps", sorted(glob("config/maps/*.npz"))),
    ],
    zip_safe=False,
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="Identification, height selection, recording and replay for the tuned particle impact damper.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"{node} = {NAME}.executables:{node}" for node in NODES]},
)
