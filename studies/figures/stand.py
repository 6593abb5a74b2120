# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Drawings of docs/stand.md, container, wiring and emergency stop, and the amplitudes a stand reaches.

python -m studies figures stand --out docs/figures
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

from atpid_common import output
from atpid_lab.modes.cantilever import Cantilever, modes_of
from atpid_sim.figure_style import LIGHT
from atpid_sim.scene import standard_bench
from studies.figures import emergency_stop
from studies.figures.stand_parts import Block, Wire, block, drawing, legend, wire

#: Grain of the drawing: a steel ball, 9 % of the thesis's beam [m], [kg/m^3]; PLA [kg/m^3].
GRAIN, STEEL, PLA = 0.020, 7850.0, 1240.0
#: Play of the grain at the side, wall, floor, lining, piston, cap, and the largest height (thesis: h5) [m].
PLAY, WALL, FLOOR, LINING, PISTON, CAP, HIGHEST = 0.001, 0.003, 0.006, 0.003, 0.012, 0.006, 0.200
#: From clamp to damper [m] and width [m] (thesis, Table 2.1); container with its motor at the tip [kg].
LENGTH, WIDTH, TIP = 0.400, 0.040, 0.30
#: Reach of a laser (thesis, section 2.2) [m]; moving parts of the exciter, beam and clamp [kg].
REACH, MOVED = 0.150, 2.0


class Strip(NamedTuple):
    """A beam: name, thickness [m], modulus [Pa], density [kg/m^3], strain it bears for ever, in both directions [-]."""

    name: str
    thickness: float
    modulus: float
    density: float
    strain: float


#: Endurance limits: 90 MPa of aluminium at 5e8 cycles, 400 MPa of polished spring steel; 8 mm is the thesis's section.
STRIPS = (
    Strip("aluminium, 8 mm", 0.008, 70e9, 2700.0, 90e6 / 70e9),
    Strip("aluminium, 3 mm", 0.003, 70e9, 2700.0, 90e6 / 70e9),
    Strip("spring steel, 2 mm", 0.002, 206e9, 7850.0, 400e6 / 206e9),
    Strip("spring steel, 1.5 mm", 0.0015, 206e9, 7850.0, 400e6 / 206e9),
)


class Limits(NamedTuple):
    """What a beam allows: stiffness at the tip [N/m], first frequency [Hz], and amplitudes [m]."""

    stiffness: float
    frequency: float
    tip: float  # at which the strain at the clamp is the endurance limit
    support: float  # at resonance with the damper closed, for that, or for the laser


def limits_of(strip: Strip, ratio: float) -> Limits:
    """Return a strip's limits with the tip mass; ratio: of the closed damper's damping [-].

    The strain at the clamp of a cantilever bent by X at its tip is 3 (t/2) X / L^2.
    """
    bending = strip.modulus * WIDTH * strip.thickness**3 / 12.0
    beam = Cantilever(LENGTH, bending, strip.density * WIDTH * strip.thickness * LENGTH, TIP)
    tip = strip.strain * LENGTH**2 / (1.5 * strip.thickness)
    return Limits(3.0 * bending / LENGTH**3, modes_of(beam, 1).modes[0].frequency, tip, 2.0 * ratio * min(tip, REACH))


def damping_ratio() -> float:
    """Return that of the thesis's beam with the damper closed [-]."""
    scene = standard_bench()
    return scene.beam.damping / (2.0 * math.sqrt(scene.beam.stiffness * scene.total_mass))


def table() -> str:
    """Return the tables of docs/stand.md: what the drive, and what beams allow."""
    lines = ["| drive at | ±5 mm: velocity, acceleration, force | ±10 mm |", "|---|---|---|"]
    for frequency in (3.0, 5.5, 10.0, 20.0, 60.0):
        turn = 2.0 * math.pi * frequency
        cells = [f"{turn * a:.2g} m/s, {turn**2 * a:.1f} m/s², {MOVED * turn**2 * a:.0f} N" for a in (0.005, 0.010)]
        lines.append(f"| {frequency:g} Hz | {cells[0]} | {cells[1]} |")
    lines += [
        "", "| beam, 40 mm wide, 0.4 m | stiffness | first mode | tip at most | support at resonance, closed |",
        "|---|---|---|---|---|",
    ]  # fmt: skip
    for strip in STRIPS:
        found = limits_of(strip, damping_ratio())
        tip, support = f"±{found.tip * 1e3:.0f} mm", f"±{found.support * 1e3:.2g} mm"
        lines.append(f"| {strip.name} | {found.stiffness:.0f} N/m | {found.frequency:.1f} Hz | {tip} | {support} |")
    return "\n".join(lines)


