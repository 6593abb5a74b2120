# SPDX-License-Identifier: Apache-2.0
"""Keeps the middleware on the loopback where discovery is limited to this machine (docs/security.md).

The range of discovery alone limits what is announced and to whom: with `LOCALHOST` Fast DDS still receives on all
addresses, and goes by shared memory. Both are set by ROS in addition to any profile, so with the profile, which has
the same limits of discovery, the range is left to it.
"""

import os
from collections.abc import MutableMapping
from pathlib import Path

#: Of Fast DDS: loaded with a process's first participant.
PROFILE = Path(__file__).with_name("loopback.xml")
_RANGE, _LOCAL, _OF_PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "SYSTEM_DEFAULT"
#: Names by which a user gives Fast DDS a profile, which then stays.
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def confine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS use 127.0.0.1 only, from this process's first node on, where the range is this machine."""
    given = {environment.get(name, "") for name in _PROFILES}
    if environment.get(_RANGE, "").upper() == _LOCAL and given <= {"", str(PROFILE)} and PROFILE.is_file():
        environment[_PROFILES[0]], environment[_RANGE] = str(PROFILE), _OF_PROFILE
