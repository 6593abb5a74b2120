# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid ros param`: what `ros2 param` does, where there is no `ros2`."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from unittest.mock import patch

import pytest
from spun import Pair

from atpid_common.cli import run_commands
from atpid_common.nodes.parameters import Entry, LiveParameters

TABLE = (Entry("dead_band", 0.01, "relative change that moves nothing", "-", 0.0, 0.9, live=True),)
Ask = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def parameters() -> Iterator[LiveParameters]:
    """Those of a node that a thread spins."""
    ended = threading.Event()
    with closing(Pair()) as pair:
        made = LiveParameters(pair.node, TABLE)
        made.follow(lambda value: value("dead_band"), lambda _: None, lambda *_: None)
        thread = threading.Thread(target=pair.until, args=(ended.is_set,), name="session-node")
        thread.start()
        yield made
        ended.set()
        thread.join()


@pytest.fixture
def ask(parameters: LiveParameters, capsys: pytest.CaptureFixture[str]) -> Ask:
    def asked(what: str, *words: str) -> tuple[int, str, str]:
        commands = {"": {"ros param": ("atpid_common.nodes.param", "param")}}
        with patch.dict(os.environ):  # which the command confines to this machine
            status = run_commands("atpid", "", commands, ["ros", "param", what, "/tested", *words])
        out, error = capsys.readouterr()
        return status, out.strip(), error.strip()

    return asked


def test_a_parameter_is_read_and_set_and_what_cannot_be_is_one_line(ask: Ask, parameters: LiveParameters) -> None:
    assert ask("get", "dead_band") == (0, "0.01", "")
    assert ask("set", "dead_band", "0.02") == (0, "dead_band: 0.02", "")
    assert parameters["dead_band"] == 0.02
    assert "0 to 0.9" in ask("describe", "dead_band")[1]
    for words in (("set", "dead_band", "-1.0"), ("get", "nothing")):
        status, out, error = ask(*words)
        assert (status, out, len(error.splitlines())) == (2, "", 1)
        assert error.startswith("error: ")
        assert words[1] in error
