# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid doctor` against a right stand and wrong ones, real where that can be: port, board, library, disk, rights."""

import datetime
import json
import os
import pty
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from doctor_rig import Stand, calibration, machine, problems

from atpid_common.claim import claimed
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_control.stand.doctor import devices
from atpid_control.stand.doctor.checks import block, verdict_of
from atpid_control.stand.doctor.findings import Verdict
from atpid_control.stand.doctor.software import _workspace
from atpid_driver.emulator import PACKAGES, Emulator, build_firmware, missing_tools
from atpid_driver.standins import Control, build
from atpid_driver.standins.control import SERIAL
from atpid_driver.standins.outputs import Outputs

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
WRONG, DEGRADED = Verdict.WOULD_FAIL, Verdict.DEGRADED


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
        yield Stand(tmp_path, ROOT / "scenes/stand_realtime.yaml", build() / "libLabJackM.so", SERIAL)


@contextmanager
def board(folder: Path, **options: Any) -> Iterator[Emulator]:
    if missing := missing_tools():
        text = f"left out: the emulated board; missing {', '.join(missing)}: apt-get install {PACKAGES}"
        pytest.fail(text) if os.environ.get("CI") == "true" else pytest.skip(text)
    with Emulator(folder / "board", eeprom=folder / "eeprom", bootloader=0.05, reset_on_open=True, **options) as made:
        made.pace(1.0)
        yield made


def test_a_right_stand_is_right_in_under_ten_seconds(stand: Stand) -> None:
    with board(stand.folder) as emulator:
        begun, before = time.monotonic(), emulator.state()
        rows = stand.rows()
        assert time.monotonic() - begun < 10.0
        after = emulator.state()
    assert (after.switched, after.travel_um) == (before.switched, before.travel_um)  # the motor was never on
    refused = {"real time"} if refusal(LOOP_PRIORITY) else set()
    # the workspace is the one that tests run in, whose messages may be older, and the disk and clock are this machine's
    left = [row for row in rows if row.check not in {"workspace", *refused}]
    assert problems(left) == []
    assert not any(row.verdict is WRONG for row in rows)
    assert {row.check for row in rows if row.verdict is Verdict.NOT_CHECKED} == {"NI", "exciter"}
    assert block(left).endswith("the stand can be started")
    assert str(Path.home()) not in block(rows)


#: What is made wrong at the board's side, with the emulator; and what is found.
BOARDS: dict[str, tuple[Callable[[Emulator, Stand], object], str]] = {
    "emergency stop": (lambda board, _: board.set("stop", "open"), "it would not be armed: emergency stop pressed"),
    "sensor's wire": (lambda board, _: board.set("sensor", "open"), "it would not be armed: position sensor open"),
    "limits": (lambda _, stand: stand.values["motor_node"].update(lowest=0.001), "limits 0.001 to 1 m asked for"),
    "speed": (lambda _, stand: stand.values["motor_node"].update(speed=0.5), "the firmware's is 0.3 m/s"),
    "no power": (lambda board, _: board.do("power 0"), "nothing answers as ATPID-MOTOR within 2 s"),
}


@pytest.mark.parametrize("name", BOARDS)
def test_a_wrong_board_is_named(stand: Stand, name: str) -> None:
    change, expected = BOARDS[name]
    with board(stand.folder) as emulator:
        emulator.run(0.5)
        change(emulator, stand)
        found = problems(stand.rows("board"))
    assert [text for verdict, text in found if verdict is WRONG and expected in text], found


def test_another_firmware_is_named(stand: Stand) -> None:
    source = stand.folder / "share/atpid_driver/firmware"
    shutil.copytree(ROOT / "atpid_driver/firmware", source, ignore=shutil.ignore_patterns("build"))
    config = source / "config.h"
    config.write_text(config.read_text().replace('FIRMWARE_VERSION "1.', 'FIRMWARE_VERSION "3.'))
    with board(stand.folder, firmware=_built(source)):
        found = problems(stand.rows("board"))
    assert [text for _, text in found if "firmware 3." in text and "this driver needs 1.x" in text], found


def _built(source: Path) -> Path:
    if missing_tools():
        return build_firmware()  # left out by `board`
    subprocess.run(["make", "-s", "-C", str(source)], check=True, capture_output=True)
    return source / "build/atpid_motor.elf"


