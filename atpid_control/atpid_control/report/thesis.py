# SPDX-License-Identifier: Apache-2.0
"""What the thesis prints for its adaptive bench (section 4.3, Figs 4.4 to 4.7), to be shown beside a run's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from atpid_control.report.run import Run
from atpid_control.report.stages import Stage
from atpid_sim.scene import FreeExcitation, Scene


@dataclass(frozen=True)
class Printed:
    """One stage as printed."""

    excitation: float  # [m]; the first is printed as 0.15, a slip (DESIGN: the 0.3 m of Fig. 4.5 belong to 0.015)
    height: float  # [m]
    amplitude: float  # of the beam, adaptive [m]
    closed: float  # of the beam, closed damper [m]
    best_height: float  # what a search over all heights finds with this model [m]
    best_efficiency: float  # there [-]
    height_sign: str = ""  # "above", where the thesis prints it

    @property
    def efficiency(self) -> float:
        """1 - amplitude / closed [-]."""
        return 1.0 - self.amplitude / self.closed


SECTION_4_3 = (
    Printed(0.015, 0.30, 0.07, 0.30, 0.29, 0.80),
    Printed(0.040, 0.70, 0.17, 0.85, 0.76, 0.81, "> "),
    Printed(0.030, 0.57, 0.13, 0.65, 0.57, 0.81),
)
MASS_FRACTION, STIFFNESS = 0.1, 427.6


def beside(run: Run, stages: list[Stage]) -> list[Printed] | None:
    """Return the thesis's stages where `run` is its adaptive bench, else None."""
    scene = run.scene
    if scene is None or scene.ceiling.kind != "controlled" or len(stages) != len(SECTION_4_3):
        return None
    same_system = np.isclose([scene.grain.mass_fraction, scene.beam.stiffness], [MASS_FRACTION, STIFFNESS]).all()
    given = [stage.excitation_amplitude for stage in stages]
    same_stages = np.allclose(given, [printed.excitation for printed in SECTION_4_3], rtol=1e-6)
    return list(SECTION_4_3) if same_system and same_stages else None


#: Largest ratio of successive peaks measured on the stand (section 2.3.1), by mass fraction and height [m].
MEASURED_DECREMENTS = {
    (0.025, 0.05): 1.345, (0.025, 0.10): 1.38, (0.025, 0.15): 1.40, (0.025, 0.20): 1.42,
    (0.05, 0.20): 1.52, (0.1, 0.20): 1.8, (0.2, 0.20): 2.5,
}  # fmt: skip
MEASURED_CLOSED = 1.31
MEASURED_STIFFNESS, MEASURED_DEFLECTION = 117.6, 0.2


def measured_decrement(scene: Scene, height: float) -> float | None:
    """Return what the stand showed for a free decay like the scene's with the ceiling at `height` [m], 0 for closed.

    None where that was not measured.
    """
    if not isinstance(scene.excitation, FreeExcitation):
        return None
    given = (scene.beam.stiffness, scene.excitation.free.deflection)
    if not np.allclose(given, (MEASURED_STIFFNESS, MEASURED_DEFLECTION)):
        return None
    if height <= 2.0 * scene.grain.radius:
        return MEASURED_CLOSED
    near = (
        value
        for (fraction, at), value in MEASURED_DECREMENTS.items()
        if np.allclose((fraction, at), (scene.grain.mass_fraction, height))
    )
    return next(near, None)
