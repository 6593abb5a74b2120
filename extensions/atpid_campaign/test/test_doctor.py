# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid doctor` against a right stand and wrong ones, real where that can be: port, board, library, disk, rights."""

import argparse
import datetime
import json
import math
import os
import pty
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import pytest
import yaml
from motor_rigs import need_emulator

from atpid_campaign.doctor import devices
from atpid_campaign.doctor.command import CHECKS, GROUP, add_arguments, all_checks, block, examine, verdict_of
from atpid_common.cli import Parser
from atpid_common.errors import AtpidError
from atpid_common.middleware import claimed
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_common.testing import install
from atpid_control.cli import main
from atpid_control.stand.findings import Finding, Subject, Verdict
from atpid_driver.calibration.model import Calibration, save
from atpid_driver.emulator import Emulator
from atpid_driver.standins import Control, build
from atpid_driver.standins.device import SERIAL

ROOT = Path(__file__).resolve().parents[3]
SCENE = ROOT / "scenes/stand_realtime.yaml"
TODAY = datetime.date.today()
AFTER_DEVICES = ["calibrations", "ranges", "real time", "USB", "disk", "clock"]
WRONG, DEGRADED = Verdict.WOULD_FAIL, Verdict.DEGRADED
#: What a machine's kernel shows where all is well.
MACHINE = {
    "proc/1/comm": "systemd",
    "sys/bus/usb-serial/devices/ttyUSB0/latency_timer": "1",
    "sys/class/net/lo/flags": "0x9",
    "sys/class/net/eth0/flags": "0x1003",
    "etc/udev/rules.d/90-labjack.rules": "",
    "run/systemd/timesync/synchronized": "",
}


class Stand:
    """A stand in a folder on which everything is right, until a test makes one thing wrong."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.root = folder, folder / "root"
        self.environment = os.environ
        parser = Parser()
        add_arguments(parser)
        words = [str(SCENE), "--bag", str(folder / "bag"), "--hours", "0.1"]
        self.options: argparse.Namespace = parser.parse_args(words)
        for name, text in MACHINE.items():
            self.write(name, text)
        library = str(build() / "libLabJackM.so")
        names = [self.calibrate(name) for name in ("support_displacement", "beam_displacement")]
        self.values: dict[str, dict[str, Any]] = {
            "motor_node": {"port": str(folder / "board"), "identify_timeout": 20.0},
            "labjack_node": {"library": library, "serial": SERIAL, "calibrations": names,
                             "calibration_folder": str(folder)},
            "supervisor_node": {"beam_displacement_abort": 0.9},
        }  # fmt: skip

    def write(self, name: str, text: str | None) -> None:
        """Write one of the machine's files; None: take it away."""
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text or "")
        if text is None:
            path.unlink()

    def calibrate(self, channel: str, **changed: Any) -> str:
        """Write a calibration of today that sees ±1 m; return its file's name."""
        values: dict[str, Any] = {
            "channel": channel, "sensor": "laser", "serial": "A17", "date": TODAY, "source": "readings", "unit": "m",
            "coefficients": (-1.5, 0.5), "limits_volts": (1.0, 5.0), "residual_std": 1e-4, "readings": 21,
        }  # fmt: skip
        save(Calibration(**values | changed), self.folder / f"{channel}.yaml")
        return f"{channel}.yaml"

    def subject(self, **changed: Any) -> Subject:
        """Return what is checked, its parameters written."""
        file = self.folder / "parameters.yaml"
        file.write_text(yaml.dump({f"/**/{node}": {"ros__parameters": one} for node, one in self.values.items()}))
        self.options.params_file = file
        return Subject(self.options, self.root, **changed)

    def rows(self, *names: str, **changed: Any) -> list[Finding]:
        """Return what the checks of these names find; of none given, all."""
        chosen = {name: place for name, place in all_checks().items() if not names or name in names}
        return list(examine(self.subject(**changed), chosen))

    def problems(self, *names: str, **changed: Any) -> list[tuple[Verdict, str]]:
        return problems(self.rows(*names, **changed))