def _held(stand: Stand) -> subprocess.Popen[str]:
    """Let another program open the port, and give the checks this machine's processes."""
    stand.root = Path("/")
    code = "import sys; file = open(sys.argv[1], 'rb', buffering=0); print('held', flush=True); sys.stdin.read()"
    words = [sys.executable, "-c", code, stand.values["motor_node"]["port"]]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def port(stand: Stand) -> Iterator[Path]:
    """A port behind which nobody answers."""
    own, other = pty.openpty()
    path = Path(os.ttyname(other))
    stand.values["motor_node"]["port"] = str(path)
    os.close(other)  # else this process holds it
    yield path
    os.close(own)


def test_a_port_that_another_program_holds_is_not_opened(stand: Stand, port: Path) -> None:
    process = _held(stand)
    try:
        found = problems(stand.rows("board"))
    finally:
        process.communicate("")
    assert [text for _, text in found if f"{port} is held by" in text and str(process.pid) in text], found


def test_a_port_without_rights_is_named_with_the_group(stand: Stand, port: Path) -> None:
    subject = stand.subject()
    assert subject.parameters["motor_node"]["port"] == str(port)  # read, and all imported, while this is allowed
    port.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        found = list(devices.board(subject))
    finally:
        os.seteuid(user)
    assert [(one.verdict, one.found) for one in found] == [(WRONG, f"{port} may not be opened by this user")]
    assert "usermod -aG" in found[0].mend


def test_a_port_that_is_a_file_or_missing_is_named(stand: Stand) -> None:
    assert "is not there; there are: no serial ports" in problems(stand.rows("board"))[0][1]
    (stand.folder / "board").write_text("")
    assert "is no serial port" in problems(stand.rows("board"))[0][1]


#: One thing wrong with the machine's files: check, file, its text, verdict, what is found.
MACHINES = {
    "latency": ("USB", "sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16", DEGRADED, "for 16 ms"),
    "ModemManager": ("USB", "proc/77/comm", "ModemManager", DEGRADED, "ModemManager runs"),
    "clock": ("clock", "run/systemd/timesync/synchronized", None, DEGRADED, "kept by nothing"),
    "loopback": ("middleware", "sys/class/net/lo/flags", "0x8", WRONG, "the loopback interface is down"),
    "udev": ("LabJack", "etc/udev/rules.d/90-labjack.rules", None, DEGRADED, "no udev rule of LabJack"),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_wrong_machine_is_named(stand: Stand, name: str) -> None:
    check, file, text, verdict, expected = MACHINES[name]
    stand.root = machine(stand.folder / "wrong", {file: text})
    ((found, said),) = problems(stand.rows(check))
    assert found is verdict
    assert expected in said


#: One environment variable that is wrong: its check, and as above.
VARIABLES = {
    "RMW_IMPLEMENTATION": ("middleware", "rmw_none_cpp", WRONG, "middleware rmw_none_cpp is not installed"),
    "ROS_DOMAIN_ID": ("middleware", "999", WRONG, "given '999'; allowed: 0 to 232"),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": (
        "middleware",
        "SUBNET",
        DEGRADED,
        "range of discovery SUBNET to every computer of the network",
    ),
    "FASTRTPS_DEFAULT_PROFILES_FILE": ("middleware", "/none.xml", WRONG, "/none.xml, the profile of Fast DDS, is miss"),
    "ROS_DISTRO": ("middleware", "humble", WRONG, "ROS humble is sourced"),
    "ROS_SECURITY_ENABLE": ("middleware", "true", WRONG, "security on, keys not found"),
    "PATH": ("workspace", "/nowhere", WRONG, "env, setpriv not on the path"),
}


@pytest.mark.parametrize("name", VARIABLES)
def test_a_wrong_variable_is_named(stand: Stand, name: str) -> None:
    check, value, verdict, expected = VARIABLES[name]
    stand.environment[name] = value
    found = problems(stand.rows(check))
    assert [text for seen, text in found if seen is verdict and expected in text], found


def test_a_range_that_does_not_exist_and_a_high_domain_are_named(stand: Stand) -> None:
    stand.environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCAL", "ROS_DOMAIN_ID": "150"}
    assert problems(stand.rows("middleware")) == [(WRONG, "range of discovery LOCAL"), (DEGRADED, "domain 150")]


