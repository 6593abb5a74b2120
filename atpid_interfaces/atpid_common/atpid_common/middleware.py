# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the environment asks of the middleware: the ROS domain, and discovery on this machine only (docs/security.md).

In that case the middleware is kept on the loopback. And names that one process at a time holds: of nodes, of ROS
domains, of output folders.

The range of discovery alone limits what is announced and to whom; each middleware then still receives on all addresses.

- Fast DDS gets a profile. The range is set in addition to a profile, and would undo it; so with the profile, which has
  the same limits of discovery, the range is left to it.
- Cyclone DDS gets its one interface, in addition to the range.
- Of another middleware nothing is known: it keeps the range, which is then all there is.
"""

import os
import socket
from collections.abc import Mapping, MutableMapping
from pathlib import Path

from atpid_common.errors import InputError

#: Highest domain whose ports exist (RTPS 2.5, section 9.6.2.3).
HIGHEST_DOMAIN = 232
#: Of Fast DDS: loaded with a process's first participant.
PROFILE = Path(__file__).with_name("loopback.xml")
#: Of Cyclone DDS.
INTERFACE = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>"
)
FAST_DDS, CYCLONE_DDS = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"), "rmw_cyclonedds_cpp"
_RANGE, _LOCAL, _OF_PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "SYSTEM_DEFAULT"
#: The older way to ask for the same; where it is set, rcl takes the range from it.
_ONLY = "ROS_LOCALHOST_ONLY"
#: Names by which a user gives Fast DDS a profile, and Cyclone DDS its settings; either then stays.
_PROFILES, _SETTINGS = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"), "CYCLONEDDS_URI"


def confine(middleware: str, environment: MutableMapping[str, str] = os.environ) -> None:
    """Keep this process's nodes on 127.0.0.1, from its first one on, where the range is this machine.

    middleware: identifier of the RMW implementation that the process uses, which need not be the one asked for.
    """
    if environment.get(_RANGE, "").upper() != _LOCAL and environment.get(_ONLY) != "1":
        return
    if middleware in FAST_DDS:
        given = {environment.get(name, "") for name in _PROFILES}
        if given <= {"", str(PROFILE)} and PROFILE.is_file():
            environment[_PROFILES[0]], environment[_RANGE] = str(PROFILE), _OF_PROFILE
            environment.pop(_ONLY, None)
    elif middleware == CYCLONE_DDS and not environment.get(_SETTINGS):
        environment[_SETTINGS] = INTERFACE


class DomainError(InputError):
    """A ROS domain that does not exist."""


def named_domain(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return the domain in ROS_DOMAIN_ID; None where it is not set. Raises DomainError."""
    text = environment.get("ROS_DOMAIN_ID", "").strip()
    if not text:
        return None
    if not text.isdecimal() or int(text) > HIGHEST_DOMAIN:
        raise DomainError(f"ROS_DOMAIN_ID: given {text!r}; allowed: 0 to {HIGHEST_DOMAIN}, or not set")
    return int(text)


def claimed(name: str) -> socket.socket | None:
    """Hold `name` until the socket returned is closed; None where another process holds it.

    It is a Linux abstract socket, which the kernel frees even after SIGKILL, at once and without a file.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0atpid/{name}")
    except OSError:
        holder.close()
        return None
    return holder
