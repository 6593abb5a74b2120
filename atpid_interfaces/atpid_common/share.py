# SPDX-License-Identifier: Apache-2.0
"""The folder in which a package's parameter, calibration, map and firmware files are installed."""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from atpid_common.errors import InputError


def share_folder(package: str) -> Path:
    """Return `share/<package>` of the installation; InputError where no sourced workspace has the package."""
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        raise InputError(
            f"package {package} is in no workspace that this shell has sourced: `. ros2_ws/activate` in the "
            "repository, or `. install/local_setup.sh` in the workspace it was built in"
        ) from None
