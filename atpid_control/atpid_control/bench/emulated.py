# SPDX-License-Identifier: Apache-2.0
"""The emulated stand: the stand's own graph on a machine without hardware.

The vendor's LabJack package runs on a stand-in library, the motor node on a serial port behind which the real firmware
runs on an emulated ATmega2560. Both are connected to the simulated plant: it receives the ceiling's height from the
emulated motor, and its laser signals become the voltages that the stand-in device samples.
"""

import shlex
import subprocess
import sys
from pathlib import Path

from atpid_common.injected_faults import CEILING, LINK
from atpid_control.graph import BenchError
from atpid_control.graph.parts import (
    LABJACK,
    NODES,
    PARTS,
    SERIAL_MOTOR,
    SUPERVISOR,
    Parameters,
    Part,
    ceiling_parameters,
    parameters_for,
    supervised,
)
from atpid_sim.scene import ControlledCeiling, Scene

Commands = list[tuple[str, list[str]]]

#: The plant's lasers under another name: the identifier's blocks come from the device, never from the plant.
_BEHIND = "emulated/sensors/laser"
_CALIBRATIONS = ("emulated_support.yaml", "emulated_beam.yaml")
_FEED = Part("atpid_driver", "feed_node", "labjack.yaml")


def missing_tools() -> tuple[str, ...]:
    """Return the Debian packages without which the firmware cannot be built and emulated here."""
    code = "from atpid_driver.emulator import missing_tools; print(*missing_tools())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError("package atpid_driver is not on the path: `make setup`, then `. ros2_ws/activate`")
    return tuple(done.stdout.split())


def parameters_emulated(
    scene: Scene, scene_file: Path, height_map: Path | None, bag: Path, place: Path, *, board: bool
) -> Parameters:
    """Return each node's parameters; `place` is the folder of the port and the feed, `board`: firmware is emulated.

    Raises BenchError for a ceiling without a controller, or with another speed than the firmware's.
    """
    if not isinstance(scene.ceiling, ControlledCeiling):
        raise BenchError("the emulated stand moves the ceiling by its motor: the scene's ceiling needs a controller")
    scene.refuse_faults(
        "the emulated stand", ("clock", *CEILING)
    )  # its device has a clock, and the firmware a motor, of its own
    if not board:
        scene.refuse_faults("an emulated stand without its board (sudo make avr-tools)", LINK)
    parameters = parameters_for(scene, scene_file, height_map, bag, lockstep=False, link=True)
    motor = SERIAL_MOTOR.configured()
    ceiling = ceiling_parameters(scene)
    if abs(ceiling["speed"] - motor["speed"]) > 1e-9:
        raise BenchError(
            f"ceiling.speed {ceiling['speed']:g} m/s: the firmware's motor has {motor['speed']:g} m/s; "
            "change the scene, or firmware/config.h and motor_serial.yaml"
        )
    if board:
        parameters["motor_node"] = motor | ceiling | {"port": str(place / "board"), "supervised": True}
        if injected := [str(fault) for fault in scene.injected if fault.part in LINK]:
            parameters["motor_node"] |= {"faults": injected}
    rate = scene.sensors.laser.rate
    sampled = {"rate": rate, "calibrations": list(_CALIBRATIONS)}
    blocks = {"blocks_per_second": 1.0 / scene.recording.block}
    parameters["labjack_node"] = LABJACK.configured() | sampled | blocks
    parameters["feed_node"] = {"feed": str(place / "laser"), "topic": _BEHIND} | sampled
    parameters[SUPERVISOR.name] = supervised((*PARTS, LABJACK, _FEED), scene, scene_file)
    return parameters


def commands_emulated(parameter_file: Path, place: Path, *, board: bool) -> Commands:
    """Return (name, command) of every process, in the order of stopping: sources first, the board last."""
    ros = ["--ros-args", "--params-file", str(parameter_file)]

    def node(part: Part, *more: str) -> tuple[str, list[str]]:
        return part.name, [str(part.executable), *ros, *more]

    name, labjack = node(LABJACK)
    commands = [
        # the motor first, so that Ctrl-C switches it off at once
        node(NODES["motor_node"]),
        node(SUPERVISOR),
        node(NODES["plant_node"], "-r", f"sensors/laser:={_BEHIND}"),
        (name, ["env", *_device_environment(place), *labjack]),
        node(_FEED),
        node(NODES["identifier_node"]),
        node(NODES["selector_node"]),
        node(NODES["recorder_node"]),
    ]
    emulator = [sys.executable, "-m", "atpid_driver.emulator", "run", "--link", str(place / "board")]
    return [*commands, ("emulator", emulator)] if board else commands


def _device_environment(place: Path) -> list[str]:
    """Return the environment in which LabJack's package finds the stand-in, which is built where it is missing."""
    command = [
        sys.executable, "-m", "atpid_driver", "standin",
        "--ljm-control", str(place / "device"), "--ljm-source", f"feed:{place / 'laser'}",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError((done.stderr.strip().splitlines() or ["the stand-in cannot be built"])[-1])
    return [word for line in done.stdout.splitlines() for word in shlex.split(line.removeprefix("export "))]
