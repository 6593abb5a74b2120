# SPDX-License-Identifier: Apache-2.0
"""The state of the graph as the page shows it: nodes, motor, controller, recorder, and who has fallen silent."""

import math
from typing import Any

from atpid_control.live.rows import plain

#: Topics that come all the time in a running graph: silent after so long [s].
SILENT = {
    "sensors/laser": 1.0,
    "excitation": 1.0,
    "ceiling/command": 1.0,
    "ceiling/state": 1.0,
    "supervisor/state": 1.0,
    "recorder/status": 3.0,
}
#: The same that a topic of the loop is about.
_OF_SUPERVISOR = "supervisor/state"
#: Diagnostics of a node that come no more are dropped after so long [s].
_FORGOTTEN = 5.0
MODES = ("unconfigured", "disarmed", "homing", "holding", "moving", "fault")
POWERS = ("off", "off", "on", "on, at rest or self-locking", "on", "off until armed again")
SUPERVISOR = ("starting", "ready", "degraded", "fault", "safe: motor off", "shutdown")
LEVELS = ("ok", "warning", "error", "stale")


class GraphState:
    """The latest of everything that is not a plot. Times are steady [s]."""

    def __init__(self) -> None:
        self.restart()
        self._received: dict[str, float] = {}
        self._diagnostics: dict[str, tuple[float, int, str]] = {}

    def restart(self) -> None:
        """Forget what belongs to one run."""
        self._motor: dict[str, Any] = {}
        self._command: dict[str, Any] = {}
        self._excitation: dict[str, Any] = {}
        self._efficiency: dict[str, Any] = {}
        self._supervisor: dict[str, Any] = {}
        self._silences: list[tuple[str, float]] = []
        self._recorder: dict[str, Any] = {}
        self.finished = ""

    def received(self, topic: str, now: float) -> None:
        """Take that a message of a topic came."""
        self._received[topic] = now

    def on_motor(self, state: Any) -> None:
        """Take a CeilingState."""
        self._motor = {
            "mode": MODES[state.mode], "power": POWERS[state.mode], "on": state.mode in (2, 3, 4),
            "homed": bool(state.homed), "fault": state.fault,
            "height": plain(state.height), "target": plain(state.target), "speed": plain(state.speed),
        }  # fmt: skip

    def on_command(self, command: Any) -> None:
        """Take a CeilingCommand."""
        self._command = {
            "height": plain(command.height), "method": command.method, "reason": command.reason,
            "predicted": plain(command.predicted_amplitude),
        }  # fmt: skip

    def on_excitation(self, excitation: Any, quality: str) -> None:
        """Take an Excitation, whose quality is given in words."""
        names = ("amplitude", "amplitude_std", "frequency", "frequency_std", "beam_amplitude")
        self._excitation = {name: plain(getattr(excitation, name)) for name in names}
        self._excitation |= {"quality": quality, "origin": ("support", "beam")[excitation.origin]}

    def on_efficiency(self, now: float, mean: float) -> None:
        """Take the efficiency at the latest steady estimate, and the mean of all [-]."""
        self._efficiency = {"now": plain(now), "mean": plain(mean)}

    def on_supervisor(self, message: Any) -> None:
        """Take a SupervisorState."""
        self._supervisor = {
            "state": SUPERVISOR[message.state], "number": int(message.state), "permit": bool(message.permit),
            "reason": message.reason,
        }  # fmt: skip
        self._silences = list(zip(message.nodes, message.silence, strict=True))

    def on_recorder(self, status: Any) -> None:
        """Take a RecorderStatus."""
        self._recorder = {"recording": bool(status.recording), "bag": status.bag}

    def on_diagnostics(self, array: Any, now: float) -> None:
        """Take a DiagnosticArray."""
        for status in array.status:
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            self._diagnostics[status.name] = (now, min(level, len(LEVELS) - 1), status.message)

    def shown(self, now: float) -> dict[str, Any]:
        """Return the state as the page takes it; every part that has fallen silent is named."""
        silent = {
            topic: round(now - self._received[topic], 1)
            for topic, limit in SILENT.items()
            if topic in self._received and now - self._received[topic] > limit
        }
        return {
            "motor": self._motor, "command": self._command, "excitation": self._excitation,
            "efficiency": self._efficiency, "supervisor": self._supervisor, "recorder": self._recorder,
            "nodes": self._nodes(silent, now), "silent": silent, "seen": bool(self._received),
            "lost": bool(self._received) and now - max(self._received.values()) > min(SILENT.values()),
            "finished": self.finished,
        }  # fmt: skip

    def _nodes(self, silent: dict[str, float], now: float) -> list[dict[str, Any]]:
        """Return name, state in words, whether that is well, and the diagnostics that are not, of each node."""
        if not self._received:
            return []
        found: dict[str, dict[str, Any]] = {}
        for name, silence in self._silences:
            if _OF_SUPERVISOR in silent:
                text, well = "not known: the supervisor is silent", False
            elif math.isnan(silence):
                text, well = "has not answered yet", False
            else:
                well = silence < 0.5
                text = "answers" if well else f"no answer for {silence:.1f} s"
            found[name] = {"name": name, "text": text, "well": well}
        if self._supervisor:
            gone = _OF_SUPERVISOR in silent
            text = f"silent for {silent[_OF_SUPERVISOR]:.1f} s" if gone else self._supervisor["state"]
            found["supervisor_node"] = {"name": "supervisor_node", "text": text,
                                        "well": not gone and self._supervisor["number"] == 1}  # fmt: skip
        self._diagnostics = {key: one for key, one in self._diagnostics.items() if now - one[0] < _FORGOTTEN}
        for key, (_, level, message) in sorted(self._diagnostics.items()):
            name, _, task = key.partition(": ")
            node = found.setdefault(name, {"name": name, "text": "publishes diagnostics", "well": True})
            if level:
                node["well"] = False
                node["text"] += f"; {task}: {LEVELS[level]}, {message}"
        return list(found.values())
