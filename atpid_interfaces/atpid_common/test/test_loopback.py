# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where discovery is limited to this machine the middleware uses the loopback only; what a user sets, stays."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from itertools import product

import pytest

from atpid_common.middleware import CYCLONE_DDS, FAST_DDS, INTERFACE, PROFILE, DomainError, confine, named_domain

RANGE, FILE, URI = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI"
LOCAL, ONLY = {RANGE: "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1"}
CONFINED = {RANGE: "SYSTEM_DEFAULT", FILE: str(PROFILE)}
OTHERS = ("rmw_connextdds", "rmw_zenoh_cpp", "rmw_gurumdds_cpp")


def confined(middleware: str, given: dict[str, str]) -> dict[str, str]:
    environment = dict(given)
    confine(middleware, environment)
    return environment


@pytest.mark.parametrize("middleware", FAST_DDS)
@pytest.mark.parametrize(
    "given",
    [LOCAL, {RANGE: "localhost"}, CONFINED, CONFINED | LOCAL, ONLY, ONLY | {RANGE: "SUBNET"}],
    ids=["limited", "in small letters", "from a confined process", "set again", "the older way", "which goes first"],
)
def test_fast_dds_is_confined_by_a_profile(middleware: str, given: dict[str, str]) -> None:
    assert confined(middleware, given) == CONFINED


@pytest.mark.parametrize("given", [LOCAL, {RANGE: "localhost"}, ONLY, LOCAL | {FILE: "/own.xml"}])
def test_cyclone_dds_is_confined_by_its_interface_and_keeps_the_range(given: dict[str, str]) -> None:
    environment = confined(CYCLONE_DDS, given)
    assert environment == given | {URI: INTERFACE}
    assert confined(CYCLONE_DDS, environment) == environment
    interfaces = ElementTree.fromstring(INTERFACE).iter("NetworkInterface")
    assert [interface.get("address") for interface in interfaces] == ["127.0.0.1"]


OPEN: tuple[dict[str, str], ...] = ({}, {RANGE: "SUBNET"}, {RANGE: "OFF"}, {"ROS_LOCALHOST_ONLY": "0"})
#: What a user sets for the middleware itself.
OWN = [
    (FAST_DDS[0], LOCAL | {FILE: "/own.xml"}),
    (FAST_DDS[0], LOCAL | {"FASTDDS_DEFAULT_PROFILES_FILE": "/own.xml"}),
    (CYCLONE_DDS, LOCAL | {URI: "file:///own.xml"}),
]


@pytest.mark.parametrize(
    ("middleware", "given"), [*product((*FAST_DDS, CYCLONE_DDS, *OTHERS), OPEN), *product(OTHERS, (LOCAL, ONLY)), *OWN]
)
def test_what_a_user_sets_and_the_range_of_an_unknown_middleware_stay(middleware: str, given: dict[str, str]) -> None:
    assert confined(middleware, given) == given


def test_the_domain_the_user_has_set_is_taken() -> None:
    for text, domain in (("", None), ("0", 0), ("77", 77), ("232", 232)):
        assert named_domain({"ROS_DOMAIN_ID": text}) == domain
    assert named_domain({}) is None
    for text in ("lab", "-1", "233", "1.5"):
        with pytest.raises(DomainError, match=rf"ROS_DOMAIN_ID: .*'{text}'.* 0 .* 232"):
            named_domain({"ROS_DOMAIN_ID": text})


#: Prints the addresses of Cyclone DDS's UDP sockets, and the multicast groups that were joined.
PARTICIPANT = """
import os
from cyclonedds.domain import DomainParticipant
participant = DomainParticipant(77)
links = [os.readlink(entry.path) for entry in list(os.scandir("/proc/self/fd")) if os.path.islink(entry.path)]
rows = [line.split() for line in open("/proc/self/net/udp")][1:]
print(*sorted({row[1].partition(":")[0] for row in rows if f"socket:[{row[9]}]" in links}))
print(*sorted({line.split()[0] for line in open("/proc/self/net/igmp") if line.startswith("\\t\\t")}))
"""
ANY, LOOPBACK, OUTER, ALL_HOSTS, DISCOVERY = "00000000", "0100007F", "0708090A", "010000E0", "0100FFEF"


@pytest.mark.skipif(os.geteuid() != 0, reason="a network of its own needs root")
@pytest.mark.parametrize(
    ("settings", "sockets", "groups"),
    [({}, [ANY, OUTER], [ALL_HOSTS, DISCOVERY]), ({URI: INTERFACE}, [ANY, LOOPBACK], [ALL_HOSTS])],
    ids=["of itself", "confined"],
)
def test_cyclone_sends_on_the_loopback_only(settings: dict[str, str], sockets: list[str], groups: list[str]) -> None:
    """By its own library, where it is installed, in a network with a second interface.

    It always receives on all addresses: its settings have nothing for that (docs/security.md).
    """
    pytest.importorskip("cyclonedds")
    network = (
        "ip link set lo up && ip tuntap add dev d0 mode tap && ip addr add 10.9.8.7/24 dev d0 && ip link set d0 up"
    )
    done = subprocess.run(
        ["unshare", "--net", "--mount", "sh", "-c", f'{network} && exec "$0" -c "$1"', sys.executable, PARTICIPANT],
        capture_output=True, text=True, check=False, env=os.environ | settings,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [sockets, groups]
