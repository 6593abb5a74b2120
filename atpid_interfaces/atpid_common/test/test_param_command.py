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

TABLE = (
    Entry("dead_band", 0.01, "relative change that moves nothing", "-", 0.0, 0.9, live=True),
    Entry("method", "lookup", "method of selection", choices=("lookup", "pca")),
)
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


def test_a_parameter_is_read_set_and_described(ask: Ask, parameters: LiveParameters) -> None:
    assert ask("get", "dead_band") == (0, "0.01", "")
    assert ask("set", "dead_band", "0.02") == (0, "dead_band: 0.02", "")
    assert parameters["dead_band"] == 0.02
    status, described, _ = ask("describe", "dead_band")
    assert status == 0
    assert all(part in described for part in ("0 to 0.9", f"{TABLE[0].description} [-]"))
    assert {"dead_band", "method"} <= set(ask("list")[1].splitlines())


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("set", "dead_band", "-1.0"), ("refused", "dead_band")),
        (("set", "dead_band", "3"), ("refused", "type")),
        (("set", "method", "pca"), ("refused", "method", "read-only")),
        (("get", "nothing"), ("nothing", "none")),
        (("describe", "nothing"), ("nothing", "none")),
    ],
)
def test_what_cannot_be_is_one_line_and_status_2(ask: Ask, words: tuple[str, ...], parts: tuple[str, ...]) -> None:
    status, out, error = ask(*words)
    assert (status, out, len(error.splitlines())) == (2, "", 1)
    assert error.startswith("error: ")
    assert all(part in error for part in parts)
