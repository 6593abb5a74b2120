# SPDX-License-Identifier: Apache-2.0
"""Where discovery is limited to this machine the middleware uses the loopback only; what a user sets, stays."""

import pytest

from atpid_common.loopback import PROFILE, confine

RANGE, FILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"
CONFINED = {RANGE: "SYSTEM_DEFAULT", FILE: str(PROFILE)}


@pytest.mark.parametrize(
    "given",
    [{RANGE: "LOCALHOST"}, {RANGE: "localhost"}, CONFINED, CONFINED | {RANGE: "LOCALHOST"}],
    ids=["limited", "in small letters", "from a confined process", "from one whose range was set again"],
)
def test_discovery_on_this_machine_is_confined_to_the_loopback(given: dict[str, str]) -> None:
    environment = dict(given)
    confine(environment)
    assert environment == CONFINED


@pytest.mark.parametrize(
    "given",
    [{}, {RANGE: "SUBNET"}, {RANGE: "OFF"}, {RANGE: "LOCALHOST", FILE: "/own.xml"},
     {RANGE: "LOCALHOST", "FASTDDS_DEFAULT_PROFILES_FILE": "/own.xml"}],
)  # fmt: skip
def test_what_a_user_sets_stays(given: dict[str, str]) -> None:
    environment = dict(given)
    confine(environment)
    assert environment == given
