# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node as others see it: its parameters, a reading of the ceiling as message and diagnostic status.

And what it does for a simulated ceiling: it starts where that of the plant stands, and has faults injected.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isnan

from atpid_interfaces.msg import CeilingState, PlantTruth
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from atpid_common.injected_faults import Injected
from atpid_common.latency import Latencies
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.messages import STEADY
from atpid_common.parameters import Value, rows_of
from atpid_common.vocabulary import Mode
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Reading
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.settings import MotorSettings

#: The node's parameters, as `MotorSettings` declares them.
TABLE = rows_of(MotorSettings)
_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def settings_of(value: Value) -> MotorSettings:
    """Return the settings that the parameters have, whose values `value` returns by name. Raises `SettingsError`."""
    return MotorSettings(**{row.name: value(row.name) for row in TABLE})


def state_of(reading: Reading, header: Header, *, handshake: bool) -> CeilingState:
    """Return the message of a reading; `handshake` marks its answer."""
    state = CeilingState(header=header, handshake=handshake, mode=reading.mode, homed=reading.homed)
    state.faults, state.fault = reading.faults, in_words(reading.faults)
    state.height, state.target, state.velocity = reading.height, reading.target, reading.velocity
    state.speed, state.sequence = reading.speed, reading.sequence
    return state


def status_of(
    node: Node, actuator: CeilingActuator, reading: Reading, last_error: str, latencies: Latencies
) -> DiagnosticStatus:
    """Return level, one line and the figures of `reading`; what the backend counts (`health`) is added as it is.

    latencies: from a sample to the receipt of the command that answers it.
    """
    health = actuator.health()
    values = {
        "mode": reading.mode.name.lower(),
        "homed": str(reading.homed).lower(),
        "height [m]": f"{reading.height:.4f}",
        "target [m]": f"{reading.target:.4f}",
        "faults": in_words(reading.faults) or "none",
        "last error": last_error or health.pop("last error", "") or "none",
    }
    hardware_id = health.pop("hardware_id", "") or "none"
    values |= latencies.values("sample to command received") | health
    level = _LEVELS.get(reading.mode, DiagnosticStatus.OK)
    message = in_words(reading.faults) or reading.mode.name.lower()
    return status(node, "ceiling motor", level, message, values, hardware_id)


_TRUTH = "ceiling/truth"
_ANNOUNCE_AFTER = 3.0  # until the wait is logged: discovery takes up to so long [s]


class PlantCeiling:
    """Calls `place` once with the height [m] of the plant's ceiling, from the plant's handshake or its last block.

    A motor node that is started in mid-run must not move the plant's ceiling by assuming a height.
    """

    def __init__(self, node: Node, place: Callable[[float], None]) -> None:
        """Subscribe to plant/truth until the height is known."""
        self._node, self._place = node, place
        # without event handlers, which the lockstep bench takes out of its executor: it could not be destroyed then
        bare = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._truth: Subscription | None = subscribe(
            node, PlantTruth, "plant/truth", self._on_truth, 1, event_callbacks=bare
        )
        self._timer = node.create_timer(_ANNOUNCE_AFTER, self._announce, clock=STEADY)

    def _on_truth(self, truth: PlantTruth) -> None:
        if self._truth is None or not len(truth.ceiling):
            return
        self._timer.cancel()
        self._node.destroy_subscription(self._truth)
        self._truth = None
        self._place(truth.ceiling[-1])

    def _announce(self) -> None:
        self._timer.cancel()
        self._node.get_logger().warning(
            "initial_height is NaN: waiting for plant/truth, which holds where the simulated ceiling stands; set "
            "initial_height [m] where there is no plant"
        )


class FaultInjection:
    """The faults injected into a ceiling, whose times count from the begin of a run.

    Each call returns the ceiling that has them, which may be another one. With faults a reading may be another height
    than the ceiling's: where it really stands is published as `ceiling/truth`.
    """

    def __init__(self, node: Node, begin: int | None) -> None:
        """Inject none yet; begin: of the run [ns], None: it has not begun."""
        self._node, self._begin = node, begin
        self._faults: Sequence[Injected] = ()
        self._truth: Publisher | None = None

    def change(self, actuator: CeilingActuator, faults: Sequence[Injected], now: int) -> CeilingActuator:
        """Inject these faults and no others, once the run has begun."""
        self._faults = faults
        if faults and self._truth is None:
            self._truth = self._node.create_publisher(CeilingState, _TRUTH, 100)
        if self._begin is None:
            return actuator
        since = self._begin * 1e-9
        counted = [replace(fault, begin=fault.begin + since, end=fault.end + since) for fault in faults]
        return actuator.with_faults(counted, now)

    def begin(self, actuator: CeilingActuator, now: int) -> CeilingActuator:
        """Count the times of the faults from `now` [ns] on, where none are counted yet."""
        if self._begin is not None:
            return actuator
        self._begin = now
        return self.change(actuator, self._faults, now)

    def suspend(self, actuator: CeilingActuator, now: int) -> CeilingActuator:
        """Inject none until `begin`."""
        self._begin = None
        return actuator.with_faults((), now)

    def publish_truth(self, actuator: CeilingActuator, reading: Reading, header: Header, *, handshake: bool) -> None:
        """Publish where the ceiling really stands, where that is known and was asked for by a fault."""
        height = actuator.true_height
        if self._truth is not None and not isnan(height):
            true = replace(reading, mode=Mode.MOVING, height=height, target=height)
            self._truth.publish(state_of(true, header, handshake=handshake))
