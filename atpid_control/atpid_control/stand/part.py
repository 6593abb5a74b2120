# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One node of the graph, as the package that has it is installed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory

from atpid_control.stand.errors import BenchError
from atpid_control.stand.parameters import read_parameters


@dataclass(frozen=True)
class Part:
    """One node of the graph: an executable of a package, and its parameter file.

    That is one of the package, or a user's, by its absolute path; "": it has none.
    """

    package: str
    name: str
    config: str

    @property
    def executable(self) -> Path:
        """What `ros2 run` starts; raises BenchError where the workspace is not built."""
        return built(Path(found(get_package_prefix, self.package)) / "lib" / self.package / self.name)

    @property
    def config_file(self) -> Path:
        """Its parameter file; raises BenchError where the workspace is not built."""
        return Path(found(get_package_share_directory, self.package)) / "config" / self.config

    def configured(self) -> dict[str, Any]:
        """Return the parameters of its file. Raises BenchError or FileError where there is none for it."""
        return read_parameters(self.config_file, [self.name])[self.name] if self.config else {}


def built(path: Path) -> Path:
    """Return a path of the workspace; raise BenchError where it is not built."""
    if not path.exists():
        raise BenchError(f"{path} is missing: build the workspace with `make setup`")
    return path


def found(where: Any, package: str) -> str:
    """Return what the function `where` finds of a package; raise BenchError where the package is not on the path."""
    try:
        return str(where(package))
    except (PackageNotFoundError, OSError):
        raise BenchError(f"package {package} is not on the path: `make setup`, then `. ros2_ws/activate`") from None
