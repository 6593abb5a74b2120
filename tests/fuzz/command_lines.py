# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile command lines: a valid one of each command, made impossible in exactly one place, from the real parsers."""

from __future__ import annotations

import argparse
import os
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hypothesis import strategies as st

from atpid_common.arguments import file_path, text, word
from atpid_common.cli import Parser, load
from atpid_control import cli as control
from studies import cli as studies

Main = Callable[[Sequence[str]], int]
ROOT = Path(__file__).resolve().parent.parent.parent
#: What a line may hold instead of a path: INPUTS are there, OUTPUTS are to be made.
INPUTS, OUTPUTS = (
    ("SCENE", "BAG", "CSV", "READINGS"),
    ("DIR", "MAP", "PNG", "SERIES", "HEADER", "PAGE", "YAML", "LINK", "MCAP"),
)

#: A valid line of each command; what would start processes or need a device lacks nothing but its hostile place.
LINES: dict[str, tuple[Main, str]] = {
    "simulate": (control.main, "simulate SCENE --rtol 1e-4 --height 0.1 --series SERIES --rate 100 --picture PNG"),
    "basin": (
        control.main,
        "basin SCENE --height 0.1 --kick 0.1 --error 0.2 --starts 5 --seed 1 --out SERIES --workers 1",
    ),
    "heights": (
        control.main,
        "sweep SCENE --heights 0.1:0.2:2 --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --rtol 1e-2 --out SERIES",
    ),
    "map": (
        control.main,
        "map SCENE --amplitudes 0.01:0.02:2 --mass-fractions 0.1 --out MAP --header HEADER --workers 1",
    ),
    "cliffs": (control.main, "cliffs SCENE --height 0.19:0.3 --amplitudes 0.009:0.011 --out SERIES --picture PNG"),
    "sweep": (studies.main, "sweep --points 1 --rtol 1e-3"),
    "tradeoff": (studies.main, "tradeoff SCENE --out DIR --patience 1"),
    "extremes": (studies.main, "extremes --systems 1 --first 0 --seed 1 --fidelities impact --out DIR"),
    "atlas": (studies.main, "atlas SCENE --out DIR --amplitudes 0.01:0.02 --quick --workers 1"),
    "bench": (
        control.main,
        "bench SCENE --out DIR --domain 7 --priority 0 --map MAP --params-file YAML --namespace lab1",
    ),
    "soak": (studies.main, "soak SCENE --hours 1 --leg 1 --seed 1 --out DIR"),
    "stand": (
        control.main,
        "stand SCENE --map MAP --labjack-config YAML --params-file YAML --namespace lab1 --log-level warn",
    ),
    "excite": (control.main, "excite SCENE --amplitude 0.01 --frequency 5 --sweep 6 --duration 10 --namespace lab1"),
    "campaign": (control.main, "campaign CSV --out DIR"),
    "first-run": (control.main, "first-run SCENE --out DIR --simulated --yes --amplitude 0.01 --move 0.1"),
    "bag import": (control.main, "bag import CSV --out DIR --rate 100"),
    "calibrate campaign": (control.main, "calibrate campaign BAG --out DIR --moving-mass 1"),
    "seeds": (studies.main, "seeds SCENE --seeds 1 --decibels 20 --margin 1"),
    "faults": (studies.main, "faults --out DIR --part clock --domain 7"),
    "replay": (control.main, "replay BAG --out DIR --rate 0 --domain 7"),
    "bag report": (control.main, "bag report BAG --out DIR"),
    "bag traces": (control.main, "bag traces BAG --out MCAP --rate 200"),
    "select": (control.main, "select SCENE --method lookup --map MAP --amplitude-std 0.001 --margin 1"),
    "methods": (studies.main, "methods SCENE --out DIR"),
    "off-resonance": (studies.main, "off-resonance --systems 1 --seed 1"),
    "learn": (control.main, "learn --out DIR --systems 32"),
    "design": (
        control.main,
        "design --mass 2 --frequency 15 --damping 0.02 --amplitudes 0.001:0.004 --uncertainty mass=0.1 --out DIR",
    ),
    "modes cantilever": (
        control.main,
        "modes cantilever --length 0.4 --width 0.04 --thickness 0.008 --modulus 5e9 --density 2400 --tip-mass 0.25 "
        "--tip-inertia 1e-5 --damping-ratio 0.02 --modes 2 --force-at 0.3 --scene SCENE --out YAML",
    ),
    "modes file": (
        control.main,
        "modes file CSV --container 1:z --force-at 2:z --modes 2 --damping-ratio 0.02 --scene SCENE --out YAML",
    ),
    "modes fit": (
        control.main,
        "modes fit CSV --modes 2 --masses 0.3 1 --damping-ratio 0.02 --from 0 --to 9 --scene SCENE --out YAML",
    ),
    "calibrate beam": (
        control.main,
        "calibrate beam CSV --moving-mass 0.4 --moving-mass-std 0.1 --grain-mass 0.1 --from 0 --to 9 --out YAML",
    ),
    "calibrate contact": (
        control.main,
        "calibrate contact CSV --mass 0.02 --radius 0.01 --gravity 9.81 --channel force "
        "--height-std 1e-4 --from 0 --to 9 --out YAML",
    ),
    "bag validate": (control.main, "bag validate CSV --scene SCENE --height 0.1 --from 0 --to 9 --out DIR"),
    "bag export": (control.main, "bag export BAG --format csv --out SERIES --topic /sensors/laser --from 0 --to 9"),
    "bag analyse": (control.main, "bag analyse BAG --out DIR --from 0 --to 9 --resolution 1"),
    "bag compare": (control.main, "bag compare BAG BAG --out DIR"),
    "thesis": (studies.main, "thesis free_decay --out DIR --scenes DIR"),
    "figures": (studies.main, "figures selection --out DIR --map MAP"),
    "calibrate sensor": (
        control.main,
        "calibrate sensor READINGS --channel c --sensor s --serial 1 --degree 1 --limits 1 5 --broken-loop 0.5 "
        "--date 2026-01-01 --out YAML --picture PNG",
    ),
    "calibrate reading": (
        control.main,
        "calibrate reading READINGS --position 0.1 --terminal AIN0 --serial 1 --rate 100 --seconds 0.1 --library /none",
    ),
    "load": (studies.main, "load --seconds 1 --bag DIR"),
    "standin": (control.main, "standin --ljm-control LINK --drop 1 --fail 1 --hold 0:1 --release 0"),
    "bag extract": (control.main, "bag extract BAG --out DIR --support 0:1"),
    "emulator": (control.main, "emulator --link LINK --eeprom LINK --height 0.3"),
    "fuzz": (studies.main, "fuzz --frames 1 --seed 1"),
    "ros echo": (control.main, "ros echo /topic --once"),
    "ros param": (control.main, "ros param get /node name"),
    "ros lifecycle": (control.main, "ros lifecycle /node configure"),
}

