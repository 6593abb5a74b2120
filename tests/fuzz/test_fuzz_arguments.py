# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command lines: each argument is checked where it is given; whatever is given ends in one line and changes nothing."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from command_lines import FREE, LINES, Places, actions, hostile_lines, make_user_files, parsers, refused
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from atpid_common import arguments
from atpid_control.cli import COMMANDS as ATPID

NO_NUMBER = ("nan", "inf", "-inf", "1e999", "-1e999", "-1e300", "9" * 5000, "", " ", "x", "\0")
PARSERS = dict(parsers())
#: Commands that take nothing but what others take too, and one that lists what is wrong and makes nothing.
NOT_TRIED = {"doctor", "bag check", "bag recover", "bag repair", "bag verify", "completion", "live", "policy"}
EXAMPLES = settings().max_examples if settings.get_current_profile_name() == "long" else 40


def test_every_command_is_among_the_lines() -> None:
    assert {name for group in ATPID.values() for name in group} - NOT_TRIED <= set(LINES)


@pytest.mark.parametrize("command", sorted(PARSERS))
def test_every_argument_has_a_declared_type(command: str) -> None:
    for action in actions(PARSERS[command]):
        if isinstance(action, argparse._SubParsersAction):
            continue
        assert action.type not in (None, int, float, str, Path), f"{command} {action.dest}: a type of its own"
        words = [text for text in NO_NUMBER if not refused(action, text)]
        # a name or a path may be the word nan; what is no number may not
        assert not words or action.type in FREE or set(words) <= {"nan", "inf", "-inf", "x"}, (action.dest, words)
        assert refused(action, "a\0b"), f"{command} {action.dest}"


@pytest.mark.parametrize(
    ("kind", "allowed", "impossible"),
    [
        (arguments.real(0.0, 2.0, "m"), ["0", "2", "1e-3"], ["-1e-9", "2.1", "nan", "inf", "", "1,5"]),
        (arguments.positive(), ["1e-300", "1e9"], ["0", "-0.0", "nan", "inf"]),
        (arguments.whole(1, 5), ["1", "5"], ["0", "6", "1.0", "nan", "9" * 5000]),
        (arguments.rising(0.0, 1.0, "A:B"), ["0:1", "0.1:0.2"], ["1:0", "0:0", "0:nan", "0", "0:1:2", "0:2"]),
        (arguments.rising(0.0, 1.0, "A:B", closed=False), ["0.1:1"], ["0:1"]),
        (arguments.file_path, ["a", "/a/b", "ü"], ["", "a\0b", "x" * 256, "y/" * 3000]),
        (arguments.path_to(".npz"), ["a.npz", "A.NPZ"], ["a.csv", "npz", "scene.yaml"]),
        (arguments.word, ["a b", "ü"], ["", " ", "a\nb", "\x1b[2J", "x" * 300]),
        (arguments.graph_name, ["/a", "a/b", "~/a", "a1_"], ["", "/", "a b", "/1a", "a//b", "a/", "x" * 300]),
    ],
)
def test_types(kind: object, allowed: list[str], impossible: list[str]) -> None:
    assert callable(kind)
    for text in allowed:
        kind(text)
    for text in impossible:
        with pytest.raises(argparse.ArgumentTypeError, match=r"(?s)^given .*; allowed: "):
            kind(text)


@pytest.mark.parametrize(
    ("name", "line", "words"),
    [
        ("load", "load --seconds nan", "--seconds: given nan; allowed: above 0 to 1e+06 s"),
        ("seeds", "seeds SCENE --margin -1", "--margin: given -1; allowed: 0 to 100"),
        ("select", "select SCENE --method pca --amplitude-std nan", "--amplitude-std: given nan; allowed: 0 to 1000"),
        ("extremes", "extremes --systems 0 --out DIR", "--systems: given 0; allowed: a whole number from 1"),
        ("extremes", "extremes --systems 1 --out mine.npz", "mine.npz: is a file; give a folder to --out"),
        (
            "map", "map SCENE --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out folder.npz",
            "folder.npz: is a folder; give a file to --out",
        ),
        (
            "map", "map SCENE --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out mine.npz",
            "mine.npz: exists already; give another --out, or --force to replace it",
        ),
        ("map", "map SCENE --amplitudes 0.01:inf:2 --mass-fractions 0.1 --out MAP", "given 0.01:inf:2; allowed: A0:A1"),
        ("simulate", "simulate SCENE --rate 10", "--rate: given 10 without --series"),
        ("simulate", "simulate SCENE --rate 1e7 --series SERIES", "more than 10000000 samples in 16 s"),
        ("bag extract", "bag extract BAG --support 1:0", "--support: given 1:0; allowed: FROM:TO"),
        ("standin", "standin --unplug", "a fault is given without a device"),
        ("calibrate reading", "calibrate reading mine.npz --position 0 --terminal AIN0", "readings mine.npz"),
        ("thesis", "thesis free_decay --out DIR --scenes nowhere", "--scenes: given nowhere, no folder"),
    ],
)  # fmt: skip
def test_what_was_once_accepted_or_refused_too_late(
    name: str,
    line: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.npz").write_text("mine\n")
    (tmp_path / "folder.npz").mkdir()
    places = Places(tmp_path, tmp_path)
    assert LINES[name][0]([places.fill(word) for word in line.split()]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert words in printed.err
    assert printed.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "mine.npz"]
    assert (tmp_path / "mine.npz").read_text() == "mine\n"


def state(folder: Path) -> dict[str, tuple[int, int, bytes]]:
    """Return what is in a folder: inode, time of change and content of each file."""
    found = {}
    for path in sorted(folder.rglob("*")):
        about = path.stat()
        content = path.read_bytes() if path.is_file() else b""
        found[str(path)] = (about.st_ino, 0 if path.is_dir() else about.st_mtime_ns, content)
    return found


@pytest.mark.slow
@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), print_blob=True)
@given(data=st.data())
def test_a_hostile_line_is_one_line_and_changes_nothing(
    data: st.DataObject, capsys: pytest.CaptureFixture[str]
) -> None:
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        places = Places(folder / "user", folder / "out")
        make_user_files(places.user)
        places.out.mkdir()
        (folder / "here").mkdir()
        os.chdir(folder / "here")
        try:
            command, words = data.draw(hostile_lines(places))
            untouched = state(places.user)
            capsys.readouterr()
            status = LINES[command][0](words)
            printed = capsys.readouterr()
            assert status == 2, (words, printed)
            assert printed.err.startswith("error: "), (words, printed.err)
            assert printed.err.count("\n") == 1, (words, printed.err)
            assert state(places.user) == untouched, words
            assert not list((folder / "here").iterdir()), words
        finally:
            os.chdir(before)


def test_a_line_that_is_valid_is_not_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The lines that are made hostile would run: the cheapest of them does."""
    places = Places(tmp_path / "user", tmp_path / "out")
    make_user_files(places.user)
    places.out.mkdir()
    shutil.copy(Path(__file__).parents[2] / "scenes/standard.yaml", places.user / "scene.yaml")
    main, line = LINES["bag extract"]
    assert main([places.fill(word) for word in line.split()]) == 0
    assert (places.out / "new" / "support.csv").is_file()
    assert "support.csv" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_standard_output_on_a_full_disk_is_one_line(unbuffered: str) -> None:
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "wb") as full:
        command = [sys.executable, "-m", "studies", "thesis", "list"]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    assert ended.returncode == 1
    cache = " or the cache of compiled kernels" if unbuffered else ""  # which keeps nothing
    assert ended.stderr == f"error: standard output{cache} cannot be written: No space left on device\n"