def test_nodes_that_run_and_a_domain_in_use_are_named(stand: Stand) -> None:
    domain = stand.environment["ROS_DOMAIN_ID"]
    holder = claimed(f"{domain}/motor_node")
    assert holder is not None
    with holder, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 7400 + 250 * int(domain)))
        assert problems(stand.rows("nodes")) == [(WRONG, "run already: motor_node")]
        assert problems(stand.rows("middleware")) == [(DEGRADED, f"domain {domain}, in which programs run already")]


#: A parameter, or a channel's calibration, that is wrong: check, node, change, verdict, what is found.
VALUES: dict[str, tuple[str, str, dict[str, Any], Verdict, str]] = {
    "no library": ("LabJack", "labjack_node", {"library": "/none.so"}, WRONG, "libLabJackM.so is not installed"),
    "a broken library": ("LabJack", "labjack_node", {"library": __file__}, WRONG, "invalid ELF header"),
    "another T7": ("LabJack", "labjack_node", {"serial": 7}, WRONG, f"serial number {SERIAL}, expected 7"),
    "any T7": ("LabJack", "labjack_node", {"serial": 0}, DEGRADED, "serial 0: any device is taken"),
    "wiring": ("LabJack", "labjack_node", {"terminals": ["AIN0"]}, WRONG, "2 channels, 1 terminals"),
    "order": ("calibrations", "labjack_node", {"channels": ["beam_displacement", "support_displacement"]}, WRONG,
              "channel beam_displacement was given the calibration of support_displacement"),
    "no file": ("calibrations", "labjack_node", {"calibrations": ["none.yaml", "none.yaml"]}, WRONG, "no such file"),
    "no levels": ("parameters", "supervisor_node", {"beam_displacement_abort": float("inf")}, DEGRADED,
                  "abort levels: none: however far the beam moves"),
    "a node's name": ("parameters", "labjak_node", {"serial": 1}, WRONG, "did you mean labjack_node?"),
    "a type": ("parameters", "labjack_node", {"rate": "fast"}, WRONG, "given 'fast'; allowed: a float"),
    "a parameter's name": ("parameters", "selector_node", {"dead_bond": 0.1}, WRONG, "did you mean dead_band?"),
    "a range": ("parameters", "identifier_node", {"window_periods": 99.0}, WRONG, "given 99; allowed: 1 to 20"),
    "travel": ("travel", "motor_node", {"highest": 0.5}, WRONG, "allowed: a scene inside the motor's range"),
}  # fmt: skip


@pytest.mark.parametrize("name", VALUES)
def test_a_wrong_value_is_named(stand: Stand, name: str) -> None:
    check, node, change, verdict, expected = VALUES[name]
    stand.values.setdefault(node, {}).update(change)
    found = problems(stand.rows(check))
    assert [text for seen, text in found if seen is verdict and expected in text], found


def test_a_device_that_is_unplugged_is_named(stand: Stand, control: Control) -> None:
    control.unplug()
    assert "no T7 answers: check cable, power and `serial`" in problems(stand.rows("LabJack"))[0][1]


TODAY = datetime.date.today()
#: What is wrong with a calibration, and what is found.
CALIBRATIONS: dict[str, tuple[dict[str, Any], Verdict, str]] = {
    "old": ({"date": TODAY - datetime.timedelta(days=500)}, DEGRADED, "; 500 days old"),
    "to come": ({"date": TODAY + datetime.timedelta(days=9)}, WRONG, "made in the future"),
    "unit": ({"unit": "mm"}, WRONG, "; needed: m"),
    "nominal": ({"source": "nominal, data sheet"}, DEGRADED, "nominal figures of the data sheet"),
    "few readings": ({"readings": 3}, DEGRADED, "3 readings; few or bad readings"),
    "scatter": ({"residual_std": 0.1}, DEGRADED, "few or bad readings"),
    "range": ({"coefficients": (-0.225, 0.075)}, DEGRADED, "reads ±0.15 m, the scene's closed damper ±0.667"),
}


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_a_wrong_calibration_is_named(stand: Stand, name: str) -> None:
    changed, verdict, expected = CALIBRATIONS[name]
    calibration(stand.folder, "beam_displacement", **changed)
    found = problems(stand.rows("calibrations", "ranges"))
    assert [text for seen, text in found if seen is verdict and expected in text], found


