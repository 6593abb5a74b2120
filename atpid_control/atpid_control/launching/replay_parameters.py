# SPDX-License-Identifier: Apache-2.0
"""The parameter file of a replay's nodes, written from the bag by the executable `replay_files`.

It is a process of its own: `ros2 launch` runs in a Python that need not have what reading a bag needs.
"""

from __future__ import annotations

import atexit
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import get_package_prefix

from atpid_control.launching.values import LaunchArgumentError

#: Launch arguments that are options of `replay_files`, where they are given.
OPTIONS = ("scene", "map", "rate", "record")


def parameter_file(arguments: Mapping[str, str]) -> str:
    """Write the scene, the map and the parameters of the bag to a folder that is removed when the launch ends.

    Returns the path of the parameter file; prints on standard error where the replay differs from the run. Raises
    LaunchArgumentError with the reason where the bag cannot be replayed.
    """
    folder = tempfile.mkdtemp(prefix="atpid-replay-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    executable = Path(get_package_prefix("atpid_control")) / "lib" / "atpid_control" / "replay_files"
    options = [f"--{name}={arguments[name]}" for name in OPTIONS if arguments.get(name)]
    command = [str(executable), arguments["bag"], "--out", folder, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise LaunchArgumentError(f"replay.launch.py: {reason.removeprefix('error: ')}")
    print(done.stderr, end="", file=sys.stderr)
    return done.stdout.strip()
