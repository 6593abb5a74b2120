# SPDX-License-Identifier: Apache-2.0
"""The motor's line in `diagnostics`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from atpid_driver.motor import CeilingActuator, Mode, Reading, in_words

_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def status_of(name: str, actuator: CeilingActuator, reading: Reading, last_error: str) -> DiagnosticStatus:
    """Return level, one line and the figures of `reading`; what the backend counts (`health`) is added as it is."""
    health = actuator.health()
    values = {
        "mode": reading.mode.name.lower(),
        "homed": str(reading.homed).lower(),
        "height [m]": f"{reading.height:.4f}",
        "target [m]": f"{reading.target:.4f}",
        "faults": in_words(reading.faults) or "none",
        "last error": last_error or health.pop("last error", "") or "none",
    }
    return DiagnosticStatus(
        level=_LEVELS.get(reading.mode, DiagnosticStatus.OK),
        name=f"{name}: ceiling motor",
        message=in_words(reading.faults) or reading.mode.name.lower(),
        hardware_id=health.pop("hardware_id", ""),
        values=[KeyValue(key=key, value=value) for key, value in (values | health).items()],
    )
