# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Instantaneous impacts beside contacts of finite duration: how far their amplitude is off in this very run.

The error stated for a scene is what impacts change in a motion. Near the end of a branch of motions, and after a long
transient, the two levels end in different ones. One run with tabulated contacts shows it.
"""

import numpy as np

from atpid_sim.outcome import Outcome
from atpid_sim.simulation.fidelity import Choice, finite_error, held_error
from atpid_sim.simulation.integration import Integration, Observation, negligible_displacement
from atpid_sim.simulation.reproducibility import Verdict, judge

#: Tolerance of the run with contacts of finite duration: only resting grains are integrated.
_RTOL = 1e-4
#: Share of the scene's model error up to which one such run will do: more may be the distance of one draw.
_NEAR = 0.5


def cross_check_with_finite(
    impacts: Integration, amplitude: float, verdict: Verdict, choice: Choice, undamped: float
) -> Verdict:
    """Return the verdict on a reproducible run with instantaneous impacts, what the level leaves out included.

    amplitude: of that run [m]; verdict: on its repetitions; undamped: amplitude of the closed damper [m]. Where the
    amplitude of finite contacts is farther off than half the scene's model error, that motion has to be reproducible as
    well, and the distance is the error if it is the larger one. The error is unknown where that run does not reach its
    end.
    """
    scene, stated = impacts.scene, choice.model_error
    finite = impacts.at_level("finite", min(impacts.rtol, _RTOL))
    state = finite.initial_state()
    outcome = finite.advance(state, finite.table, Observation(scene.steady_window), finite.step_limit)
    if outcome != Outcome.DONE:
        return Verdict(float("nan"), False, (amplitude, amplitude, amplitude))
    beyond = max(abs(amplitude - state.amplitude) - negligible_displacement(scene), 0.0)
    apart, left_out = beyond / max(state.amplitude, 1e-300), finite_error(scene, undamped)
    if apart + left_out <= _NEAR * stated:
        return Verdict(verdict.error + stated, True, None, verdict.change)
    other = judge(finite, state.amplitude, state.steps, left_out, held_error(scene, undamped))
    error = max(stated, apart + left_out + other.error) + verdict.error
    if other.spread is None:
        return Verdict(error, True, None, min(verdict.change, other.change))
    least, median, most = other.spread
    return Verdict(
        error, False, (float(np.fmin(amplitude, least)), median, float(np.fmax(amplitude, most))), other.change
    )
