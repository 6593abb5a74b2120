# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The real firmware against harmful frames, its look-up table, and that its figures are those of the driver."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from motor_rigs import board, need_emulator

from atpid_common.vocabulary import Mode
from atpid_driver.emulator import build_firmware
from atpid_driver.emulator.client import SteppedHost
from atpid_driver.motor.faults import WORDS, MotorFault
from atpid_driver.motor.protocol import COMMANDS, PROTOCOL, REFUSALS, Refusal, StateReply, decode
from atpid_driver.motor.settings import MotorSettings
from studies.firmware.fuzz import fuzz

DRIVER = Path(__file__).resolve().parents[2] / "atpid_driver"
PROTOCOL_TEXT = DRIVER.parent / "docs" / "motor_protocol.md"


#: A tenth of a minute; more by `python -m studies fuzz --frames N`.
FRAMES = 20_000


@pytest.mark.slow
def test_harmful_frames_move_nothing(tmp_path: Path) -> None:
    with board(tmp_path, height=0.98) as emulator:
        result = fuzz(emulator, frames=FRAMES, seed=20)
        assert (result.frames, result.moved_um, result.switched, result.resets) == (FRAMES, 0.0, 0, 0)
        assert result.rejected > FRAMES / 2, "the frames did reach the parser"
        assert emulator.state().board == "running"


TABLE = """
#include <stdint.h>
#define ATPID_TABLE_N 3
static const uint32_t atpid_amplitude_um[ATPID_TABLE_N] PROGMEM = {10000, 15000, 30000};
static const uint32_t atpid_height_um[ATPID_TABLE_N] PROGMEM = {200000, 290000, 999000};
"""


@pytest.mark.slow
@pytest.mark.parametrize(("amplitude", "height"), [(10_000, 0.2), (12_600, 0.29), (22_499, 0.29), (30_000, 0.999)])
def test_lookup_takes_the_nearest_amplitude(tmp_path: Path, amplitude: int, height: float) -> None:
    need_emulator()
    header = tmp_path / "table.h"
    header.write_text(TABLE)
    firmware = build_firmware(header, tmp_path / "build")
    with board(tmp_path, height=0.98, firmware=firmware) as emulator:
        host = SteppedHost(emulator)
        host.make_ready()
        assert host.request("LOOKUP", 9_999) == host.request("LOOKUP", 30_001) == Refusal("RANGE")
        state = host.request("LOOKUP", amplitude)
        assert isinstance(state, StateReply)
        assert state.target == height


def test_every_frame_in_the_document_has_its_right_check_sum() -> None:
    frames = re.findall(r"`(\$\d+,[A-Z]+\*[0-9A-F]{4})`", PROTOCOL_TEXT.read_text())
    assert len(frames) == 2
    for frame in frames:
        decode(frame.encode())


def constants(name: str) -> dict[str, str]:
    """Return the constants of a firmware header by name."""
    text = (DRIVER / "firmware" / name).read_text()
    return dict(re.findall(r"constexpr \w+ (\w+) = ([^;]+);", text))


def test_fault_bits_are_the_drivers() -> None:
    bits = {name: int(value.split("<<")[1]) for name, value in constants("faults.h").items() if "<<" in value}
    on_the_wire = {fault.name: fault.value for fault in MotorFault if fault < 1 << 16}
    assert {name: 1 << bit for name, bit in bits.items()} == on_the_wire


def test_modes_are_the_drivers() -> None:
    text = (DRIVER / "firmware" / "motion.h").read_text()
    modes = dict(re.findall(r"(\w+) = (\d)", text[text.index("enum class Mode") : text.index("enum class Answer")]))
    assert {name: int(value) for name, value in modes.items()} == {m.name: m.value for m in Mode if m}


def test_parameter_file_fits_the_firmware() -> None:
    figures = constants("config.h")
    given: dict[str, Any] = yaml.safe_load((DRIVER / "config" / "motor_serial.yaml").read_text())
    settings = MotorSettings(**given["/**/motor_node"]["ros__parameters"])
    assert settings.lowest >= int(figures["LOWEST_UM"]) / 1e6
    assert settings.highest <= int(figures["HIGHEST_UM"]) / 1e6
    assert settings.speed == int(figures["SPEED_UM_PER_S"]) / 1e6
    assert settings.baud == int(figures["BAUD"])
    assert int(figures["PROTOCOL_VERSION"]) == PROTOCOL


def test_simulated_parameter_file_loads() -> None:
    given: dict[str, Any] = yaml.safe_load((DRIVER / "config" / "motor.yaml").read_text())
    assert MotorSettings(**given["/**/motor_node"]["ros__parameters"]).backend == "simulated"


def test_the_document_names_every_command_refusal_and_fault() -> None:
    text = PROTOCOL_TEXT.read_text()
    for word in (*COMMANDS, *REFUSALS):
        assert f"`{word}`" in text, word
    for fault, words in WORDS.items():
        assert f"| {fault.value.bit_length() - 1} | `{fault.name}` | {words}" in text, fault.name
