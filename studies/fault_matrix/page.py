# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of the fault matrix: what is injected, how it is detected, what the ceiling does, how one recovers."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from importlib.resources import files

import yaml

from atpid_common.injected_faults import FAULT_KINDS, LOCKSTEP, PARTS
from studies.fault_matrix.run import BEGIN, END, Row

_INTRODUCTION = """\
# Fault matrix

    python -m studies faults --out DIR [--part PART] [--page docs/faults.md]

runs each fault through the real graph, beside the same run without it, and makes this page. Status
1: a fault was not felt, the ceiling was outside its limits or too fast, a block was not answered
exactly once, or the bag is not whole.

Sensors, motor and clock: in lockstep, the standard bench at 0.03 m, 0.02 m from 7 s on; the fault
from {begin:g} to {end:g} s. Serial link (emulated stand, real firmware) and recorder: in real time, at 0.03 m,
the fault from 1.5 to 4.5 s, the ceiling on its way; these tables were
[made once](decisions/0066-studies-made-once.md).

| column | meaning; empty: nothing was reported |
|---|---|
| event, after | what reports the fault, and when, from its begin [s] |
| ended | from the fault's end to the event that reports it [s] |
| apart | largest difference of the commanded height from the run without fault, while it lasts [m] |
| back | from the fault's end until the height is that without fault [s] |
| beam | largest amplitude while the fault lasts, over that without [-] |
| off | until the motor is off [s] |

A scene injects faults by its key `faults` ([scenes](scenes.md)):

```yaml
faults:
  - {{part: support_laser, kind: stuck, from: 4.0, to: 8.0}}
  - {{part: accelerometer, kind: wrong, from: 4.0, to: 8.0, value: 0.5}}
```

A graph in real time takes `PART KIND FROM TO [VALUE]`, in seconds of the run, by the parameter
`faults`; `['']` ends them. The plant has those of sensors and clock, the motor node those of a
simulated motor and height sensor, counted from its first command:

    atpid ros param set /plant_node faults "['support_laser stuck 0 1000']"
    atpid ros param set /motor_node faults "['motor off 0 1000']"

Faults of the serial link need the emulated board, those of the recorder a bench in real time; what
cannot be injected is refused with the reason. The states of channels and clock are in
`/diagnostics` (`identifier_node: support_displacement`).

## Random sequences

After each of 300 sequences of five random faults of several parts at once, in lockstep ([made
once](decisions/0066-studies-made-once.md); a test runs one), every state is a documented one, a
latched fault has a name and the ceiling stands meanwhile, every block was answered once, and the
bag is whole and its [check](recording.md#what-a-bag-holds) silent. Once a person has armed the motor
after the last fault, height and ceiling end within 10 % of where they do without faults.
"""


def remarks() -> dict[str, dict[str, str]]:
    """Return what a person has to add to what is measured: safe states, recovery, what bounds the harm."""
    text = files("studies.fault_matrix").joinpath("data/remarks.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = yaml.safe_load(text)
    return found


def page(rows: Sequence[Row]) -> str:
    """Return the page as Markdown; the tables of what needs real time were made once."""
    notes, lines = remarks(), [_INTRODUCTION.format(begin=BEGIN, end=END)]
    for part in PARTS:
        lines += [f"## {part.replace('_', ' ').capitalize()}", ""]
        note = notes[part]
        part_rows = [row for row in rows if row.part == part]
        same = part in LOCKSTEP and all(_without_effect(row) for row in part_rows)
        text = f"Safe state: {note['safe']}. Recovery: {note['recover']}. Recorded: {note['recorded']}."
        text += " Heights and beam are those without the fault." if same else ""
        text += f" What is done: as with the {PARTS[0].replace('_', ' ')}." if _as_first(part) else ""
        lines += [*textwrap.wrap(text, 100), ""]
        lines += _table(part_rows, same, notes["undetected"]) if part in LOCKSTEP else [_kept(part)]
    return "\n".join(lines).rstrip() + "\n"


_DONE = "what is done"
_COLUMNS = ("kind", _DONE, "event, after", "ended", "apart", "back", "beam")


def _kept(part: str) -> str:
    return files("studies.fault_matrix").joinpath(f"data/{part}.txt").read_text(encoding="utf-8")


def _table(rows: Sequence[Row], same: bool, undetected: Mapping[str, str]) -> list[str]:
    """Return the table of a part, and why some of its faults are not detected."""
    columns = [name for name in (_COLUMNS[:4] if same else _COLUMNS) if name != _DONE or not _as_first(rows[0].part)]
    lines = [f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|", *(_line(row, same) for row in rows)]
    for row in rows:
        if row.detected is None:
            found = f"- {row.kind} is not detected: {undetected.get(f'{row.part} {row.kind}', 'not detected')}."
            lines += ["", *textwrap.wrap(found, 100, subsequent_indent="  ")]
    return [*lines, ""]


def _as_first(part: str) -> bool:
    """Whether each kind does to the part what it does to the first one, whose table says it."""
    texts = [[kind.text for kind in FAULT_KINDS[each].values()] for each in (part, PARTS[0])]
    return part != PARTS[0] and texts[0] == texts[1]


def _without_effect(row: Row) -> bool:
    """Whether heights and the beam's amplitude are those of the run without the fault, as far as the table shows."""
    return row.moved < 5e-4 and row.recovery < 0.05 and abs(row.amplitude - 1.0) < 5e-3


def _line(row: Row, same: bool) -> str:
    meaning = FAULT_KINDS[row.part][row.kind]
    value = f" (value: {meaning.default:g} {meaning.unit})".replace(" -)", ")") if meaning.unit else ""
    found, ended = row.detected, row.recovered
    named = [row.kind, meaning.text + value]
    if _as_first(row.part):
        named = [row.kind + (value if meaning.default != FAULT_KINDS[PARTS[0]][row.kind].default else "")]
    cells = [
        *named,
        f"`{found.kind}`, {found.time - BEGIN:.2f}" if found else "none",
        f"{ended.time - END:.2f}" if ended else "",
    ]
    if not same:
        back = "not in the run" if math.isinf(row.recovery) else f"{row.recovery:.1f}"
        cells += [f"{row.moved:.3f}", back, f"{row.amplitude:.2f}"]
    return f"| {' | '.join(cells)} |"
