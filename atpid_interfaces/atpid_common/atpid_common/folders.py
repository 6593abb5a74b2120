# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folders of the project: what is kept between runs in the user's cache, and what a package has installed."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from atpid_common.errors import InputError


def cache_root() -> Path:
    """Return the folder of compiled kernels, device stand-ins and height maps: `atpid` in the user's cache.

    That is `$XDG_CACHE_HOME`, by default `~/.cache`.
    """
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "atpid"


def content_key(folder: Path, files: Iterable[Path]) -> str:
    """Return 16 hex digits of the files' places in `folder` and their contents, whatever their order."""
    total = hashlib.sha256()
    for path in sorted(files):
        total.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return total.hexdigest()[:16]


def share_folder(package: str) -> Path:
    """Return `share/<package>`, where its parameter, calibration, map and firmware files are installed.

    Raises InputError where no sourced workspace has the package.
    """
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory  # not for kernels

    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        raise InputError(
            f"package {package} is in no workspace that this shell has sourced: `. ros2_ws/activate` in the "
            "repository, or `. install/local_setup.sh` in the workspace it was built in"
        ) from None
