# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Drawing of docs/stand.md: the emergency stop of motor, inverter and amplifier, and what is not in its chain."""

from pathlib import Path
from typing import Any

from atpid_sim.figure_style import LIGHT
from studies.figures.stand_parts import Block, Wire, block, drawing, legend, wire

_SAFE, _POWER, _SIGNAL, _USB = "red", "accent", "own", "given_text"
_BLOCKS: dict[str, Block] = {
    "button": (0.0, 10.4, 3.8, 1.9, "S1\nemergency stop,\ntwo contacts"),
    "supply": (0.0, 8.6, 3.8, 1.0, "24 V supply"),
    "reset": (0.0, 5.5, 3.8, 1.9, "S2\nreset, a push\nbutton of its own"),
    "relay": (7.8, 4.7, 3.0, 7.9, "K0\nsafety relay\n\ntwo channels,\nforce-guided\ncontacts,\nmonitored\n"
              "manual reset"),
    "start": (13.9, 9.2, 2.8, 1.2, "S3\nexciter on"),
    "amplifier_contactor": (13.9, 6.7, 2.8, 1.4, "K2, in the am-\nplifier's mains"),
    "motor_contactor": (13.9, 4.3, 2.8, 1.4, "K1, in the\nmotor's supply"),
    "signal_relay": (13.9, 1.1, 2.8, 2.0, "K3\nfor signals"),
    "inverter": (20.3, 9.4, 3.3, 3.2, "inverter,\nset so that a\nreturning STO\nstarts nothing"),
    "amplifier": (20.3, 5.9, 3.3, 2.2, "amplifier of a\nshaker; at rest\nK3 opens and\nshorts its input"),
    "driver": (20.3, 1.1, 3.3, 4.2, "driver of\nthe ceiling's\nmotor"),
    "mega": (7.8, 0.8, 3.0, 2.3, "Arduino\nMega 2560"),
    "t7": (7.8, -1.5, 3.0, 1.4, "LabJack T7"),
    "pc": (0.4, -1.5, 3.4, 4.6, "PC: sees D26,\nlatches motor\nand exciter"),
}  # fmt: skip
_WIRES: tuple[Wire, ...] = (
    (((3.8, 11.7), (7.8, 11.7)), "channel 1", _SAFE, (4.0, 11.85)),
    (((3.8, 10.8), (7.8, 10.8)), "channel 2", _SAFE, (4.0, 10.95)),
    (((3.8, 9.1), (7.8, 9.1)), "24 V, 0 V", _SAFE, (4.0, 9.25)),
    (((3.8, 6.9), (7.8, 6.9)), "acts when let go", _SAFE, (4.0, 7.05)),
    (((3.8, 6.0), (7.8, 6.0)), "feedback loop", _SAFE, (4.7, 4.9)),
    (((10.8, 12.1), (20.3, 12.1)), "23–24: STO, channel 1", _SAFE, (12.6, 12.25)),
    (((10.8, 11.3), (20.3, 11.3)), "33–34: STO, channel 2", _SAFE, (12.6, 11.45)),
    (((10.8, 9.8), (13.0, 9.8), (13.0, 2.6), (13.9, 2.6)), "13–14", _SAFE, (11.95, 9.95)),
    (((13.0, 9.8), (13.9, 9.8)), "", _SAFE, (13.0, 9.8)),
    (((13.0, 7.4), (13.9, 7.4)), "", _SAFE, (13.0, 7.4)),
    (((13.0, 5.0), (13.9, 5.0)), "", _SAFE, (13.0, 5.0)),
    (((15.3, 9.2), (15.3, 8.1)), "on; K2 then holds itself", _SAFE, (15.5, 8.45)),
    (((16.7, 9.8), (20.3, 9.8)), "start, by an edge", _SAFE, (16.9, 9.95)),
    (((16.7, 7.4), (20.3, 7.4)), "mains", _POWER, (17.9, 7.55)),
    (((16.7, 5.0), (20.3, 5.0)), "fuse, end\nswitches", _POWER, (17.6, 3.95)),
    (((16.7, 2.6), (19.6, 2.6), (19.6, 6.6), (20.3, 6.6)), "input", _SIGNAL, (17.9, 2.75)),
    (((16.7, 1.7), (20.3, 1.7)), "enable", _SIGNAL, (17.9, 1.85)),
    (((10.8, 2.2), (13.9, 2.2)), "D22 enable", _SIGNAL, (11.4, 2.3)),
    (((10.8, 1.5), (13.9, 1.5)), "D26, to GND", _SIGNAL, (11.4, 0.95)),
    (((10.8, -0.8), (15.3, -0.8), (15.3, 1.1)), "DAC0, DAC1", _SIGNAL, (11.4, -0.65)),
    (((3.8, 2.0), (7.8, 2.0)), "USB", _USB, (5.4, 2.15)),
    (((3.8, -0.8), (7.8, -0.8)), "USB", _USB, (5.4, -0.65)),
)  # fmt: skip
#: Contacts: middle, whether normally closed, and a name.
_CONTACTS: tuple[tuple[float, float, bool, str], ...] = (
    (6.8, 11.7, True, ""), (6.8, 10.8, True, ""), (7.1, 6.9, False, ""),
    (4.7, 6.0, True, "K1"), (5.8, 6.0, True, "K2"), (6.9, 6.0, True, "K3"),
    (11.6, 12.1, False, ""), (11.6, 11.3, False, ""), (11.6, 9.8, False, ""),
    (17.3, 7.4, False, ""), (17.3, 5.0, False, ""), (17.3, 2.6, False, ""), (17.3, 1.7, False, ""),
    (13.3, 1.5, False, ""),
)  # fmt: skip
#: What the picture cannot show.
_NOTE = (
    "Drawn at rest: no button pressed, relays off. A stand has the inverter or the amplifier, and S3 starts either.\n"
    "UNVERIFIED: nobody has built or tried this circuit; the numbers of K0's contacts are the usual ones."
)
#: Where a wire branches.
_NODES = ((13.0, 9.8), (13.0, 7.4), (13.0, 5.0))


