# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whatever a file holds, it is read or refused in one line, soon, in little memory; more with `make fuzz`."""

import hashlib
import resource
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from targets import TARGETS

from atpid_common.errors import AtpidError

CORPUS = Path(__file__).parent / "corpus"
KEPT = Path(__file__).parents[2] / "out" / "fuzz"
LONGEST = 30.0  # of processor time for one file, of which none takes 1 s [s]
MOST_MEMORY = 1_000_000  # of the process at any time [kB]
LONG = settings.get_current_profile_name() == "long"  # derandomized otherwise
EXAMPLES = settings().max_examples if LONG else 12


def judge(name: str, content: bytes) -> None:
    """Give a parser a file; fail where it ends in anything but an answer or one line."""
    one = TARGETS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / one.file
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        begin = time.process_time()
        refusal = None
        try:
            one.read(path)
        except AtpidError as error:
            refusal = str(error)
        assert refusal is None or (0 < len(refusal) < 3000 and "\n" not in refusal), refusal
        assert time.process_time() - begin < LONGEST


def keep(name: str, content: bytes) -> Path:
    """Keep a file that broke something, so that it can be mended."""
    path = KEPT / name / hashlib.sha256(content).hexdigest()[:8]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_whatever_a_file_holds(name: str) -> None:
    already = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    # of a bag, which is read seven times, half as many
    examples = EXAMPLES if LONG or not name.startswith("bag_") else EXAMPLES // 2

    # without shrinking, which takes minutes where reading one file takes a second
    @settings(max_examples=examples, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    @given(data=st.data())
    def run(data: st.DataObject) -> None:
        content = data.draw(TARGETS[name].inputs())
        try:
            judge(name, content)
        except Exception as error:
            raise AssertionError(f"{keep(name, content)} ended in {error!r}; mended, it belongs in {CORPUS}") from error

    run()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < max(already + 300_000, MOST_MEMORY)


@pytest.mark.parametrize("file", sorted(CORPUS.glob("*/*")), ids=lambda file: f"{file.parent.name}/{file.name}")
def test_what_once_broke(file: Path) -> None:
    judge(file.parent.name, file.read_bytes())
