# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From the operator's stop to the motor off, on the emulated board, for each way to stop; `-s` prints the times."""

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from motor_graph import Stand
from motor_rigs import board, need_emulator
from std_srvs.srv import Trigger
from test_motor_process import start_down, started

from atpid_driver.emulator import Emulator

pytestmark = pytest.mark.slow

Act = Callable[[], object]
Prepare = Callable[[Stand, "Popen[str]", Emulator], Act]
#: The host is there: by its word.
BY_WORD = 0.2
#: It is not: by the heartbeat the firmware misses.
BY_HEARTBEAT = 0.5


def service(kind: Any, name: str, request: Any) -> Prepare:
    """The request itself; discovery is no part of a stop."""

    def prepare(stand: Stand, _process: "Popen[str]", _emulator: Emulator) -> Act:
        client = stand.peer.create_client(kind, name)
        stand.until(client.service_is_ready)
        return lambda: client.call_async(request)

    return prepare


def sent(number: signal.Signals) -> Prepare:
    return lambda _stand, process, _emulator: lambda: process.send_signal(number)


DEACTIVATE = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
WAYS: dict[str, tuple[Prepare, float]] = {
    "service ~/stop": (service(Trigger, "motor_node/stop", Trigger.Request()), BY_WORD),
    "lifecycle deactivate": (service(ChangeState, "motor_node/change_state", DEACTIVATE), BY_WORD),
    "Ctrl-C": (sent(signal.SIGINT), BY_WORD),
    "SIGTERM": (sent(signal.SIGTERM), BY_WORD),
    "host gone (SIGKILL)": (sent(signal.SIGKILL), BY_HEARTBEAT),
    "host hung (SIGSTOP)": (sent(signal.SIGSTOP), BY_HEARTBEAT),
    "cable pulled": (lambda _stand, _process, emulator: lambda: emulator.do("unplug"), BY_HEARTBEAT),
}


@pytest.fixture
def stand() -> Iterator[Stand]:
    need_emulator()
    made = Stand()
    yield made
    made.close()


@pytest.mark.parametrize("way", WAYS)
def test_the_motor_is_off_in_time(stand: Stand, tmp_path: Path, way: str) -> None:
    prepare, allowed = WAYS[way]
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        with started(tmp_path) as process:
            start_down(stand)
            act = prepare(stand, process, emulator)
            begun = emulator.state()
            assert begun.motor != 0
            act()
            stand.until(lambda: emulator.state().motor == 0)
            taken = (emulator.state().motor_off_ms - begun.ms) * 1e-3
            print(f"{way}: motor off after {taken * 1e3:.0f} ms, allowed {allowed * 1e3:.0f} ms")
            assert taken <= allowed + 0.02
