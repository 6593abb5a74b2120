# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The processes of the load test: both hardware nodes on the stand-in libraries, and optionally a recorder."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from atpid_driver.calibration.model import shipped_calibrations
from atpid_driver.standins import build, environment

LASER, ACCELEROMETER = "sensors/laser", "sensors/accelerometer"
DRIVERS = {"labjack_node": LASER, "ni_node": ACCELEROMETER}
RECORDER, INNER_STATUS = "recorder_node", "recorder/inner_status"
STOP_S = 10.0
AXES = "xyz"


class Processes:
    """Each node its own process, as on the stand. `bag`: also record to it with atpid_control's recorder."""

    def __init__(self, folder: Path, domain: int, bag: Path | None) -> None:
        variables = environment(build(), ljm_source="ramp", daqmx_source="sine:offset=0,amplitude=0.5,frequency=50")
        self._environment = os.environ | variables | {"ROS_DOMAIN_ID": str(domain)}
        self._folder = folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        if bag is not None:
            types = [f"{topic} atpid_interfaces/msg/SampleBlock" for topic in DRIVERS.values()]
            remap = ["-r", f"recorder/status:={INNER_STATUS}"]
            self._start("atpid_control", RECORDER, {"bag": str(bag), "topics": types}, remap)
        for name, parameters in _parameters(folder).items():
            self._start("atpid_driver", name, parameters)

    def _start(self, package: str, name: str, parameters: dict[str, object], remap: Sequence[str] = ()) -> None:
        file = self._folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump({f"/**/{name}": {"ros__parameters": parameters}}))
        command = [sys.executable, "-m", f"{package}.nodes.{name}", "--ros-args", "--params-file", str(file), *remap]
        self.running[name] = subprocess.Popen(command, env=self._environment, stdout=2)  # stdout is for the result

    def ended(self) -> str:
        """Name a process that has ended by itself; empty: none."""
        return next((name for name, process in self.running.items() if process.poll() is not None), "")

    def processor_s(self) -> dict[str, float]:
        """Return the processor time each, and the listener in this process, has used [s]."""
        pids = {name: process.pid for name, process in self.running.items()} | {"listener": os.getpid()}
        return {name: processor_s(pid) for name, pid in pids.items()}

    def stop(self, names: tuple[str, ...]) -> None:
        """Interrupt and await the named processes that still run."""
        stopping = [self.running.pop(name) for name in names if name in self.running]
        for process in stopping:
            process.send_signal(signal.SIGINT)
        for process in stopping:
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def processor_s(pid: int) -> float:
    """Return the processor time a process has used, all its threads [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _parameters(folder: Path) -> dict[str, dict[str, object]]:
    """Return each driver's parameters: full rate, and a calibration for each axis."""
    shipped = yaml.safe_load((shipped_calibrations() / "accelerometer.yaml").read_text())
    for axis in AXES:
        (folder / f"{axis}.yaml").write_text(yaml.safe_dump(shipped | {"channel": f"acceleration_{axis}"}))
    common: dict[str, object] = {"handshake": True, "expect_recorder": True, "autostart": True}
    labjack: dict[str, object] = {
        "rate": 50_000.0,
        "blocks_per_second": 20.0,
        "channels": ["support_displacement", "beam_displacement"],
        "terminals": ["AIN0", "AIN1"],
        "calibrations": ["laser_support.yaml", "laser_beam.yaml"],
    }
    ni: dict[str, object] = {
        "rate": 12_800.0,
        "blocks_per_second": 10.0,
        "channels": [f"acceleration_{axis}" for axis in AXES],
        "terminals": ["ai0", "ai1", "ai2"],
        "kinds": ["iepe"],
        "calibrations": [f"{axis}.yaml" for axis in AXES],
        "calibration_folder": str(folder),
    }
    return {"labjack_node": common | labjack, "ni_node": common | ni}
