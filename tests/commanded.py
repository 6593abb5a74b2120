# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the loop commands in shipped scenes, and in one without noise: `python tests/commanded.py` prints it as JSON."""

import json
from pathlib import Path

from atpid_control.selection.map_cache import map_for
from atpid_sim.scene import load_scene
from studies.pure_loop import run_loop
from studies.seeds.measure import configured

SCENES = ("thesis_4_3", "stepped_4_8", "stiff_beam")
#: Without noise a tone meets thresholds exactly; atpid_control/test/test_rounding.py has that at many frequencies.
QUIET = "thesis_4_3"
_FOLDER = Path(__file__).resolve().parent.parent / "scenes"

#: When a height was commanded [s], the height [m] and the reason.
Command = tuple[float, float, str]


def commands() -> dict[str, list[Command]]:
    """Return the commands of each scene, by its name and whether its sensors have no noise."""
    found = {}
    for name in SCENES:
        scene = load_scene(_FOLDER / f"{name}.yaml")
        quiet = scene.with_(sensors={"laser": {"rate": 1000.0, "noise": 0.0}})
        for label, each in ((name, scene), *([(f"{name}, no noise", quiet)] if name == QUIET else [])):
            run = run_loop(each, configured(), map_for(each))
            news = [(t, one.command) for t, one in zip(run.time, run.answers, strict=True)]
            last, found[label] = 0, list[Command]()
            for time, command in news:
                if command.sequence != last:
                    found[label].append((round(time, 6), command.height, command.reason))
                last = command.sequence
    return found


if __name__ == "__main__":
    print(json.dumps(commands()))
