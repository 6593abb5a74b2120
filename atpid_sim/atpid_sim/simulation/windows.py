# SPDX-License-Identifier: Apache-2.0
"""Whether a long run repeats itself in each of many windows, at the cost of a few runs and not of a few per window."""

from collections.abc import Sequence

from atpid_sim.engine import drive
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import choose, judged_errors
from atpid_sim.simulation.integration import Integration, Observation, drive_table
from atpid_sim.simulation.reproducibility import Verdict, judge

Window = tuple[float, float]


def verdicts(scene: Scene, windows: Sequence[Window], fidelity: str = "auto") -> list[Verdict | None]:
    """Return the verdict on the amplitude in each window (begin, end) [s]; None for one that has no amplitude.

    The windows rise and do not overlap. The run goes on from window to window; each part, from the end of the window
    before, is repeated on its own, disturbed at its begin. Raises NumericalFailure where the run does not reach the end
    of the last window.
    """
    table = drive_table(scene, tuple(t for window in windows for t in window))
    choice = choose(scene, fidelity)
    level, errors = choice.fidelity, judged_errors(scene, choice)
    found: list[Verdict | None] = []
    state, done = Integration(scene, level, table=table).initial_state(), 0.0
    for begin, end in windows:
        part = Integration(
            scene.with_(duration=end, steady_window=[begin, end]), level,
            table=drive.between(table, done, end), start=state,
        )  # fmt: skip
        state = part.initial_state()
        outcome = part.advance(state, part.table, Observation((begin, end)), part.step_limit)
        if outcome != Outcome.DONE:
            raise NumericalFailure(f"{outcome.sentence} (between {done:g} and {end:g} s)")
        found.append(judge(part, state.amplitude, state.steps, *errors) if state.amplitude > 0.0 else None)
        done = end
    return found