def problems(rows: list[Finding]) -> list[tuple[Verdict, str]]:
    return [(row.verdict, row.found) for row in rows if row.verdict > Verdict.RIGHT]


@pytest.fixture
def control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    made = Control(tmp_path / "device")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(made.path))
    monkeypatch.setenv("ATPID_LJM_SOURCE", "sine")
    yield made
    made.close()


@pytest.fixture
def stand(tmp_path: Path, control: Control) -> Iterator[Stand]:
    with patch.dict(os.environ):
        yield Stand(tmp_path)


@contextmanager
def board(folder: Path, **options: Any) -> Iterator[Emulator]:
    need_emulator()
    with Emulator(folder / "board", eeprom=folder / "eeprom", bootloader=0.05, reset_on_open=True, **options) as made:
        made.pace(1.0)
        yield made


def test_a_right_stand_is_right(stand: Stand) -> None:
    with board(stand.folder) as emulator:
        before = emulator.state()
        rows = stand.rows()
        after = emulator.state()
    assert (after.switched, after.travel_um) == (before.switched, before.travel_um)  # the motor was never on
    refused = {"real time"} if refusal(LOOP_PRIORITY) else set()
    # the workspace is the one that tests run in, whose messages may be older, and the disk and clock are this machine's
    left = [row for row in rows if row.check not in {"workspace", *refused}]
    assert problems(left) == []
    assert not any(row.verdict is WRONG for row in rows)
    assert {row.check for row in rows if row.verdict is Verdict.NOT_CHECKED} - {"exciter"} == {"NI"}
    assert str(Path.home()) not in block(rows)


#: What is made wrong at the board's side; and what is found.
BOARDS: dict[str, tuple[Callable[[Emulator, Stand], object], str]] = {
    "emergency stop": (lambda board, _: board.set("stop", "open"), "emergency stop"),
    "sensor's wire": (lambda board, _: board.set("sensor", "open"), "sensor open"),
    "limits": (lambda _, stand: stand.values["motor_node"].update(lowest=0.001), "0.001 to 1 m"),
    "speed": (lambda _, stand: stand.values["motor_node"].update(speed=0.5), "0.3 m/s"),
    "no power": (lambda board, _: board.do("power 0"), "ATPID-MOTOR.* 0.5 s"),
}


@pytest.mark.parametrize("name", BOARDS)
def test_a_wrong_board_is_named(stand: Stand, name: str) -> None:
    change, expected = BOARDS[name]
    if name == "no power":
        stand.values["motor_node"]["identify_timeout"] = 0.5
    with board(stand.folder) as emulator:
        emulator.run(0.5)
        change(emulator, stand)
        found = stand.problems("board")
    assert [text for verdict, text in found if verdict is WRONG and re.search(expected, text)], found


@pytest.fixture
def port(stand: Stand) -> Iterator[Path]:
    own, other = pty.openpty()
    path = Path(os.ttyname(other))
    stand.values["motor_node"]["port"] = str(path)
    os.close(other)  # else this process holds it
    yield path
    os.close(own)


def test_a_port_that_another_program_holds_is_not_opened(stand: Stand, port: Path) -> None:
    stand.root = Path("/")  # with this machine's processes
    code = "import sys; file = open(sys.argv[1], 'rb', buffering=0); print('held', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        found = stand.problems("board")
        process.communicate("")
    assert [text for _, text in found if str(port) in text and str(process.pid) in text], found


def test_a_port_without_rights_is_named_with_the_group(stand: Stand, port: Path) -> None:
    subject = stand.subject()
    assert subject.parameters["motor_node"]["port"] == str(port)  # read, and all imported, while this is allowed
    port.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        (found,) = devices.board(subject)
    finally:
        os.seteuid(user)
    assert found.verdict is WRONG
    assert str(port) in found.found
    assert "usermod -aG" in found.mend


Change = Callable[[Stand], object]


def file(name: str, text: str | None) -> Change:
    return lambda stand: stand.write(name, text)


def variable(name: str, value: str) -> Change:
    return lambda stand: stand.environment.update({name: value})


