# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulated stand: the stand's own graph on a machine without hardware.

The vendor's LabJack package runs on a stand-in library, the motor node on a serial port behind which the real firmware
runs on an emulated ATmega2560. Both are connected to the simulated plant: it receives the ceiling's height from the
emulated motor, and its laser signals become the voltages that the stand-in device samples.
"""

import datetime
import math
from pathlib import Path

from atpid_common.injected_faults import CEILING, LINK
from atpid_control.stand import parts
from atpid_control.stand.parameters import BenchError, Parameters, combined
from atpid_control.stand.running import PLAIN, Commands, RosOptions, command_of
from atpid_driver.calibration.model import Calibration, save
from atpid_driver.standins.device import Control, Outputs, build, environment
from atpid_sim.scene import Scene

#: The plant's lasers under another name: the identifier's blocks come from the device, never from the plant.
_BEHIND = "emulated/sensors/laser"
_CALIBRATIONS = ("emulated_support.yaml", "emulated_beam.yaml")


def parameters_emulated(
    scene: Scene, scene_file: Path, height_map: Path | None, bag: Path, place: Path, *, board: bool, given: Parameters
) -> Parameters:
    """Return what each node starts with; `place` is the folder of the port and the feed, `board`: firmware is emulated.

    given: values of the user's parameter file.

    Raises BenchError for a ceiling without a controller, or with another speed than the firmware's.
    """
    if not scene.ceiling.controlled:
        raise BenchError("the emulated stand moves the ceiling by its motor: the scene's ceiling needs a controller")
    # its device has a clock, and the firmware a motor, of its own
    scene.refuse_faults("the emulated stand", ("clock", *CEILING))
    if not board:
        scene.refuse_faults("an emulated stand without its board (sudo make avr-tools)", LINK)
    parameters = parts.own_parameters(scene, scene_file, height_map, bag, lockstep=False, link=True)
    motor, ceiling = parts.SERIAL_MOTOR.configured(), parts.ceiling_parameters(scene)
    if abs(ceiling["speed"] - motor["speed"]) > 1e-9:
        raise BenchError(
            f"ceiling.speed {ceiling['speed']:g} m/s: the firmware's motor has {motor['speed']:g} m/s; "
            "change the scene, or firmware/config.h and motor_serial.yaml"
        )
    if board:
        parameters["motor_node"] = ceiling | {"port": str(place / "board"), "supervised": True}
    rate = scene.sensors.laser.rate
    sampled = {"rate": rate, "calibrations": list(_CALIBRATIONS)}
    channels = {"channels": [scene.driven_by.channel, "beam_displacement"]}
    if scene.drive == "force":
        sampled["calibrations"] = [str(_load_cell(scene, place)), _CALIBRATIONS[1]]
    parameters["labjack_node"] = sampled | channels | {"blocks_per_second": 1.0 / scene.recording.block}
    rest = [0.0, scene.initial_deflection - scene.static_deflection]
    parameters["feed_node"] = {"feed": str(place / "laser"), "topic": _BEHIND, "rest": rest} | sampled
    if excited := parts.exciter_of(scene):
        exciter, own = parts.added_part(parts.EXCITER), given.get(parts.EXCITER, {})
        parameters[parts.EXCITER], more = exciter.emulated(scene, place, exciter.simulated(scene) | own)
        parameters["feed_node"] |= more
    nodes = (*parts.PARTS, *excited, parts.LABJACK, parts.FEED)
    parameters[parts.SUPERVISOR.name] = parts.supervised(nodes, scene, scene_file)
    usual = parts.usual_parameters((*nodes, parts.SUPERVISOR), scene)
    return combined(usual | ({"motor_node": motor} if board else {}), parameters, given)


def _load_cell(scene: Scene, place: Path) -> Path:
    """Write the calibration of a load cell for the scene's forces into a folder, and return its file."""
    amplitude = scene.excitation.largest_amplitude
    if not 0.0 < amplitude < math.inf:
        raise BenchError("the emulated stand needs the range of its load cell: give the scene's force an amplitude")
    drive, gain = scene.driven_by, 0.2 * amplitude  # twice the scene's largest amplitude at 10 V
    return calibrated(place / "load_cell.yaml", drive.channel, drive.unit, (0.0, gain), (-10.0, 10.0))


def calibrated(
    path: Path, channel: str, unit: str, coefficients: tuple[float, float], volts: tuple[float, float]
) -> Path:
    """Write the calibration of an emulated device, and return its file."""
    about = {"sensor": "emulated", "serial": "none", "source": "definition", "date": datetime.date(2026, 11, 24)}
    save(Calibration(channel=channel, unit=unit, coefficients=coefficients, limits_volts=volts, **about), path)
    return path


def _emulator_command(scene: Scene, place: Path) -> list[str]:
    """Return the command of the emulated board, whose line has the scene's faults: outside of all that is tested."""
    faults = [word for fault in scene.injected if fault.part in LINK for word in ("--fault", str(fault))]
    return [str(parts.program()), "emulator", "--link", str(place / "board"), *faults]


def commands_emulated(
    scene: Scene, parameter_file: Path, place: Path, ros: RosOptions = PLAIN, *, board: bool
) -> Commands:
    """Return (name, command) of every process, in the order of stopping: sources first, the board last."""
    name, labjack = command_of(parts.LABJACK, parameter_file, ros)
    plant, words = command_of(parts.NODES["plant_node"], parameter_file, ros)
    # the motor first, so that Ctrl-C switches it off at once
    first, last = (parts.NODES["motor_node"], parts.SUPERVISOR), (parts.FEED, *parts.LOOP)
    commands = [
        *(command_of(part, parameter_file, ros) for part in first),
        (plant, [*words, "-r", f"sensors/laser:={_BEHIND}", "-r", "excitation/state:=emulated/excitation/state"]),
        (name, ["env", *_device_environment(place / "device", f"feed:{place / 'laser'}"), *labjack]),
        *(command_of(part, parameter_file, ros) for part in last),
    ]
    for part in parts.exciter_of(scene):
        exciter, words = command_of(part, parameter_file, ros)
        own = _device_environment(place / "exciter", output=place / "output")  # another one than that of the lasers
        commands.insert(1, (exciter, ["env", *own, *words]))
    return [*commands, ("emulator", _emulator_command(scene, place))] if board else commands


def _device_environment(control: Path, source: str = "", output: Path | None = None) -> list[str]:
    """Return the environment in which the vendor's package finds the stand-in, which is built where it is missing."""
    libraries = build()
    Control(control).close()  # the device's files, which must be there when it is opened
    if output is not None:
        Outputs(output)
    ni = control if output else None  # an exciter's device may be either
    values = environment(
        libraries, ljm_control=control, ljm_source=source, ljm_output=output, daqmx_control=ni, daqmx_output=output
    )
    return [f"{name}={value}" for name, value in values.items()]
