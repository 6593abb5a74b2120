# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Installs the package the way ament expects it."""

from setuptools import find_packages, setup

NAME = "atpid_common"

setup(
    name=NAME,
    version="1.0.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["LICENSE", "package.xml"]),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # makes `colcon test` run pytest
    maintainer="ATPID maintainers",
    maintainer_email="atpid@example.org",
    description="What the packages of the tuned particle impact damper share: errors, command line, node plumbing.",
    license="Apache-2.0",
    entry_points={"ament_copyright.license": ["spdx_apache2 = atpid_common.licence:SPDX"]},
)