def value(node: str, **changed: Any) -> Change:
    return lambda stand: stand.values.setdefault(node, {}).update(changed)


def sensor(**changed: Any) -> Change:
    return lambda stand: stand.calibrate("beam_displacement", **changed)


class Case(NamedTuple):
    """One thing that is made wrong, the check that finds it, and parts of what it finds."""

    check: str
    change: Change
    verdict: Verdict
    parts: str


ORDER = ["beam_displacement", "support_displacement"]
CASES = {
    # the machine's files
    "latency": Case("USB", file("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16"), DEGRADED, "16 ms"),
    "ModemManager": Case("USB", file("proc/77/comm", "ModemManager"), DEGRADED, "ModemManager"),
    "clock": Case("clock", file("run/systemd/timesync/synchronized", None), DEGRADED, "by nothing"),
    "loopback": Case("middleware", file("sys/class/net/lo/flags", "0x8"), WRONG, "loopback"),
    "udev": Case("LabJack", file("etc/udev/rules.d/90-labjack.rules", None), DEGRADED, "udev"),
    "a check that fails": Case("middleware", file("sys/class/net/lo/flags", "up"), DEGRADED, "ValueError"),
    # environment variables
    "middleware": Case("middleware", variable("RMW_IMPLEMENTATION", "rmw_none_cpp"), WRONG, "rmw_none_cpp"),
    "no domain": Case("middleware", variable("ROS_DOMAIN_ID", "999"), WRONG, "'999'.* 0 .* 232"),
    "wide": Case("middleware", variable("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"), DEGRADED, "SUBNET.*every"),
    "profile": Case("middleware", variable("FASTRTPS_DEFAULT_PROFILES_FILE", "/none.xml"), WRONG, "/none.xml"),
    "distribution": Case("middleware", variable("ROS_DISTRO", "humble"), WRONG, "humble"),
    "security": Case("middleware", variable("ROS_SECURITY_ENABLE", "true"), WRONG, "keys not"),
    "path": Case("workspace", variable("PATH", "/nowhere"), WRONG, "env, setpriv"),
    "not sourced": Case("workspace", variable("AMENT_PREFIX_PATH", ""), WRONG, "path.*activate"),
    # parameters
    "no library": Case("LabJack", value("labjack_node", library="/none.so"), WRONG, "libLabJackM.so"),
    "a broken library": Case("LabJack", value("labjack_node", library=__file__), WRONG, "ELF"),
    "another T7": Case("LabJack", value("labjack_node", serial=7), WRONG, rf"{SERIAL}\b.* 7\b"),
    "wiring": Case("LabJack", value("labjack_node", terminals=["AIN0"]), WRONG, "2 channels, 1 terminals"),
    "order": Case("calibrations", value("labjack_node", channels=ORDER), WRONG, f"{ORDER[0]} .* {ORDER[1]}"),
    "no calibration": Case("calibrations", value("labjack_node", calibrations=["no.yaml"] * 2), WRONG, "no.yaml"),
    "no levels": Case("parameters", value("supervisor_node", beam_displacement_abort=math.inf), DEGRADED, "none"),
    "a node's name": Case("parameters", value("labjak_node", serial=1), WRONG, r"labjack_node\?"),
    "a type": Case("parameters", value("labjack_node", rate="fast"), WRONG, "'fast'.* float"),
    "a parameter's name": Case("parameters", value("selector_node", dead_bond=0.1), WRONG, r"dead_band\?"),
    "a range": Case("parameters", value("identifier_node", window_periods=99.0), WRONG, " 99;.* 1 .* 20"),
    "travel": Case("travel", value("motor_node", highest=0.5), WRONG, "0.5"),
    "no port": Case("board", value("motor_node", port="/none"), WRONG, "/none .*no serial ports"),
    # calibrations
    "old": Case("calibrations", sensor(date=TODAY - datetime.timedelta(days=500)), DEGRADED, "500 days"),
    "to come": Case("calibrations", sensor(date=TODAY + datetime.timedelta(days=9)), WRONG, "future"),
    "unit": Case("calibrations", sensor(unit="mm"), WRONG, "needed: m$"),
    "nominal": Case("calibrations", sensor(source="nominal, data sheet"), DEGRADED, "nominal"),
    "scatter": Case("calibrations", sensor(residual_std=0.1), DEGRADED, "bad readings"),
    "reach": Case("ranges", sensor(coefficients=(-0.225, 0.075)), DEGRADED, r"±0\.15 .*±0\.667"),
    # the rest
    "scene": Case("scene", lambda stand: vars(stand.options).update(scene=ROOT / "README.md"), WRONG, "README.md"),
    "map": Case("scene", lambda stand: vars(stand.options).update(map=ROOT / "README.md"), WRONG, "README.md"),
    "a full disk": Case("disk", lambda stand: vars(stand.options).update(hours=1e5), WRONG, ""),
    "no disk": Case("disk", lambda stand: vars(stand.options).update(bag=Path("/proc/none/bag")), WRONG, "written"),
}