def container_mass() -> float:
    """Return the mass of the printed parts of the drawing [kg], without screw, motor and linings."""
    inner, outer = GRAIN + PLAY, GRAIN + PLAY + 2.0 * WALL
    height = HIGHEST + 2.0 * LINING + PISTON
    tube = 0.25 * math.pi * (outer**2 - inner**2) * height
    return PLA * (tube + 0.25 * math.pi * (outer**2 * (FLOOR + CAP) + inner**2 * PISTON))


def grain_mass() -> float:
    """Return the mass of the drawing's grain [kg]."""
    return STEEL * math.pi * GRAIN**3 / 6.0


def draw(folder: Path) -> list[Path]:
    """Draw the pictures into `folder`; return their paths."""
    output.folder(folder)
    return [
        emergency_stop.draw(folder / "emergency_stop.svg"),
        _container(folder / "stand_container.svg"),
        _wiring(folder / "stand_wiring.svg"),
    ]


def _container(path: Path) -> Path:
    """Draw container, grain and ceiling in section, with dimensions [mm]."""
    from matplotlib.patches import Circle, Rectangle

    bore, outer, lining = (1e3 * one for one in (GRAIN + PLAY, GRAIN + PLAY + 2.0 * WALL, LINING))
    wall, floor, piston, cap, grain = (1e3 * one for one in (WALL, FLOOR, PISTON, CAP, GRAIN))
    height, top = 90.0, 1e3 * (HIGHEST + 2.0 * LINING + PISTON)  # where the ceiling is drawn, and the tube's upper end

    with drawing(path, 7.6, 10.2) as ax:

        def box(x: float, y: float, w: float, h: float, **look: Any) -> None:
            usual: dict[str, Any] = {"ec": LIGHT.ink, "lw": 0.8, "fc": LIGHT.soft}
            ax.add_patch(Rectangle((x, y), w, h, **(usual | look)))

        def across(x0: float, x1: float, y: float, text: str) -> None:
            ax.annotate("", (x0, y), (x1, y), arrowprops={"arrowstyle": "<->", "lw": 0.7, "color": LIGHT.muted})
            ax.text(0.5 * (x0 + x1), y - 1.5, text, ha="center", va="top")

        def up(y0: float, y1: float, x: float, text: str) -> None:
            ax.annotate("", (x, y0), (x, y1), arrowprops={"arrowstyle": "<->", "lw": 0.7, "color": LIGHT.muted})
            ax.plot([0.5 * outer, x + 2.0], [y0, y0], color=LIGHT.grid, lw=0.8, zorder=0)
            ax.plot([0.5 * outer, x + 2.0], [y1, y1], color=LIGHT.grid, lw=0.8, zorder=0)
            ax.text(x + 2.5, 0.5 * (y0 + y1), text, va="center")

        def named(text: str, x: float, y: float, at: float) -> None:
            ax.annotate(text, (x, y), (-30.0, at), ha="right", va="center",
                        arrowprops={"arrowstyle": "-", "lw": 0.6, "color": LIGHT.muted})  # fmt: skip

        box(-60.0, -floor - 8.0, 120.0, 8.0, fc=LIGHT.grid)  # beam
        box(-0.5 * outer, -floor, outer, floor)
        for side in (-1.0, 1.0):
            box(side * 0.5 * (bore + wall) - 0.5 * wall, 0.0, wall, top)
        box(-0.5 * bore, 0.0, bore, lining, fc=LIGHT.accent, alpha=0.5)
        ax.add_patch(Circle((0.0, lining + 34.0), 0.5 * grain, fc=LIGHT.given, ec=LIGHT.ink, lw=0.8))
        box(-0.5 * bore + 0.3, lining + height, bore - 0.6, lining, fc=LIGHT.accent, alpha=0.5)
        box(-0.5 * bore + 0.3, 2.0 * lining + height, bore - 0.6, piston, fc=LIGHT.own, alpha=0.6)
        plate = top + cap
        box(-0.5 * outer, top, 0.5 * outer + 60.0, cap)
        rod = lining + height + plate + 25.0 - (lining + grain)  # as long as the lowest ceiling needs
        box(-4.0, 2.0 * lining + height, 8.0, rod - 2.0 * lining - height, fc=LIGHT.window)
        box(-11.0, plate + 2.0, 22.0, 14.0, fc=LIGHT.grid)  # nut with its pulley
        box(33.0, plate + 2.0, 16.0, 14.0, fc=LIGHT.grid)  # the motor's pulley
        for side in (4.0, 14.0):
            ax.plot([11.0, 33.0], [plate + side, plate + side], color=LIGHT.ink, lw=1.2)
        box(24.0, plate + 20.0, 34.0, 44.0, fc=LIGHT.given)
        named("beam, at 0.4 m from its clamp", -40.0, -floor - 4.0, -floor - 20.0)
        named("floor, 4 × M4 into the beam", -0.5 * outer + 1.0, -0.5 * floor, 4.0)
        named("lining: decides e", -0.5 * bore + 1.0, 0.5 * lining, 22.0)
        named("grain", -0.5 * grain + 1.0, lining + 34.0, 42.0)
        named("tube, printed; slots along it let air by", -0.5 * (bore + wall), lining + 64.0, 66.0)
        named("piston: the ceiling, with its lining", -0.5 * bore + 2.0, lining + height + 8.0, 102.0)
        named("threaded rod, fixed to the piston, which\na key in a slot keeps from turning", -3.0, 160.0, 160.0)
        named("plate", -0.5 * outer + 1.0, top + 3.0, 208.0)
        named("nut in two bearings, with its pulley", -10.0, plate + 9.0, 232.0)
        ax.text(41.0, plate + 42.0, "motor", ha="center", va="center", weight="bold")
        ax.text(22.0, plate + 9.0, "belt", ha="center", va="center", fontsize=8.0)
        up(lining, lining + height, 26.0, f"h = {GRAIN * 1e3 + 0.5:g} … {HIGHEST * 1e3:g}\nfloor to ceiling")
        up(0.0, top, 74.0, f"{top:.0f}")
        up(-floor, 0.0, 26.0, f"{floor:g}")
        up(top, top + cap, 26.0, f"{cap:g}")
        up(lining + height + lining, lining + height + lining + piston, 26.0, f"{piston:g}")
        across(-0.5 * bore, 0.5 * bore, -floor - 12.0, f"bore Ø{bore:g} = grain Ø{grain:g} + {1e3 * PLAY:g}")
        across(-0.5 * outer, 0.5 * outer, -floor - 23.0, f"Ø{outer:g}, wall {wall:g}, linings {lining:g}")
        masses = f"Printed parts in PLA {1e3 * container_mass():.0f} g, a steel grain {1e3 * grain_mass():.0f} g."
        ax.text(-10.0, -floor - 42.0, f"mm, drawn at h = {height:g}. {masses}", ha="center", color=LIGHT.muted)
        ax.set(xlim=(-118.0, 92.0), ylim=(-floor - 48.0, rod + 6.0))
    return path


