# SPDX-License-Identifier: Apache-2.0
"""Direct selection: the whole range of heights simulated, from the state the damper is in, in less than a period."""

import math
import time
from functools import cached_property

from atpid_control.selection.checks import check_excitation, response_at
from atpid_control.selection.margin import Excitation, Robust, System, Uncertainty, robust_height, systems_of
from atpid_control.selection.protocol import DEADLINE, Selection, SelectionError, Stage
from atpid_control.selection.workers import Workers
from atpid_sim.maps import FROM_CLOSED, Checked, DamperResponse, Timing, quick_best, travelled
from atpid_sim.maps.best import FLAT
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import cores

#: Tolerance of the complete runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-5
#: Speed of the ceiling where the scene gives none [m/s]: that of the thesis's bench in scenes/.
_SPEED = 0.3
#: A second travel starts this much later, in periods: what depends on the phase of the start is not reproducible.
_LATER = 0.37
#: Share of the deadline after which nothing more is begun.
_SHARE = 0.75


class DirectSelector:
    """Computes the optimum on all cores; with a margin, by a deadline, the height that is best in the worst case."""

    method, simulates = "direct", True

    def __init__(
        self,
        scene: Scene,
        uncertainty: Uncertainty | None = None,
        workers: int | None = None,
        deadline: float = DEADLINE,
    ) -> None:
        """Take the system of a scene, and the ceiling's range and speed where it is controlled.

        deadline: time after which a selection with a margin ends with what it has found [s].
        """
        if not deadline > 0.0:
            raise SelectionError(f"deadline: given {deadline:g} s; allowed is a time above 0 s")
        self._scene, self._workers, self._deadline = scene, workers or cores(), deadline
        self._limits = getattr(scene.ceiling, "range", (2.0 * scene.grain.radius, math.inf))
        self._speed = float(getattr(scene.ceiling, "speed", _SPEED))
        self._uncertainty = uncertainty or Uncertainty()
        self._damper = DamperResponse(scene, _RTOL)
        # compiled now, or loaded from the cache, so that the first selection is as fast as the next
        self._damper.sufficient(1e-3, math.inf).opened(1e-3, 4.0 * self._damper.diameter, Timing(1.0, 4.0))

    @cached_property
    def _systems(self) -> list[System]:
        return systems_of(self._scene, self._damper, self._uncertainty)

    def prepare(self) -> None:
        """Make what a margin needs now, so that the first selection with one is as fast as the next."""
        _ = self._systems

    def select(
        self, amplitude: float, amplitude_std: float = 0.0, frequency: float = math.nan, *, margin: float = 0.0,
        height: float = math.nan,
    ) -> Selection:  # fmt: skip
        """Return the best height reached from `height` [m], or from closed; see `HeightSelector.select`."""
        check_excitation(amplitude, amplitude_std, frequency, margin)
        if margin > 0.0:
            self.prepare()
        begun = time.monotonic()
        damper = response_at(self._damper, self._scene, frequency, _RTOL)
        approaches = FROM_CLOSED
        if height > damper.diameter * (1.0 + 1e-6):
            approaches = travelled(height, self._speed), travelled(height, self._speed, _LATER * damper.period)
        try:
            with Workers(self._workers) as workers:
                best = quick_best(damper, amplitude, limits=self._limits, approaches=approaches, mapper=workers.map)
                if margin > 0.0:
                    given = Excitation(amplitude, margin * amplitude_std, damper.frequency)
                    until = begun + _SHARE * self._deadline
                    found = robust_height(self._systems, given, best, self._limits, workers.map, until)
        except NumericalFailure as error:
            raise SelectionError(f"direct: {error}") from error
        seconds = time.monotonic() - begun
        search = _searched(best)
        disagreed = search.note if best.disagreement > FLAT else ""
        if not margin > 0.0:
            return Selection(
                best.height, best.amplitude, best.efficiency, self.method, best.evaluations, seconds, stages=(search,),
                note=disagreed,
            )  # fmt: skip
        efficiency = 1.0 - found.amplitude / damper.closed_amplitude(amplitude)
        guaranteed = self._guaranteed(found, seconds)
        return Selection(
            found.height, found.amplitude, efficiency, self.method, best.evaluations + found.evaluations, seconds,
            best.efficiency - efficiency, (search, guaranteed), note=guaranteed.note,
        )  # fmt: skip

    def _guaranteed(self, found: Robust, seconds: float) -> Stage:
        rumble = "" if found.regular else "; irregular in the worst of them"
        late = f"; late: {seconds:.3f} s of {self._deadline:g} s" if seconds > self._deadline else ""
        held = f"least efficiency {found.least:.3f} in {found.verified} of {found.sampled} sampled systems"
        return Stage("margin", found.height, found.worst, held + rumble + late)


def _searched(best: Checked) -> Stage:
    if best.searched == best.checked:
        return Stage("search", best.height, best.amplitude, f"with {best.checked}, which leaves out nothing")
    if best.disagreement <= FLAT:
        text = f"with {best.searched}; {best.checked} agrees within {best.disagreement:.1e}"
    else:
        text = f"with {best.searched}; {best.checked} differs by {best.disagreement:.1e}, so searched on with it"
    return Stage("search", best.height, best.amplitude, text)
