# SPDX-License-Identifier: Apache-2.0
"""The page of the fault matrix: what is injected, how it is detected, what the ceiling does, how one recovers."""

import math
import textwrap
from collections.abc import Sequence
from importlib.resources import files

import yaml

from atpid_common.injected_faults import KINDS, MEANINGS, NOT_ACTED, PARTS
from atpid_control.fault_matrix.run import BEGIN, END, Row

_INTRODUCTION = """\
# Fault matrix

    python -m atpid_control faults --out DIR [--part PART] [--page docs/faults.md]

runs each fault through the real graph in lockstep, beside the same run without it, and makes this
page. The run: the standard bench at 0.03 m, 0.02 m from 7 s on; the fault is there from {begin:g} to
{end:g} s. It ends with status 1 where a fault was not felt (its part gave nothing else than without
it), the ceiling was outside its limits or too fast, a block was not answered exactly once or the
bag is not whole. *Height apart*: the largest difference of the commanded height while the fault is
there. Times that are missing: nothing was reported.

A scene acts faults by its key `faults` ([scenes](scenes.md)):

```yaml
faults:
  - {{part: support_laser, kind: stuck, from: 4.0, to: 8.0}}
  - {{part: accelerometer, kind: wrong, from: 4.0, to: 8.0, value: 0.5}}
```

In a running graph in real time the plant's parameter of that name takes `PART KIND FROM TO [VALUE]`
with the times in seconds of the run; `['']` ends them:

    python -m atpid_common.nodes.param set /plant_node faults "['support_laser stuck 0 1000']"

What cannot be acted is refused with the reason; the stand, whose parts are real, refuses all. The
events are those of `events` in the bag; the state of each channel and clock is in `/diagnostics`
(`identifier_node: support_displacement`).
"""


def remarks() -> dict[str, dict[str, str]]:
    """Return what a person has to add to what is measured: safe states, recovery, what bounds the harm."""
    text = files("atpid_control.fault_matrix").joinpath("data/remarks.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = yaml.safe_load(text)
    return found


def page(rows: Sequence[Row]) -> str:
    """Return the page as Markdown; parts without a row are named with the reason."""
    notes, lines = remarks(), [_INTRODUCTION.format(begin=BEGIN, end=END)]
    for part in PARTS:
        lines += [f"## {part.replace('_', ' ').capitalize()}", ""]
        if part in NOT_ACTED:
            lines += [*textwrap.wrap(f"Refused: {NOT_ACTED[part]}. Rows not yet acted: {', '.join(KINDS)}.", 100), ""]
            continue
        note = notes[part]
        text = f"Safe state: {note['safe']}. Recovery: {note['recover']}. Recorded: {note['recorded']}."
        lines += [*textwrap.wrap(text, 100), "", _HEAD]
        lines += [_line(row) for row in rows if row.part == part]
        hidden = [row for row in rows if row.part == part and row.detected is None]
        for row in hidden:
            reason = notes["undetected"].get(f"{row.part} {row.kind}", "not detected")
            lines += ["", *textwrap.wrap(f"- {row.kind} is not detected: {reason}.", 100, subsequent_indent="  ")]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


_COLUMNS = (
    "kind", "what is done", "detected", "after [s]", "reported as ended after [s]", "height apart by [m]",
    "height as without it after [s]", "beam, against without [-]",
)  # fmt: skip
_HEAD = f"| {' | '.join(_COLUMNS)} |\n{'|---' * len(_COLUMNS)}|"


def _line(row: Row) -> str:
    meaning = MEANINGS[row.part][row.kind]
    value = f" (value: {meaning.default:g} {meaning.unit})".replace(" -)", ")") if meaning.unit else ""
    found, ended = row.detected, row.recovered
    detected = f"event `{found.kind}`" if found else "no"
    after = f"{found.time - BEGIN:.2f}" if found else ""
    again = f"{ended.time - END:.2f}" if ended else ""
    back = "not in the run" if math.isinf(row.recovery) else f"{row.recovery:.1f}"
    cells = (row.kind, meaning.text + value, detected, after, again, f"{row.moved:.3f}", back, f"{row.amplitude:.2f}")
    return f"| {' | '.join(cells)} |"