@pytest.fixture
def exciter(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> Outputs:
    """A T7 that drives an inverter, its settings in a file of the user's."""
    monkeypatch.setenv("ATPID_LJM_OUTPUT", str(stand.folder / "output"))
    text = (
        (ROOT / "atpid_driver/config/excitation.yaml").read_text().replace("backend: simulated", "backend: labjack_dac")
    )
    stand.options.excitation_config = stand.folder / "excitation.yaml"
    stand.options.excitation_config.write_text(text)
    file = calibration(stand.folder, "drive_frequency", unit="Hz", coefficients=(0.0, 2.0), limits_volts=(0.0, 5.0))
    library = stand.values["labjack_node"]["library"]
    stand.values["excitation_node"] = {"calibration": file, "calibration_folder": str(stand.folder), "library": library}
    return Outputs(stand.folder / "output")


def test_an_exciter_is_opened_and_closed_with_its_output_off(stand: Stand, exciter: Outputs) -> None:
    found = stand.rows("exciter")
    assert problems(found) == []
    assert [row.found for row in found][1] == f"labjack:{SERIAL} DAC0 answers"
    assert exciter.volts(0) == 0.0


#: A parameter of the exciter that is wrong, and what is found.
EXCITERS: dict[str, tuple[dict[str, Any], str]] = {
    "no file": ({"calibration": "none.yaml"}, "none.yaml"),
    "no calibration": ({"calibration": ""}, "calibration is empty"),
    "the sensors'": ({"calibration": "beam_displacement.yaml"}, "given channel beam_displacement; backend labjack_dac"),
    "limits": ({"lowest_frequency": 90.0}, "need 0 < lowest < highest"),
    "library": ({"library": "/none.so"}, "libLabJackM.so is not installed"),
    "another T7": ({"serial": 7}, "expected 7"),
}


@pytest.mark.parametrize("name", EXCITERS)
def test_a_wrong_exciter_is_named(stand: Stand, exciter: Outputs, name: str) -> None:
    changed, expected = EXCITERS[name]
    stand.values["excitation_node"] |= changed
    found = problems(stand.rows("exciter"))
    assert [text for seen, text in found if seen is WRONG and expected in text], found


def test_an_exciter_without_limits_or_that_runs_is_named(stand: Stand, exciter: Outputs) -> None:
    holder = claimed(f"{stand.environment['ROS_DOMAIN_ID']}/excitation_node")
    assert holder is not None
    with holder:
        assert stand.rows("exciter")[-1].found == "excitation_node runs: its output would be switched off"
    stand.options.excitation_config.write_text("/**/excitation_node: {ros__parameters: {backend: simulated}}")
    ((verdict, text),) = problems(stand.rows("exciter"))
    assert verdict is WRONG
    assert "'highest_amplitude', 'lowest_frequency', and 'highest_frequency'; give them in its parameter file" in text


def test_a_check_that_fails_leaves_the_others(stand: Stand) -> None:
    (stand.root / "sys/class/net/lo/flags").write_text("up")
    found = stand.rows("middleware", "clock")
    assert (DEGRADED, "the check itself failed: ValueError") in [(seen, text[:35]) for seen, text in problems(found)]
    assert found[-1].check == "clock"


def test_a_wrong_scene_is_named_once(stand: Stand) -> None:
    scene = stand.folder / "scene.yaml"
    scene.write_text((ROOT / "scenes/stand_realtime.yaml").read_text().replace("stiffness", "stifness"))
    stand.options.scene = scene
    found = problems(stand.rows("scene", "travel", "ranges"))
    assert len(found) == 1
    assert "did you mean stiffness?" in found[0][1]


def test_a_broken_map_is_named(stand: Stand) -> None:
    stand.options.map = ROOT / "README.md"
    assert [verdict for verdict, text in problems(stand.rows("scene")) if "README.md" in text] == [WRONG]


def test_a_disk_that_cannot_take_the_recording_is_named(stand: Stand) -> None:
    stand.options.hours = 1e5
    assert problems(stand.rows("disk"))[0][0] is WRONG
    stand.options.bag, stand.options.hours = Path("/proc/none/bag"), 1.0
    ((verdict, text),) = problems(stand.rows("disk"))
    assert verdict is WRONG
    assert "cannot be written" in text


def command(words: list[str], before: list[str], **variables: str) -> tuple[int, dict[str, str]]:
    """Run the command itself; return its status, and what is not right by check."""
    program = [sys.executable, "-m", "atpid_control.cli", "doctor", *words, "--json"]
    code = f"import sys; from atpid_control.cli import main; sys.exit(main({program[3:]!r}))"
    done = subprocess.run([*before, sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT,
                          env=os.environ | variables)  # fmt: skip
    checks = json.loads(done.stdout)["checks"]
    found: dict[str, str] = {}
    for one in checks:
        if one["mend"]:
            found[one["check"]] = f"{found.get(one['check'], '')} {one['found']}".strip()
    return done.returncode, found


@pytest.mark.skipif(os.geteuid() != 0, reason="takes the rights of root away")
def test_a_user_without_rights_and_a_full_disk(tmp_path: Path) -> None:
    rights = [
        "setpriv",
        "--inh-caps",
        "-all",
        "--bounding-set",
        "-sys_nice",
        "prlimit",
        "--fsize=1000000",
        "--memlock=1000000",
    ]
    levels = tmp_path / "levels.yaml"
    levels.write_text("/**/supervisor_node: {ros__parameters: {lock_memory: true}}")
    bag = tmp_path / "bag"
    status, found = command(["--bag", str(bag), "--params-file", str(levels)], rights)
    assert status == 2  # no board here
    assert "real-time priority 10 is not allowed" in found["real time"]
    assert "memory that may be locked: 1 MB" in found["real time"]
    assert f"{bag} cannot be written: File too large" in found["disk"]


def test_a_package_that_is_missing_fails_what_needs_it(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap", None)
    rows = stand.rows("packages")
    assert any(text.startswith("mcap: ModuleNotFoundError") for verdict, text in problems(rows) if verdict is WRONG)


@pytest.fixture
def workspace(stand: Stand) -> Path:
    """A copy of what is checked of the workspace that is sourced."""
    real, folder = _workspace(), stand.folder / "repository/ros2_ws"
    for name in ("machine.py", "requirements/wheels.txt", "requirements/sourced.txt"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(real / name, folder / name)
    for name in ("atpid_sim/package.xml", "atpid_sim/setup.py"):
        (folder.parent / name).parent.mkdir(exist_ok=True)
        shutil.copy(real.parent / name, folder.parent / name)
    package = folder / "install/atpid_control"
    for name in ("share/ament_index/resource_index/packages/atpid_control", "lib/atpid_control/identifier_node"):
        (package / name).parent.mkdir(parents=True)
        (package / name).touch()
    shutil.copy(real / "install/stamp", folder / "install/stamp")
    paths = stand.environment["AMENT_PREFIX_PATH"]
    stand.environment["AMENT_PREFIX_PATH"] = f"{package}:{paths}"
    return folder


def test_a_workspace_that_is_older_or_not_sourced_is_named(stand: Stand, workspace: Path) -> None:
    setup = workspace.parent / "atpid_sim/setup.py"
    setup.write_text(setup.read_text() + "# changed\n")
    found = [text for _, text in problems(stand.rows("workspace"))]
    assert found == [
        "sourced; older than its sources: atpid_sim", "code of another folder runs than that of the workspace",
    ]  # fmt: skip
    stand.environment["AMENT_PREFIX_PATH"] = ""
    ((verdict, text),) = problems(stand.rows("workspace"))
    assert verdict is WRONG
    assert "is not on the path: `make setup`, then `. ros2_ws/activate`" in text


def test_a_version_other_than_the_lock_s_is_named(stand: Stand, workspace: Path) -> None:
    for lock in (workspace / "requirements").glob("*.txt"):
        lock.write_text(lock.read_text().replace("\nrich==", "\nrich==99."))
    ((verdict, text),) = problems(stand.rows("packages"))
    assert verdict is DEGRADED
    assert "rich " in text
    assert " in place of 99." in text


def test_a_wall_clock_that_was_set_or_is_wrong_is_named(stand: Stand) -> None:
    now = time.monotonic_ns()
    found = problems(stand.rows("clock", begun=(time.time_ns() - 3_000_000_000, now)))
    assert "the wall clock was set by +3.0" in found[0][1]
    found = problems(stand.rows("clock", begun=(0, now)))
    assert (WRONG, "the wall clock shows 1970, kept by systemd-timesyncd") in found


def test_the_worst_finding_is_the_status() -> None:
    assert verdict_of([]) is Verdict.RIGHT
    status, found = command([], [], ROS_DOMAIN_ID="999")
    assert status == 2
    assert "999" in found["middleware"]
