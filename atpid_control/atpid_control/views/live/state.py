# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of the graph as the page shows it: nodes, motor, controller, recorder, and who has fallen silent."""

import math
from typing import Any

from atpid_common.vocabulary import Mode
from atpid_control.views.live.signals import plain
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency


class ShareSoFar:
    """The share by which the beam's amplitude lies below a reference: at the latest steady estimate, and its mean."""

    def __init__(self, scene: Scene, *, grain: bool) -> None:
        """Take the scene, and whether the reference is its structure with the grain held, or without the damper."""
        self._scene, self._grain = scene, grain
        self.restart()

    def restart(self) -> None:
        """Begin again: another run."""
        self.now = self.reference = math.nan  # share [-], and steady amplitude of the reference [m]
        self._sum, self._count = 0.0, 0

    @property
    def mean(self) -> float:
        """Mean over the steady estimates so far [-]; NaN: none yet."""
        return self._sum / self._count if self._count else math.nan

    def add(self, amplitude: float, frequency: float, beam: float) -> None:
        """Take a steady estimate: of the support [m, Hz], `beam` its amplitude [m]; NaN: not known, nor the share."""
        self.reference = self._scene.linear_amplitude(amplitude, frequency, grain=self._grain)
        self.now = efficiency(beam, self.reference)
        if math.isfinite(self.now):
            self._sum, self._count = self._sum + self.now, self._count + 1


def shares_of(scene: Scene | None) -> dict[str, ShareSoFar]:
    """Return efficiency, against the closed damper, and reduction, against the structure without it; none of None."""
    if scene is None:
        return {}
    return {"efficiency": ShareSoFar(scene, grain=True), "reduction": ShareSoFar(scene, grain=False)}


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
_MOTOR = "motor_node"
#: Diagnostics of a node that come no more are dropped after so long [s].
_FORGOTTEN = 5.0
POWERS = ("off", "off", "on", "on, at rest", "on", "off until armed again")
SUPERVISOR = ("starting", "ready", "degraded", "fault", "safe: motor off", "shutdown")
LEVELS = ("ok", "warning", "error", "stale")
QUALITIES = ("no estimate", "steady", "changing", "poor")


def _motor(state: Any) -> dict[str, Any]:
    return {
        "mode": Mode(state.mode).name.lower(), "power": POWERS[state.mode],
        "on": state.mode in (Mode.HOMING, Mode.HOLDING, Mode.MOVING),
        "homed": bool(state.homed), "fault": state.fault,
        "height": plain(state.height), "target": plain(state.target), "speed": plain(state.speed),
    }  # fmt: skip


def _command(command: Any) -> dict[str, Any]:
    return {
        "height": plain(command.height), "method": command.method, "reason": command.reason,
        "predicted": plain(command.predicted_amplitude),
    }  # fmt: skip


def _excitation(found: Any) -> dict[str, Any]:
    names = ("amplitude", "amplitude_std", "frequency", "frequency_std", "beam_amplitude")
    numbers = {name: plain(getattr(found, name)) for name in names}
    return numbers | {"quality": QUALITIES[found.quality], "origin": ("support", "beam")[found.origin]}


def _supervisor(message: Any) -> dict[str, Any]:
    return {
        "state": SUPERVISOR[message.state], "number": int(message.state), "permit": bool(message.permit),
        "reason": message.reason,
    }  # fmt: skip


def _recorder(status: Any) -> dict[str, Any]:
    return {"recording": bool(status.recording), "bag": status.bag}


#: By topic: the part of the page's state, and what it shows of a message.
_SHOWN = {
    "ceiling/state": ("motor", _motor),
    "ceiling/command": ("command", _command),
    "excitation": ("excitation", _excitation),
    "supervisor/state": ("supervisor", _supervisor),
    "recorder/status": ("recorder", _recorder),
}


class GraphState:
    """The latest of everything that is not a plot. Times are steady [s]."""

    def __init__(self) -> None:
        self._shown: dict[str, dict[str, Any]] = {"motor": {}, "supervisor": {}, "recorder": {}}
        self._silences: list[tuple[str, float]] = []
        self._received: dict[str, float] = {}
        self._diagnostics: dict[str, tuple[float, int, str]] = {}
        self.restart()

    def restart(self) -> None:
        """Forget what belongs to one run."""
        self._shown |= {"command": {}, "excitation": {}, "efficiency": {}, "reduction": {}}
        self.finished = ""

    def on_message(self, topic: str, message: Any, now: float) -> None:
        """Take a message of a topic."""
        self._received[topic] = now
        if topic in _SHOWN:
            name, read = _SHOWN[topic]
            self._shown[name] = read(message)
        if topic == _OF_SUPERVISOR:
            self._silences = list(zip(message.nodes, message.silence, strict=True))

    def on_share(self, name: str, **values: float) -> None:
        """Take efficiency or reduction: now and in the mean [-], and the amplitude of its reference [m]."""
        self._shown[name] = {key: plain(value) for key, value in values.items()}

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
        return self._shown | {
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
        motor, supervisor = self._shown["motor"], self._shown["supervisor"]
        if supervisor:
            gone = _OF_SUPERVISOR in silent
            text = f"silent for {silent[_OF_SUPERVISOR]:.1f} s" if gone else supervisor["state"]
            found["supervisor_node"] = {"name": "supervisor_node", "text": text,
                                        "well": not gone and supervisor["number"] == 1}  # fmt: skip
        if _MOTOR in found and motor and not motor["on"]:
            found[_MOTOR] |= {"well": False, "text": f"{found[_MOTOR]['text']}; {motor['mode']}: motor off"}
        self._diagnostics = {key: one for key, one in self._diagnostics.items() if now - one[0] < _FORGOTTEN}
        for key, (_, level, message) in sorted(self._diagnostics.items()):
            name, _, task = key.partition(": ")
            node = found.setdefault(name, {"name": name, "text": "publishes diagnostics", "well": True})
            if level:
                node["well"] = False
                node["text"] += f"; {task}: {LEVELS[level]}, {message}"
        return list(found.values())
