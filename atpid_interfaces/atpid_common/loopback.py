# SPDX-License-Identifier: Apache-2.0
"""Keeps the middleware's sockets on the loopback where discovery is limited to this machine (docs/security.md).

The range of discovery alone limits what is announced and to whom: Fast DDS still receives on all addresses.
"""

import os
from collections.abc import MutableMapping
from pathlib import Path

#: Of Fast DDS: loaded with a process's first participant.
PROFILE = Path(__file__).with_name("loopback.xml")
_RANGE, _LOCAL = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"
#: Names by which a user gives Fast DDS a profile, which then stays.
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def confine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS receive on 127.0.0.1 only, from this process's first node on, where the range is this machine."""
    if environment.get(_RANGE, "").upper() == _LOCAL and not any(environment.get(name) for name in _PROFILES):
        environment[_PROFILES[0]] = str(PROFILE)
