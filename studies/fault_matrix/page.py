# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of the fault matrix: what is injected, how it is detected, what the ceiling does, how one recovers."""

import math
import textwrap
from collections.abc import Sequence
from importlib.resources import files

import yaml

from atpid_common.injected_faults import FAULT_KINDS, LINK, PARTS
from studies.fault_matrix import paced
from studies.fault_matrix.paced import PacedRow
from studies.fault_matrix.run import BEGIN, END, Row, in_lockstep

_INTRODUCTION = """\
# Fault matrix

    python -m studies faults --out DIR [--part PART] [--page docs/faults.md]

runs each fault through the real graph, beside the same run without it, and makes this page. Status
1: a fault was not felt, the ceiling was outside its limits or too fast, a block was not answered
exactly once, or the bag is not whole. Runs that are in DIR already are not repeated.

Sensors, motor and clock: in lockstep, the standard bench at 0.03 m, 0.02 m from 7 s on; the fault
from {begin:g} to {end:g} s. Serial link (emulated stand, real firmware) and recorder: in real time, at 0.03 m,
the fault from {paced:g} to {over:g} s, the ceiling on its way.

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

    python -m studies faults --sequences 300 --faults 5 --seed 1 --out DIR

runs random faults, several at once, in lockstep. After each sequence every state is a documented
one, a latched fault has a name and the ceiling stands, every block was answered once, the bag is
whole and its [check](recording.md#what-a-bag-holds) silent; and once a person has armed the motor,
height and ceiling end within 10 % of the run without faults. A sequence that fails is printed, and
its scene and bag stay in DIR.
"""


_STOPS = """\
### Stops on a line that fails

`STOP` (hold) or `DISARM` (motor off) at any instant and after any heights, before the real firmware.
A stop is on the wire within 30 ms of the call, and no height follows it. Where no frame passes, the
firmware switches off for want of a heartbeat. *Confirmed*: when the caller has the answer. Times in
ms; empty: the motor was off already, or nothing was confirmed within 0.5 s.
"""


def remarks() -> dict[str, dict[str, str]]:
    """Return what a person has to add to what is measured: safe states, recovery, what bounds the harm."""
    text = files("studies.fault_matrix").joinpath("data/remarks.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = yaml.safe_load(text)
    return found


def page(rows: Sequence[Row | PacedRow]) -> str:
    """Return the page as Markdown."""
    notes, lines = remarks(), [_INTRODUCTION.format(begin=BEGIN, end=END, paced=paced.BEGIN, over=paced.END)]
    for part in PARTS:
        lines += [f"## {part.replace('_', ' ').capitalize()}", ""]
        note = notes[part]
        of_part = [row for row in rows if row.part == part]
        same = all(isinstance(row, Row) and _without_effect(row) for row in of_part)
        text = f"Safe state: {note['safe']}. Recovery: {note['recover']}. Recorded: {note['recorded']}."
        text += " Heights and beam are those without the fault." if same else ""
        columns = _COLUMNS[:4] if same else _COLUMNS if in_lockstep(part) else _PACED
        lines += [*textwrap.wrap(text, 100), "", _head(columns)]
        lines += [_line(row, same) if isinstance(row, Row) else _paced_line(row) for row in of_part]
        for row in of_part:
            if row.detected is None:
                reason = notes["undetected"].get(f"{row.part} {row.kind}", "not detected")
                found = f"- {row.kind} is not detected: {reason}."
                lines += ["", *textwrap.wrap(found, 100, subsequent_indent="  ")]
        lines.append("")
        if part in LINK:
            stops = files("studies.fault_matrix").joinpath("data/stops.md").read_text(encoding="utf-8")
            lines += [_STOPS, stops]
    return "\n".join(lines).rstrip() + "\n"


_COLUMNS = ("kind", "what is done", "event, after", "ended", "apart", "back", "beam")
_PACED = ("kind", "what is done", "event, after", "ended", "off", "run", "bag")


def _head(columns: Sequence[str]) -> str:
    return f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|"


def _without_effect(row: Row) -> bool:
    """Whether heights and the beam's amplitude are those of the run without the fault, as far as the table shows."""
    return row.moved < 5e-4 and row.recovery < 0.05 and abs(row.amplitude - 1.0) < 5e-3


def _line(row: Row, same: bool) -> str:
    back = "not in the run" if math.isinf(row.recovery) else f"{row.recovery:.1f}"
    if same:
        return _cells(row, BEGIN, END)
    return _cells(row, BEGIN, END, f"{row.moved:.3f}", back, f"{row.amplitude:.2f}")


def _paced_line(row: PacedRow) -> str:
    off = "" if math.isnan(row.motor_off) else f"{row.motor_off:.2f}"
    bag = "is not whole: `verify` names it" if math.isnan(row.recorded) else f"{row.bag}, {row.recorded:.1f} s"
    return _cells(row, paced.BEGIN, paced.END, off, "ends with a line" if row.error else "goes on", bag)


def _cells(row: Row | PacedRow, begin: float, end: float, *more: str) -> str:
    meaning = FAULT_KINDS[row.part][row.kind]
    value = f" (value: {meaning.default:g} {meaning.unit})".replace(" -)", ")") if meaning.unit else ""
    found, ended = row.detected, row.recovered
    detected = f"`{found.kind}`, {found.time - begin:.2f}" if found else "none"
    again = f"{ended.time - end:.2f}" if ended else ""
    return f"| {' | '.join((row.kind, meaning.text + value, detected, again, *more))} |"