@pytest.mark.parametrize("name", CASES)
def test_one_wrong_thing_is_named(stand: Stand, name: str) -> None:
    check, change, verdict, parts = CASES[name]
    change(stand)
    rows = stand.rows(check, "clock")
    found = problems([row for row in rows if row.check == check])
    assert [text for seen, text in found if seen is verdict and re.search(parts, text)], found
    assert rows[-1].check == "clock"  # whatever another check found


def test_nodes_that_run_and_a_domain_in_use_are_named(stand: Stand) -> None:
    domain = stand.environment["ROS_DOMAIN_ID"]
    holder = claimed(f"{domain}/motor_node")
    assert holder is not None
    with holder, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 7400 + 250 * int(domain)))
        ((verdict, text),) = stand.problems("nodes")
        assert (verdict, text.endswith(": motor_node")) == (WRONG, True)
        ((verdict, text),) = stand.problems("middleware")
        assert (verdict, text.startswith(f"domain {domain},")) == (DEGRADED, True)


def test_a_device_that_is_unplugged_is_named(stand: Stand, control: Control) -> None:
    control.unplug()
    verdict, text = stand.problems("LabJack")[0]
    assert (verdict, "T7" in text) == (WRONG, True)


def test_a_package_that_is_missing_is_named(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap", None)
    found = stand.problems("packages")
    assert [verdict for verdict, text in found if text.startswith("mcap: ModuleNotFoundError")] == [WRONG]


def test_a_wall_clock_that_was_set_or_is_wrong_is_named(stand: Stand) -> None:
    now = time.monotonic_ns()
    found = stand.problems("clock", begun=(time.time_ns() - 3_000_000_000, now))
    assert re.search(r"\+3\.[0-9]", found[0][1])
    found = stand.problems("clock", begun=(0, now))
    assert [verdict for verdict, text in found if "1970" in text] == [WRONG]


def test_an_installed_package_adds_its_checks(stand: Stand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check = """
from atpid_control.stand.findings import judged
CHECKS = {"valve": ("of_valves:check", "open it"), "clock": ("of_valves:check", "")}
def check(at):
    yield judged("the valve is shut", "open it", fails=True)
"""
    install(tmp_path, monkeypatch, f"[{GROUP}]\nof_valves = of_valves:CHECKS\n", of_valves=check)
    names = list(all_checks())
    assert [name for name in names if name != "exciter"] == [*names[: names.index("NI") + 1], "valve", *AFTER_DEVICES]
    assert all_checks()["clock"] == CHECKS["clock"]
    assert stand.problems("valve") == [(WRONG, "the valve is shut")]
    install(tmp_path, monkeypatch, f"[{GROUP}]\nof_valves = missing_valves:CHECKS\n")
    with pytest.raises(AtpidError, match="of_valves"):
        all_checks()


def test_the_worst_finding_is_the_status(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert verdict_of([]) is Verdict.RIGHT
    monkeypatch.setenv("ROS_DOMAIN_ID", "999")
    assert main(["doctor", "--json"]) == 2
    checks = json.loads(capsys.readouterr().out)["checks"]
    assert [one["found"] for one in checks if one["check"] == "middleware" and "999" in one["found"]]
