# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile command lines: a valid one of each command, made impossible in exactly one place, from the real parsers."""

from __future__ import annotations

import argparse
import os
from argparse import ArgumentTypeError
from dataclasses import dataclass
from pathlib import Path

from documented import OpenParser, parsers_of
from hypothesis import strategies as st

from atpid_control import cli as control
from studies import cli as studies

ROOT = Path(__file__).resolve().parent.parent.parent
PROGRAMS = {"atpid": control, "studies": studies}
TABLES = {"atpid": control.commands(), "studies": studies.COMMANDS}
PARSERS = {f"{program} {name}": parser for program, of in TABLES.items() for name, parser in parsers_of(of)}
#: What a line may hold instead of a path: INPUTS are there, OUTPUTS are to be made.
INPUTS, OUTPUTS = ("SCENE", "BAG", "CSV", "READINGS"), ("DIR", "NPZ", "PNG", "SERIES", "HEADER", "YAML", "MCAP")

#: A valid line of each command that reads or makes files before it does anything else.
_LINES = """
atpid simulate SCENE --series SERIES --picture PNG
atpid basin SCENE --height 0.1 --kick 0.1 --starts 5 --out SERIES
atpid sweep SCENE --heights 0.1:0.2:2 --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out SERIES
atpid map SCENE --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out NPZ --header HEADER
atpid cliffs SCENE --height 0.19:0.3 --amplitudes 0.009:0.011 --out SERIES --picture PNG
atpid bench SCENE --out DIR --map NPZ --params-file YAML
atpid excite SCENE --amplitude 0.01
atpid campaign CSV --out DIR
atpid first-run SCENE --out DIR --simulated --yes
atpid replay BAG --out DIR
atpid select SCENE --method lookup --map NPZ
atpid design --mass 2 --frequency 15 --damping 0.02 --amplitudes 0.001:0.004 --out DIR
atpid modes cantilever --length 0.4 --width 0.04 --thickness 0.008 --modulus 5e9 --density 2400 --tip-mass 0.25 \
    --damping-ratio 0.02 --modes 2 --force-at 0.3 --scene SCENE --out YAML
atpid modes file CSV --container 1:z --modes 2 --damping-ratio 0.02 --scene SCENE --out YAML
atpid modes fit CSV --modes 2 --scene SCENE --out YAML
atpid calibrate beam CSV --moving-mass 0.4 --out YAML
atpid calibrate contact CSV --mass 0.02 --radius 0.01 --gravity 9.81 --channel force --out YAML
atpid calibrate campaign BAG --out DIR --moving-mass 1
atpid calibrate sensor READINGS --channel c --sensor s --serial 1 --out YAML --picture PNG
atpid bag import CSV --out DIR --rate 100
atpid bag report BAG --out DIR
atpid bag traces BAG --out MCAP
atpid bag validate CSV --scene SCENE --height 0.1 --out DIR
atpid bag export BAG --format csv --out SERIES
atpid bag analyse BAG --out DIR
atpid bag compare BAG BAG --out DIR
atpid bag extract BAG --out DIR --support 0:1
studies tradeoff SCENE --out DIR
studies atlas SCENE --out DIR --quick
studies faults --out DIR --part clock
studies methods SCENE --out DIR
studies thesis free_decay --out DIR --scenes DIR
studies figures selection --out DIR --map NPZ
"""
#: The words of each line by the program and name of its command: those after the program.
LINES = {
    next(name for name in PARSERS if line.startswith(f"{name} ")): line.split()[1:]
    for line in _LINES.strip().splitlines()
}

