# SPDX-License-Identifier: Apache-2.0
"""The excitation from the beam's response alone, where nobody measures the support.

Closed damper: beam and grain are one mass, and the transfer function of the simplified model is divided out
(thesis equation 3.43). Open damper: through a table of simulated steady amplitudes at the present height. Either way
the error bar grows by what is not known of the model, and only a steady beam tells: it takes its own time to settle.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from atpid_control.identification.estimate import Estimate, Quality
from atpid_sim.scene import Scene

Array = NDArray[np.float64]

#: Up to this gap, as a share of the beam's amplitude, the damper counts as closed.
CLOSED_GAP = 0.02
#: Standard deviation of stiffness and damping where nobody gives one: a calibrated beam's, with room [-].
MODEL_ERROR = (0.005, 0.05)


class AmplitudeRelation(Protocol):
    """How the beam's steady amplitude hangs on the support's, at a height of the open damper."""

    def at(self, height: float) -> tuple[Array, Array, Array]:
        """Return support amplitudes (n,), the beam's (n,) and the beam's spread (n,) [m] at `height` [m]."""
        ...


@dataclass(frozen=True)
class ClosedBeam:
    """Beam and grain as one mass on spring and damper, driven through both by the support."""

    mass: float  # beam and grain [kg]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]

    def transfer(self, omega: float) -> complex:
        """Return beam over support displacement at `omega` [rad/s] (equation 3.43)."""
        force = self.stiffness + 1j * self.damping * omega
        return force / (force - self.mass * omega * omega)

    def gain_error(self, omega: float, omega_std: float, model_error: tuple[float, float]) -> float:
        """Return the relative standard deviation of the gain [-].

        Differences over one standard deviation of each cause, not derivatives: at resonance those vanish.
        """
        gain = abs(self.transfer(omega))
        stiffness, damping = model_error
        others = (
            (self, omega + omega_std), (self, omega - omega_std),
            (replace(self, stiffness=self.stiffness * (1.0 + stiffness)), omega),
            (replace(self, stiffness=self.stiffness * (1.0 - stiffness)), omega),
            (replace(self, damping=self.damping * (1.0 + damping)), omega),
            (replace(self, damping=self.damping * (1.0 - damping)), omega),
        )  # fmt: skip
        off = [abs(abs(beam.transfer(at)) / gain - 1.0) for beam, at in others]
        return math.hypot(*(max(off[i], off[i + 1]) for i in (0, 2, 4)))


class ModelInverse:
    """From what the beam does to what the support does, through the model at the present height."""

    def __init__(
        self,
        beam: ClosedBeam,
        closed_height: float,
        relation: AmplitudeRelation,
        model_error: tuple[float, float] = MODEL_ERROR,
    ) -> None:
        """Take the closed beam, the height at which the damper is closed [m], and the relation where it is open.

        `model_error`: relative standard deviations of stiffness and damping [-].
        """
        self._beam, self._closed, self._relation, self._error = beam, closed_height, relation, model_error

    @classmethod
    def of_scene(cls, scene: Scene, model_error: tuple[float, float] = MODEL_ERROR) -> ModelInverse:
        """Return the inverse for a scene's beam and damper; the open damper's table is simulated when first needed."""
        from atpid_control.identification.beam_table import SimulatedRelation

        beam = ClosedBeam(scene.total_mass, scene.beam.stiffness, scene.beam.damping)
        return cls(beam, 2.0 * scene.grain.radius, SimulatedRelation(scene), model_error)

    def support_of(self, beam: Estimate, height: float) -> Estimate:
        """Return the support's estimate where the beam does `beam` and the ceiling is at `height` [m].

        Without a height there is no estimate. Where two support amplitudes would move the beam alike, the estimate is
        their middle, with an error bar over both, and poor.
        """
        if beam.quality == Quality.NONE or not math.isfinite(height):
            return Estimate(time=beam.time, last_index=beam.last_index, origin=beam.origin)
        if height - self._closed <= CLOSED_GAP * beam.amplitude:
            return self._through_one_mass(beam)
        return self._through_relation(beam, height)

    def _through_one_mass(self, beam: Estimate) -> Estimate:
        omega = 2.0 * math.pi * beam.frequency
        transfer = self._beam.transfer(omega)
        model = self._beam.gain_error(omega, 2.0 * math.pi * beam.frequency_std, self._error)
        relative = math.hypot(beam.amplitude_std / beam.amplitude, model)
        amplitude = beam.amplitude / abs(transfer)
        phase = math.remainder(beam.phase - cmath.phase(transfer), 2.0 * math.pi)
        return replace(
            beam,
            amplitude=amplitude,
            amplitude_std=relative * amplitude,
            phase=phase,
            phase_std=math.hypot(beam.phase_std, model),
        )

    def _through_relation(self, beam: Estimate, height: float) -> Estimate:
        support, response, spread = self._relation.at(height)
        ends = crossings(support, response, spread, beam.amplitude, beam.amplitude_std)
        if not ends:
            return replace(
                beam,
                quality=Quality.POOR,
                amplitude=math.nan,
                amplitude_std=math.nan,
                phase=math.nan,
                phase_std=math.nan,
            )
        low, high = min(a for a, _ in ends), max(b for _, b in ends)
        quality = beam.quality if len(ends) == 1 else Quality.POOR
        amplitude = 0.5 * (low + high)
        # the damping's error acts less where the grain takes most of the energy, the stiffness's as in the closed beam
        model = amplitude * math.hypot(*self._error)
        return replace(
            beam, quality=quality, amplitude=amplitude, amplitude_std=math.hypot(0.5 * (high - low), model),
            phase=math.nan, phase_std=math.nan,
        )  # fmt: skip


def crossings(
    support: Array, response: Array, spread: Array, amplitude: float, std: float
) -> list[tuple[float, float]]:
    """Return the intervals of support amplitude [m] in which the beam's response [m] may be `amplitude` +- `std` [m].

    `support`, `response` and `spread` (n,) [m] make a straight-line table. Intervals that touch are one.
    """
    fine = np.linspace(support[0], support[-1], 20 * support.size)
    middle = np.interp(fine, support, response)
    width = np.hypot(np.interp(fine, support, spread), std) + np.abs(np.gradient(middle))
    inside = np.flatnonzero(np.abs(middle - amplitude) <= width)
    if inside.size == 0:
        return []
    parts = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    return [(float(fine[part[0]]), float(fine[part[-1]])) for part in parts]
