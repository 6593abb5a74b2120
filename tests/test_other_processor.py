# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Another processor rounds otherwise: the slow numerical files pass there, and heights are commanded as here.

x86-64-v2 has neither wide registers nor fused multiply-add, and any x86-64 of the last fifteen years runs its code.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commanded import commands
from processors import EMULATES, REASON
from test_rounding import FREQUENCIES

from atpid_sim.scene import load_scene

pytestmark = [pytest.mark.skipif(not EMULATES, reason=REASON)]

ROOT = Path(__file__).resolve().parent.parent
OTHER = "x86-64-v2"
BLOCK = 0.05  # of the scenes' sensors [s]
#: What computes longest on decisions that a last digit could turn; the other numerical files take the same code.
FILES = (
    # a whole number of blocks in a period, and of no part of them
    *(f"atpid_control/test/test_rounding.py::test_the_last_digits_of_the_samples_decide_nothing[{hertz}]"
      for hertz in (FREQUENCIES[0], FREQUENCIES[-1])),
    "atpid_control/test/test_identification_bench.py",
    "atpid_control/test/test_watch.py", "tests/of_studies/test_steady.py", "tests/test_seeds.py",
    "extensions/atpid_dynamics/test/test_sweep.py",
    "tests/test_replay.py::test_the_bags_that_come_with_the_project",
    "tests/of_studies/test_reproducibility.py::test_what_is_reproducible_is_within_its_error",
)  # fmt: skip


def on_the_other(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "tests/processors.py", OTHER, sys.executable, *words]
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))  # the studies are not installed
    environment = os.environ | {"PYTHONPATH": paths}
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.skipif(os.environ.get("NUMBA_CPU_NAME") == OTHER, reason="this is the other processor already")
def test_it_rounds_otherwise() -> None:
    """Otherwise the tests below try nothing."""
    code = "import numpy as np; t = np.linspace(0.0, 9.0, 1000); print((t @ t).hex(), np.sin(t).sum().hex())"
    here = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert on_the_other("-c", code).stdout != here


def test_heights_are_commanded_at_the_same_times() -> None:
    done = on_the_other("tests/commanded.py")
    assert done.returncode == 0, done.stderr
    here, there = commands(), json.loads(done.stdout)
    assert there.keys() == here.keys()
    for scene, expected in here.items():
        assert len(expected) >= 4, scene
        times, heights, reasons = zip(*expected, strict=True)
        other_times, other_heights, other_reasons = zip(*there[scene], strict=True)
        # without the efficiency that a margin states, whose third digit may round otherwise
        assert [why.partition(" (")[0] for why in other_reasons] == [why.partition(" (")[0] for why in reasons], scene
        assert other_times == pytest.approx(times, abs=1.01 * BLOCK), scene
        # `direct` takes one of several heights that are as good, by digits that round otherwise: 1 % apart where seen
        given = load_scene(ROOT / "scenes" / f"{scene.split(',')[0]}.yaml")
        close = 0.02 if given.ceiling.controller == "direct" else 1e-6
        assert other_heights == pytest.approx(heights, rel=close, nan_ok=True), scene


@pytest.mark.skipif(not os.environ.get("CI"), reason="a minute of processor time: in CI only")
def test_the_slow_numerical_files_pass() -> None:
    """All of them in one process, which loads the libraries once."""
    done = on_the_other("-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *FILES)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
