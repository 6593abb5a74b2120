# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The known motion with the real firmware on the emulated board: right, too slow, the wrong way, disturbed."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingState
from motor_graph import Stand
from motor_rigs import SERIAL, board, need_emulator

from atpid_common.errors import BAD_INPUT
from atpid_driver.emulator import Emulator
from atpid_driver.nodes.motor_node import MotorNode

pytestmark = pytest.mark.slow


@pytest.fixture
def stand() -> Iterator[Stand]:
    need_emulator()
    made = Stand()
    yield made
    made.close()


def run(stand: Stand, folder: Path, act: Callable[[Emulator], None], **change: Any) -> tuple[MotorNode, Emulator]:
    """Ask for the handshake until it is answered or the node ends; act on the board when the motion is announced."""
    announced = False

    def ended() -> bool:
        nonlocal announced
        if not announced and any(event.text.startswith("known motion: in") for event in stand.events):
            announced = True
            act(emulator)
        return node.done.done() or any(state.handshake for state in stand.states)

    with board(folder, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        given = SERIAL | {"port": str(folder / "board"), "initial_height": 0.97, "check_move": 0.1} | change
        node = stand.motor(**given)
        stand.until(ended, lambda: stand.command(float("nan"), 0.0, 0, handshake=True))
        if node.done.done():
            stand.until(lambda: "abort" in stand.kinds())
            before = emulator.state().travel_um
            stand.until(lambda: stand.states[-1].mode in (CeilingState.DISARMED, CeilingState.FAULT))
            assert emulator.state().travel_um == pytest.approx(before, abs=10_000), "motor off"
        stand.close_motor()
    return node, emulator


def test_the_firmware_moves_as_commanded_and_the_handshake_is_answered_afterwards(stand: Stand, tmp_path: Path) -> None:
    node, _ = run(stand, tmp_path, lambda _: None)
    assert not node.done.done(), node.error
    answered = next(state for state in stand.states if state.handshake)
    assert answered.height == pytest.approx(0.97, abs=2e-3)
    homed = [state.height for state in stand.states if state.homed]
    assert min(homed) == pytest.approx(0.87, abs=3e-3), "down: there is no room above"
    assert stand.events[-1].text == "known motion passed"


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("speed", 170_000, r"expected 0\.3 m/s within 25%, found at most 0\.1"),
        ("swapped", 1, r"expected -0\.100 m, found \+|the motor is off: .*against its command"),  # by node or firmware,
    ],
)
def test_a_motor_that_moves_otherwise_is_switched_off_and_the_node_ends(
    stand: Stand, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, value: int, found: str
) -> None:
    node, _ = run(stand, tmp_path, lambda emulator: emulator.set(name, value))
    assert node.done.done(), "passed"
    assert node.done.result() == BAD_INPUT
    assert re.search(found, node.error)
    assert f"error: {node.error}\n" in capfd.readouterr().err
    assert not any(state.handshake for state in stand.states)


def test_a_height_commanded_before_it_ends_the_node(stand: Stand, tmp_path: Path) -> None:
    node, _ = run(stand, tmp_path, lambda _: stand.command(0.5, 1.0, 1))
    assert node.done.done(), "passed"
    assert node.error.startswith("known motion: a height was commanded before it was made")
    assert min(state.height for state in stand.states if state.homed) > 0.95