#: What a person, a script or a damaged file may put where a value belongs; a type refuses most of it.
VALUES = st.one_of(
    st.sampled_from([
        "nan", "inf", "-inf", "-1", "0", "-0.0", "1e999", "-1e999", "1e-999", "9" * 30, "9" * 5000, "0x10", "1_0_", "",
        " ", "\0", "a\0b", "\n", "a\nb", "\x1b[2J", "x" * 300, "x" * 5000, "../" * 2000, "ünï", "\udcff", "None",
        "1:2:3", "2:1", "nan:nan", "0:inf", "1,2", "nan,nan", "{}", "[]", "$(true)", "%s", "%(prog)s", "2026-13-45",
    ]),
    st.floats().map(repr),
    st.integers().map(str),
    st.text(max_size=30).filter(lambda given: not given.startswith("-")),
)  # fmt: skip


@dataclass(frozen=True)
class Places:
    """Files of one run: the user's, in `user`, which nothing may change, and what may be made, in `out`."""

    user: Path
    out: Path

    def fill(self, given: str) -> str:
        """Return a word of a line with its placeholder replaced."""
        made = {
            "SCENE": ROOT / "scenes/standard.yaml", "BAG": ROOT / "bags/thesis_4_3_short",
            "CSV": self.user / "recording.csv", "READINGS": self.out / "readings.csv", "DIR": self.out / "new",
            "NPZ": self.out / "map.npz", "PNG": self.out / "p.png", "SERIES": self.out / "s.csv",
            "HEADER": self.out / "t.h", "YAML": self.out / "y.yaml", "MCAP": self.out / "t.mcap",
        }  # fmt: skip
        return str(made.get(given, given))

    def hostile(self, kind: str) -> list[str]:
        """Return what no command can read, as "input", or what none can write or may replace, as "output"."""
        user = self.user
        files = {
            "input": [user / "pipe", user, user / "none", user / "empty", user / "noise", "/dev/full", "/dev/zero"],
            "output": ["/proc/nowhere/x", "/dev/full", user / "pipe", user / "mine.txt", user / "mine.txt/below"],
        }
        return [*map(str, files[kind]), "a\0b", "x" * 300, "y/" * 3000, ""]


def make_user_files(folder: Path) -> None:
    """Make what belongs to the user."""
    folder.mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "empty").write_bytes(b"")
    (folder / "noise").write_bytes(bytes(range(256)) * 40)
    (folder / "mine.txt").write_text("mine\n")
    (folder / "recording.csv").write_text("time,support_displacement,beam_displacement\n0,0,0\n")


def takes_values(parser: OpenParser) -> list[argparse.Action]:
    """Return the arguments that take a value."""
    return [action for action in parser.arguments if action.nargs != 0 and not action.choices]


def refused(action: argparse.Action, given: str) -> bool:
    """Return whether the argument's own type refuses a text."""
    kind = action.type
    assert callable(kind), action
    try:
        kind(given)
    except ArgumentTypeError:
        return True
    return False


@st.composite
def hostile_lines(draw: st.DrawFn, places: Places) -> tuple[str, list[str]]:
    """Return the name of a command, and a line of it that is impossible in exactly one place."""
    kind = draw(st.sampled_from(["option", "value", "input", "input", "output", "output"]))
    if kind in ("input", "output"):
        placeholders = INPUTS if kind == "input" else OUTPUTS
        name = draw(st.sampled_from(sorted(name for name, words in LINES.items() if {*words} & {*placeholders})))
        chosen = draw(st.sampled_from([place for place, word in enumerate(LINES[name]) if word in placeholders]))
        words = [places.fill(word) for word in LINES[name]]
        words[chosen] = draw(st.sampled_from(places.hostile(kind)))
        return name, words
    name = draw(st.sampled_from(sorted(PARSERS)))
    words = [places.fill(word) for word in LINES.get(name, name.split()[1:])]
    typed = [one for one in takes_values(PARSERS[name]) if one.type and one.option_strings]
    if kind == "option" or not typed:
        return name, [*words, draw(st.sampled_from(["--unknown", "--unknown=1", "-Z"]))]
    action = draw(st.sampled_from(typed))
    given = draw(VALUES.filter(lambda value: refused(action, value)))
    return name, [*words, f"{action.option_strings[-1]}={given}"]
