# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The loop check before a run: what is compared, and what each comparison finds (docs/graph.md, "Loop check")."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

#: A share of valid readings below this is no sensor that works [-].
_LEAST_VALID = 0.5
#: Heights this close are the same [m]; so are speeds within this share [-].
_SAME_HEIGHT, _SAME_SPEED = 1e-6, 0.05
#: Samples older than this show nothing about now [s].
_RECENT = 1.0


@dataclass(frozen=True)
class Ceiling:
    """Lowest and highest height [m] and speed [m/s] of a ceiling."""

    lowest: float
    highest: float
    speed: float


class LatestBlocks:
    """The latest block of each channel. Times are steady [s]."""

    def __init__(self) -> None:
        self._latest: dict[str, tuple[float, float]] = {}  # channel: when, share of valid readings

    def push(self, channel: str, values: NDArray[np.float64], now: float) -> None:
        """Take the values (n,) of a channel's block."""
        self._latest[channel] = now, float(np.mean(np.isfinite(values))) if len(values) else 0.0

    def failures(self, now: float) -> list[str]:
        """Return one line for each channel that is silent or gives no valid readings."""
        if not self._latest:
            return ["sensors: no samples; is the source running, and its device connected?"]
        lines = []
        for channel, (at, valid) in self._latest.items():
            if now - at > _RECENT:
                lines.append(f"{channel}: no samples for {now - at:.1f} s")
            elif valid < _LEAST_VALID:
                lines.append(f"{channel}: {valid:.0%} of its readings are valid; needed: {_LEAST_VALID:.0%}")
        return lines


@dataclass
class LoopSnapshot:
    """What is known when the check is made."""

    sensors: LatestBlocks = field(default_factory=LatestBlocks)
    scene: Ceiling | None = None  # that heights are selected for; None: no controller moves it
    motor: Ceiling | None = None  # limits of the motor node, inside which it refuses to run with other firmware
    recorder_expected: bool = True
    recording: bool = False
    written: int = 0  # messages
    errors: dict[str, str] = field(default_factory=dict)  # of channels, by their names


def failures(snapshot: LoopSnapshot, now: float) -> list[str]:
    """Return what fails at the steady time `now` [s], one line each; empty: the loop may run."""
    lines = snapshot.sensors.failures(now)
    lines += [f"{channel}: {text}" for channel, text in snapshot.errors.items()]
    if snapshot.scene is not None:
        lines += disagreements(snapshot.scene, snapshot.motor)
    if snapshot.recorder_expected and not snapshot.recording:
        lines.append("recorder_node: no bag is open")
    elif snapshot.recorder_expected and not snapshot.written:
        lines.append("recorder_node: nothing has been written to its bag")
    return lines


def disagreements(scene: Ceiling, motor: Ceiling | None) -> list[str]:
    """Return where the scene's ceiling is not one that the motor node moves, one line each."""
    if motor is None:
        return ["motor_node: its limits are not known yet"]
    lines = []
    if motor.lowest > scene.lowest + _SAME_HEIGHT or motor.highest < scene.highest - _SAME_HEIGHT:
        given = f"scene {scene.lowest:g} to {scene.highest:g} m, motor node {motor.lowest:g} to {motor.highest:g} m"
        lines.append(f"ceiling: {given}; allowed: a scene inside the motor's range")
    if not math.isclose(motor.speed, scene.speed, rel_tol=_SAME_SPEED):
        given = f"scene {scene.speed:g} m/s, motor node {motor.speed:g} m/s"
        lines.append(f"ceiling: {given}; allowed: speeds within {_SAME_SPEED:.0%} of one another")
    return lines