def draw(path: Path) -> Path:
    """Draw the chain: what stops red, power orange, signals blue, USB grey."""
    with drawing(path, 10.6, 7.8) as ax:
        for each in _WIRES:
            wire(ax, *each)
        for one in _BLOCKS.values():
            block(ax, *one)
        for x, y, closed, name in _CONTACTS:
            _contact(ax, x, y, closed, name)
        ax.plot(*zip(*_NODES, strict=True), "o", color=getattr(LIGHT, _SAFE), ms=4.0)
        _apart(ax)
        legend(
            ax, -3.0, (0.0, "what stops", _SAFE), (3.2, "power", _POWER), (5.2, "signals", _SIGNAL), (7.7, "USB", _USB)
        )
        ax.text(0.0, -3.8, _NOTE, color=LIGHT.muted, va="top")
        ax.set(xlim=(-0.3, 23.9), ylim=(-5.2, 13.0))
    return path


def _contact(ax: Any, x: float, y: float, closed: bool, name: str) -> None:
    """Draw a contact at rest into a wire from left to right."""
    gap, ink = 0.28, {"color": LIGHT.ink, "lw": 1.4, "zorder": 2.5}
    ax.plot([x - gap, x + gap], [y, y], color=LIGHT.paper, lw=3.0, zorder=2)
    if closed:
        ax.plot([x + gap, x + gap], [y, y + 0.26], **ink)
        ax.plot([x - gap, x + gap + 0.1], [y, y + 0.24], **ink)
    else:
        ax.plot([x - gap, x + gap - 0.04], [y, y + 0.34], **ink)
    ax.text(x, y - 0.15, name, fontsize=8.0, ha="center", va="top")


def _apart(ax: Any) -> None:
    """Frame what is not in the chain."""
    from matplotlib.patches import Rectangle

    ax.add_patch(Rectangle((0.0, -1.9), 11.2, 5.4, fc="none", ec=LIGHT.muted, lw=1.0, ls="--", zorder=0))
    ax.text(0.1, 3.6, "not in the chain of the emergency stop", color=LIGHT.muted, va="bottom")