#: Commands whose outputs cannot be tried without starting what they are for: only their other words are changed.
_STARTED = {
    "load", "stand", "emulator", "fuzz", "ros echo", "ros param", "ros lifecycle", "standin", "calibrate reading",
}  # fmt: skip

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
            "MAP": self.out / "map.npz", "PNG": self.out / "p.png", "SERIES": self.out / "s.csv",
            "HEADER": self.out / "t.h", "PAGE": self.out / "p.md", "YAML": self.out / "y.yaml", "LINK": self.out / "l",
            "MCAP": self.out / "t.mcap",
        }  # fmt: skip
        return str(made.get(given, given))

    def hostile_inputs(self) -> list[str]:
        """Return what no command can read."""
        user = self.user
        files = [user / "pipe", user, user / "none", user / "empty", user / "noise", "/dev/full", "/dev/zero"]
        return [*map(str, files), "a\0b", "x" * 300, "y/" * 3000, ""]

    def hostile_outputs(self) -> list[str]:
        """Return what no command can write, or may not replace."""
        user = self.user
        files = ["/proc/nowhere/x", "/dev/full", user / "pipe", user / "mine.txt", user / "mine.txt/below"]
        return [*map(str, files), "a\0b", "x" * 300, "y/" * 3000, ""]


def make_user_files(folder: Path) -> None:
    """Make what belongs to the user."""
    folder.mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "empty").write_bytes(b"")
    (folder / "noise").write_bytes(bytes(range(256)) * 40)
    (folder / "mine.txt").write_text("mine\n")
    (folder / "recording.csv").write_text("time,support_displacement,beam_displacement\n0,0,0\n")


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield each command's own parser."""
    for program in (control, studies):
        for name, (place, _) in (item for group in program.COMMANDS.values() for item in group.items()):
            parser = Parser(prog=name)
            load(place).add_arguments(parser)
            yield name, parser
            for action in parser._actions:
                if isinstance(action, argparse._SubParsersAction):
                    yield from ((f"{name} {inner}", one) for inner, one in action.choices.items())


def actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return the arguments that take a value."""
    return [action for action in parser._actions if action.nargs != 0 and not action.choices]


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
    name = draw(st.sampled_from(sorted(LINES)))
    words = LINES[name][1].split()
    kinds = ["option", "value"]
    kinds += ["input"] * any(given in INPUTS for given in words) * 2
    kinds += ["output"] * (name not in _STARTED and any(given in OUTPUTS for given in words)) * 2
    kind = draw(st.sampled_from(kinds))
    if kind == "option":
        place = draw(st.integers(1, len(words)))
        words.insert(place, draw(st.sampled_from(["--unknown", "--unknown=1", "-Z"])))
        return name, [places.fill(given) for given in words]
    if kind == "value":
        changed = [place for place, given in enumerate(words) if _is_value(words, place)]
        if not changed:
            return name, ["--unknown"]
        place = draw(st.sampled_from(changed))
        given = draw(VALUES.filter(lambda value: _impossible(name, words, place, value)))
    else:
        chosen = INPUTS if kind == "input" else OUTPUTS
        place = draw(st.sampled_from([place for place, given in enumerate(words) if given in chosen]))
        given = draw(st.sampled_from(places.hostile_inputs() if kind == "input" else places.hostile_outputs()))
    filled = [places.fill(word_) for word_ in words]
    if place and words[place - 1].startswith("--") and kind == "value":
        filled[place - 1 : place + 1] = [f"{words[place - 1]}={given}"]
    else:
        filled[place] = given
    return name, filled


_PARSERS = dict(parsers())


def _is_value(words: list[str], place: int) -> bool:
    return place > 0 and words[place - 1].startswith("--") and not words[place].startswith("--")


def _impossible(name: str, words: list[str], place: int, value: str) -> bool:
    """Return whether the type of the option before `place` refuses the value, by the parser of the command itself."""
    parser = _PARSERS.get(name)
    if parser is None:  # of the commands with a parser of their own
        number = words[place] not in (*INPUTS, *OUTPUTS)  # a file may be called nan
        return value in ("", "\0", "a\0b", "x" * 5000) or (number and value in ("\n", "nan", "-1e999"))
    found = parser._option_string_actions.get(words[place - 1])
    return found is not None and callable(found.type) and refused(found, value)


#: Types of a text that any word fits.
FREE = (text, word, file_path)
