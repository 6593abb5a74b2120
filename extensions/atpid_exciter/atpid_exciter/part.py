# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node as part of bench and stand (entry point of the group `atpid.nodes`), and its check."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from atpid_common.files import Document
from atpid_control.stand.findings import Finding, NotCheckedError, Subject, judged, judged_calibration
from atpid_control.stand.parts import EXCITER, AddedPart, Part
from atpid_exciter.excitation import ExcitationSettings, drive_of
from atpid_sim.scene import Scene

#: Output of the stand-in NI module.
_NI_OUTPUT = "cDAQ1Mod1/ao0"


def simulated(scene: Scene) -> Document:
    """Return backend and limits of the simulated exciter: any amplitude of the scene, at any useful frequency."""
    own = scene.natural_frequency_hz
    return {
        "backend": "simulated",
        "highest_amplitude": scene.excitation.largest_amplitude,
        "lowest_frequency": 0.1 * own,
        "highest_frequency": 10.0 * own,
    }


def emulated(scene: Scene, place: Path, own: Document) -> tuple[Document, Document]:
    """Return the parameters of the excitation node and those of the feed: a shaker, or an eccentric drive.

    own: of the excitation node, whose backend may be labjack_dac or nidaqmx; each is calibrated over its range.
    """
    from atpid_control.stand.emulated import calibrated

    backend = own["backend"] if own["backend"] in ("labjack_dac", "nidaqmx") else "labjack_stream"
    level, most = backend == "labjack_dac", own["highest_amplitude"]
    top = own["highest_frequency"] if level else 3.0 * most  # a controller may need more than the command
    channel, unit = ("drive_frequency", "Hz") if level else ("drive_amplitude", scene.driven_by.unit)
    low, high = (-10.0, 10.0) if backend == "nidaqmx" else (0.0, 5.0)
    least = 0.0 if level else -top
    gain = (top - least) / (high - low)
    path = calibrated(place / "exciter.yaml", channel, unit, (least - gain * low, gain), (low, high))
    node = {**own, "backend": backend, "calibration": str(path), "supervised": True}
    if backend == "nidaqmx":
        node["terminal"] = _NI_OUTPUT
    return node, {"output": str(place / "output"), "output_calibration": str(path), "disc": most if level else 0.0}


PART = AddedPart(
    Part("atpid_exciter", EXCITER, "excitation.yaml"),
    table="atpid_exciter.nodes.excitation_node:TABLE",
    simulated=simulated,
    emulated=emulated,
)


def exciter(at: Subject) -> Iterator[Finding]:
    """Check the exciter's settings, its calibration, and its device, which is opened, its output off, and closed."""
    # here: a bench does not need them
    from atpid_driver.calibration.model import shipped_calibrations
    from atpid_exciter.excitation.outlets import calibration_of

    if not at.options.excitation_config:
        raise NotCheckedError("no exciter is driven (--excitation-config)")
    settings = at.settings(ExcitationSettings, EXCITER)
    if settings.backend != "simulated":
        yield judged_calibration(calibration_of(settings, shipped_calibrations()))  # raises CalibrationError
    if EXCITER in at.running():
        raise NotCheckedError(f"{EXCITER} runs: its output would be switched off")
    with closing(drive_of(settings, shipped_calibrations)) as drive:
        yield judged(f"{drive.connect()} answers")  # raises DriverError