#: Of the wiring.
_BLOCKS: dict[str, Block] = {
    "supply": (-0.6, 10.2, 3.2, 1.2, "24 V supply\nof the lasers"),
    "laser1": (-0.6, 8.2, 3.2, 1.2, "laser at the support\n4–20 mA"),
    "laser2": (-0.6, 6.2, 3.2, 1.2, "laser at the tip\n4–20 mA"),
    "accelerometer": (-0.6, 4.2, 3.2, 1.2, "accelerometer\nIEPE"),
    "t7": (6.4, 6.2, 2.6, 3.4, "LabJack T7"),
    "ni": (6.4, 4.2, 2.6, 1.2, "NI-9230"),
    "pc": (12.6, 6.2, 2.4, 3.4, "PC"),
    "mega": (6.4, -1.0, 2.6, 4.0, "Arduino\nMega 2560"),
    "pot": (-0.6, 2.2, 3.2, 1.2, "potentiometer\n10 kΩ"),
    "switches": (-0.6, -1.0, 3.2, 1.6, "limit switches,\nsafety relay\n(closed to run)"),
    "driver": (12.6, 0.6, 2.4, 2.4, "motor driver"),
    "motor": (17.4, 1.2, 2.2, 1.2, "motor of\nthe ceiling"),
    "motor_supply": (12.2, -4.0, 3.2, 1.2, "motor supply,\nconstant current"),
    "exciter": (17.4, 8.4, 2.2, 1.2, "inverter or\namplifier"),
}
_SIGNAL, _POWER, _USB = "own", "accent", "given_text"
_WIRES: tuple[Wire, ...] = (
    (((1.3, 10.2), (1.3, 9.4)), "24 V, 0 V, to both", _POWER, (1.5, 9.78)),
    (((2.6, 8.8), (6.4, 8.8)), "AIN0, 250 Ω to GND", _SIGNAL, (2.8, 9.0)),
    (((2.6, 6.8), (6.4, 6.8)), "AIN1, 250 Ω to GND", _SIGNAL, (2.8, 7.0)),
    (((2.6, 8.4), (4.6, 8.4), (4.6, 7.8), (6.4, 7.8)), "0 V to GND", _SIGNAL, (4.75, 7.9)),
    (((2.6, 4.8), (6.4, 4.8)), "ai0, microdot–BNC", _SIGNAL, (2.8, 5.0)),
    (((9.0, 7.6), (12.6, 7.6)), "USB", _USB, (10.4, 7.8)),
    (((9.0, 4.8), (13.4, 4.8), (13.4, 6.2)), "USB, chassis", _USB, (9.2, 5.0)),
    (((9.0, 2.6), (11.2, 2.6), (11.2, 5.6), (14.2, 5.6), (14.2, 6.2)), "USB: supplies the board", _USB, (11.3, 3.6)),
    (((2.6, 2.8), (6.4, 2.8)), "A0, 5 V, GND;\n1 MΩ and 100 nF to GND", _SIGNAL, (2.8, 3.0)),
    (((2.6, -0.2), (6.4, -0.2)), "D24 lower, D25 upper,\nD26 stop; to GND", _SIGNAL, (2.8, 0.0)),
    (((9.0, 1.8), (12.6, 1.8)), "D22 enable, 10 kΩ to GND\nD23 direction, GND", _SIGNAL, (9.1, 1.95)),
    (((15.0, 1.8), (17.4, 1.8)), "motor leads", _POWER, (15.2, 2.0)),
    (((13.8, -2.8), (13.8, 0.6)), "safety relay, fuse,\nend switches behind the limits", _POWER, (14.0, -1.6)),
    (((7.7, 9.6), (7.7, 10.8), (16.6, 10.8), (16.6, 9.0), (17.4, 9.0)), "DAC0, amplified to 0–10 V, or DAC0 and DAC1 "
     "to an amplifier: only where the PC commands it", _SIGNAL, (7.9, 10.95)),
    (((18.5, 9.6), (18.5, 10.6)), "mains,\nsafety relay", _POWER, (18.7, 9.9)),
)  # fmt: skip


def _wiring(path: Path) -> Path:
    """Draw the wiring as blocks and wires: signals blue, power orange, USB grey."""
    with drawing(path, 11.5, 8.6) as ax:
        for each in _WIRES:
            wire(ax, *each)
        for one in _BLOCKS.values():
            block(ax, *one)
        legend(ax, -3.6, (0.0, "signals", _SIGNAL), (2.0, "power", _POWER), (3.7, "USB", _USB))
        ax.set(xlim=(-0.8, 20.6), ylim=(-4.4, 11.8))
    return path
