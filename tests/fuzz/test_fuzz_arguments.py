# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command lines: each argument is checked where it is given; whatever is given ends in one line and changes nothing."""

import argparse
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest
from command_lines import (
    LINES,
    OUTPUTS,
    PARSERS,
    PROGRAMS,
    Places,
    hostile_lines,
    make_user_files,
    refused,
    takes_values,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from atpid_common import arguments

NO_NUMBER = ("nan", "inf", "-inf", "1e999", "-1e999", "-1e300", "9" * 5000, "", " ", "x", "\0")
#: Types of a text that any word fits; another type of a name or a path lets the word nan through, and a number none.
FREE = (arguments.text, arguments.word, arguments.file_path)
EXAMPLES = settings().max_examples if settings.get_current_profile_name() == "long" else 40


def run(name: str, words: Sequence[str]) -> int:
    """Run a line of a command; return its exit status."""
    return PROGRAMS[name.partition(" ")[0]].main(words)  # type: ignore[no-any-return]


@pytest.mark.parametrize("command", sorted(PARSERS))
def test_every_argument_has_a_declared_type(command: str) -> None:
    for action in takes_values(PARSERS[command]):
        assert action.type not in (None, int, float, str, Path), action.dest
        words = {text for text in NO_NUMBER if not refused(action, text)}
        assert action.type in FREE or words <= {"nan", "inf", "-inf", "x"}, action.dest
        assert refused(action, "a\0b"), action.dest


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
    ("line", "parts"),
    [
        ("studies load --seconds nan", r"--seconds: .*nan.* 0 .* 1e\+06"),
        (
            "atpid map SCENE --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out mine.npz",
            r"mine\.npz: .*--out.*--force",
        ),
        ("atpid map SCENE --amplitudes 0.01:inf:2 --mass-fractions 0.1 --out NPZ", r"0\.01:inf:2; .*A0:A1"),
        ("atpid simulate SCENE --rate 10", "--rate: .* 10 .*--series"),
        ("atpid simulate SCENE --rate 1e7 --series SERIES", "10000000 samples .* 16 s"),
        ("atpid standin --unplug", "fault .*device"),
        ("atpid calibrate reading mine.npz --position 0 --terminal AIN0", r"readings mine\.npz"),
        ("studies thesis free_decay --out DIR --scenes nowhere", "--scenes: .*nowhere.*folder"),
    ],
)
def test_what_was_once_accepted_or_refused_too_late(
    line: str, parts: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.npz").write_text("mine\n")
    (tmp_path / "folder.npz").mkdir()
    places = Places(tmp_path, tmp_path)
    assert run(line, [places.fill(word) for word in line.split()[1:]]) == 2
    assert re.fullmatch(rf"error: .*{parts}.*\n", capsys.readouterr().err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "mine.npz"]
    assert (tmp_path / "mine.npz").read_text() == "mine\n"


#: A path in a folder in which no user can make anything, root included; each line with it in one place.
NOWHERE = "/proc/nowhere/x"
UNWRITABLE = [
    (name, [*words[:place], NOWHERE, *words[place + 1 :]])
    for name, words in LINES.items()
    for place, word in enumerate(words)
    if word in OUTPUTS and words[place - 1] in ("--out", "--series", "--picture", "--header")
]
UNWRITABLE += [("atpid calibrate reading", f"calibrate reading {NOWHERE} --position 0.1 --terminal AIN0".split())]


@pytest.mark.parametrize(("name", "words"), UNWRITABLE)
def test_a_place_that_cannot_be_written_is_one_line(
    name: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = Places(tmp_path / "user", tmp_path / "out")
    make_user_files(places.user)
    places.out.mkdir()
    assert run(name, [places.fill(word) for word in words]) == 2
    printed = capsys.readouterr()
    assert (printed.out, re.fullmatch("error: .*\n", printed.err) is not None) == ("", True), printed
    assert not list(places.out.iterdir())


def state(folder: Path) -> dict[str, tuple[int, int, bytes]]:
    """Return what is in a folder: inode, time of change and content of each file."""
    found = {}
    for path in sorted(folder.rglob("*")):
        about = path.stat()
        content = path.read_bytes() if path.is_file() else b""
        found[str(path)] = (about.st_ino, 0 if path.is_dir() else about.st_mtime_ns, content)
    return found


@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), print_blob=True)
@given(data=st.data())
def test_a_hostile_line_is_one_line_and_changes_nothing(
    data: st.DataObject, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with tempfile.TemporaryDirectory() as name, monkeypatch.context() as changed:
        folder = Path(name)
        places = Places(folder / "user", folder / "out")
        make_user_files(places.user)
        places.out.mkdir()
        (folder / "here").mkdir()
        changed.chdir(folder / "here")
        command, words = data.draw(hostile_lines(places))
        untouched = state(places.user)
        capsys.readouterr()
        status = run(command, words)
        printed = capsys.readouterr()
        assert status == 2, (words, printed)
        assert printed.err.startswith("error: "), (words, printed.err)
        assert printed.err.count("\n") == 1, (words, printed.err)
        assert state(places.user) == untouched, words
        assert not list((folder / "here").iterdir()), words


def test_a_line_that_is_valid_is_not_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The lines that are made hostile would run: the cheapest of them does."""
    places = Places(tmp_path / "user", tmp_path)
    assert run("atpid bag extract", [places.fill(word) for word in LINES["atpid bag extract"]]) == 0
    assert (tmp_path / "new/support.csv").is_file()
    assert "support.csv" in capsys.readouterr().out
