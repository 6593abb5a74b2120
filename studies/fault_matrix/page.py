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

runs each fault through the real graph, beside the same run without it, and makes this page. It ends
with status 1 where a fault was not felt (its part gave nothing else than without it), the ceiling
was outside its limits or too fast, a block was not answered exactly once or the bag is not whole.
What is in DIR already is not run again. Times that are missing: nothing was reported.

Sensors, motor and clock are run in lockstep: the standard bench at 0.03 m, 0.02 m from 7 s on; the
fault is there from {begin:g} to {end:g} s. *Height apart*: the largest difference of the commanded height
while the fault is there. Serial link and recorder were run in real time, at 0.03 m, the fault from
1.5 to 4.5 s, while the ceiling was on its way: the link on the emulated stand, with the real
firmware, whose own state was looked at every 20 ms; the recorder as a process, whose file was.
These tables were [made once](decisions/0066-studies-made-once.md).

A scene injects faults by its key `faults` ([scenes](scenes.md)):

```yaml
faults:
  - {{part: support_laser, kind: stuck, from: 4.0, to: 8.0}}
  - {{part: accelerometer, kind: wrong, from: 4.0, to: 8.0, value: 0.5}}
```

In a running graph in real time the parameter of that name takes `PART KIND FROM TO [VALUE]` with
the times in seconds of the run; `['']` ends them. The plant has the faults of sensors and clock,
the motor node those of a simulated motor and height sensor, counted from its first command:

    atpid ros param set /plant_node faults "['support_laser stuck 0 1000']"
    atpid ros param set /motor_node faults "['motor off 0 1000']"

Faults of the serial link are put in between the emulated board and the motor node, which takes none
with a serial port; those of the recorder come from the bench, which kills it or starts it on a disk
that fails. What cannot be injected is refused with the reason: the simulated bench has no serial
link, in lockstep the recorder is no process, and the stand's scene, whose parts are real, has none.
The events are
those of `events` in the bag; the state of each channel and clock is in `/diagnostics`
(`identifier_node: support_displacement`).

## Random sequences

300 sequences of five faults of random part, kind, value, begin and length (0.02 to 4 s), of several
parts at once, in lockstep ([made once](decisions/0066-studies-made-once.md); a test runs one of them). After
each: every state is a documented one, a latched fault has a name and the ceiling stands meanwhile,
every block was answered once, the bag is whole and its [check](recording.md#what-a-bag-holds) silent,
no log has a traceback; and once a person has armed the motor after the last fault, height and ceiling
end within 10 % of where they do without faults.

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
        text = f"Safe state: {note['safe']}. Recovery: {note['recover']}. Recorded: {note['recorded']}."
        lines += [*textwrap.wrap(text, 100), ""]
        lines += _table(rows, part, notes["undetected"]) if part in LOCKSTEP else [_kept(part)]
    return "\n".join(lines).rstrip() + "\n"


def _kept(part: str) -> str:
    return files("studies.fault_matrix").joinpath(f"data/{part}.txt").read_text(encoding="utf-8")


def _table(rows: Sequence[Row], part: str, undetected: Mapping[str, str]) -> list[str]:
    """Return the table of a part, and why some of its faults are not detected."""
    of_part = [row for row in rows if row.part == part]
    lines = [f"| {' | '.join(_COLUMNS)} |\n{'|---' * len(_COLUMNS)}|", *map(_line, of_part)]
    for row in of_part:
        if row.detected is None:
            found = f"- {row.kind} is not detected: {undetected.get(f'{row.part} {row.kind}', 'not detected')}."
            lines += ["", *textwrap.wrap(found, 100, subsequent_indent="  ")]
    return [*lines, ""]


_COLUMNS = (
    "kind", "what is done", "detected", "after [s]", "reported as ended after [s]", "height apart by [m]",
    "height as without it after [s]", "beam, against without [-]",
)  # fmt: skip


def _line(row: Row) -> str:
    meaning = FAULT_KINDS[row.part][row.kind]
    value = f" (value: {meaning.default:g} {meaning.unit})".replace(" -)", ")") if meaning.unit else ""
    found, ended = row.detected, row.recovered
    cells = (
        row.kind,
        meaning.text + value,
        f"event `{found.kind}`" if found else "no",
        f"{found.time - BEGIN:.2f}" if found else "",
        f"{ended.time - END:.2f}" if ended else "",
        f"{row.moved:.3f}",
        "not in the run" if math.isinf(row.recovery) else f"{row.recovery:.1f}",
        f"{row.amplitude:.2f}",
    )
    return f"| {' | '.join(cells)} |"
