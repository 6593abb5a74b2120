# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of the graph as the page shows it: nodes, motor, controller, recorder, and who has fallen silent."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from atpid_common.files import Document
from atpid_common.vocabulary import Mode
from atpid_control.views.live.signals import plain
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency

if TYPE_CHECKING:
    from atpid_interfaces.msg import CeilingCommand, CeilingState, Excitation, RecorderStatus, SupervisorState


class _ShareSoFar:
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


def shares_of(scene: Scene | None) -> dict[str, _ShareSoFar]:
    """Return efficiency, against the closed damper, and reduction, against the structure without it; none of None."""
    if scene is None:
        return {}
    return {"efficiency": _ShareSoFar(scene, grain=True), "reduction": _ShareSoFar(scene, grain=False)}


#: Topics that come all the time in a running graph: silent after so long [s].
_SILENT = dict.fromkeys(("sensors/laser", "excitation", "ceiling/command", "ceiling/state", "supervisor/state"), 1.0)
_SILENT["recorder/status"] = 3.0
#: The same that a topic of the loop is about.
_OF_SUPERVISOR = "supervisor/state"
_MOTOR = "motor_node"
#: Diagnostics of a node that come no more are dropped after so long [s].
_FORGOTTEN = 5.0
_ON = (Mode.HOMING, Mode.HOLDING, Mode.MOVING)
_POWERS = ("off", "off", "on", "on, at rest", "on", "off until armed again")
_SUPERVISOR = ("starting", "ready", "degraded", "fault", "safe: motor off", "shutdown")
_LEVELS = ("ok", "warning", "error", "stale")
_QUALITIES = ("no estimate", "steady", "changing", "poor")


def _fields(message: object, *names: str) -> Document:
    """Return fields of a message as JSON can hold them."""
    values = {name: getattr(message, name) for name in names}
    return {name: plain(value) if isinstance(value, float) else value for name, value in values.items()}


def _motor(state: "CeilingState") -> Document:
    words = {"mode": Mode(state.mode).name.lower(), "power": _POWERS[state.mode], "on": state.mode in _ON}
    return words | _fields(state, "homed", "fault", "height", "target", "speed")


def _command(command: "CeilingCommand") -> Document:
    predicted = plain(command.predicted_amplitude)
    return _fields(command, "height", "method", "reason") | {"predicted": predicted}


def _excitation(found: "Excitation") -> Document:
    words = {"quality": _QUALITIES[found.quality], "origin": ("support", "beam")[found.origin]}
    return words | _fields(found, "amplitude", "amplitude_std", "frequency", "frequency_std", "beam_amplitude")


def _supervisor(message: "SupervisorState") -> Document:
    words = {"state": _SUPERVISOR[message.state], "number": int(message.state)}
    return words | _fields(message, "permit", "reason")


def _recorder(status: "RecorderStatus") -> Document:
    return _fields(status, "recording", "bag")


#: By topic: the part of the page's state, and what it shows of a message.
_SHOWN: dict[str, tuple[str, Callable[..., Document]]] = {
    "ceiling/state": ("motor", _motor),
    "ceiling/command": ("command", _command),
    "excitation": ("excitation", _excitation),
    "supervisor/state": ("supervisor", _supervisor),
    "recorder/status": ("recorder", _recorder),
}


class GraphState:
    """The latest of everything that is not a plot. Times are steady [s]."""

    def __init__(self) -> None:
        self._shown: dict[str, Document] = {"motor": {}, "supervisor": {}, "recorder": {}}
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
            self._diagnostics[status.name] = (now, min(level, len(_LEVELS) - 1), status.message)

    def shown(self, now: float) -> Document:
        """Return the state as the page takes it; every part that has fallen silent is named."""
        silent = {
            topic: round(now - self._received[topic], 1)
            for topic, limit in _SILENT.items()
            if topic in self._received and now - self._received[topic] > limit
        }
        seen, nodes = bool(self._received), self._nodes(silent, now)
        lost = seen and now - max(self._received.values()) > min(_SILENT.values())
        return self._shown | {"nodes": nodes, "silent": silent, "seen": seen, "lost": lost, "finished": self.finished}

    def _nodes(self, silent: dict[str, float], now: float) -> list[Document]:
        """Return name, state in words, whether that is well, and the diagnostics that are not, of each node."""
        if not self._received:
            return []
        found: dict[str, Document] = {}
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
            well = not gone and supervisor["number"] == 1
            found["supervisor_node"] = {"name": "supervisor_node", "text": text, "well": well}
        if _MOTOR in found and motor and not motor["on"]:
            found[_MOTOR] |= {"well": False, "text": f"{found[_MOTOR]['text']}; {motor['mode']}: motor off"}
        self._diagnostics = {key: one for key, one in self._diagnostics.items() if now - one[0] < _FORGOTTEN}
        for key, (_, level, message) in sorted(self._diagnostics.items()):
            name, _, task = key.partition(": ")
            node = found.setdefault(name, {"name": name, "text": "publishes diagnostics", "well": True})
            if level:
                node["well"] = False
                node["text"] += f"; {task}: {_LEVELS[level]}, {message}"
        return list(found.values())
