# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A dimensioned sketch of the container as SVG: floor, grain, ceiling closed and at its least and largest height."""

from atpid_design.make import Design

#: Width of the drawing and of the part that is to scale, room above and below.
_WIDE, _TALL, _MARGIN = 520.0, 220.0, 34.0


def sketch(made: Design) -> str:
    """Return the drawing; lengths are those of the design in millimetres, widths are free."""
    low, high = made.heights
    diameter = 2.0 * made.radius
    scale = _TALL / high
    left, right, floor = 126.0, 126.0 + max(1.6 * diameter * scale, 60.0), _MARGIN + _TALL
    middle = 0.5 * (left + right)
    heights = (("closed", diameter), ("lowest", low), ("highest", high))
    lines = [
        f'<path d="M{left - 8:.0f} {floor:.1f}H{right + 8:.0f}M{left:.0f} {floor:.1f}V{_MARGIN - 12:.0f}'
        f'M{right:.0f} {floor:.1f}V{_MARGIN - 12:.0f}" class="wall"/>',
        f'<circle cx="{middle:.1f}" cy="{floor - 0.5 * diameter * scale:.1f}" r="{0.5 * diameter * scale:.1f}"/>',
        _text(middle, floor + 24.0, f"floor; grain of {1e3 * diameter:.1f} mm diameter", "middle"),
    ]
    place, last = right + 22.0, floor + 20.0
    for number, (name, height) in enumerate(heights):
        level = floor - height * scale
        at = min(level, last - 20.0)
        last, x = at, place + 16.0 * number
        lines.append(f'<path d="M{left:.0f} {level:.1f}H{right:.0f}" class="ceiling {name}"/>')
        lines.append(f'<path d="M{right:.0f} {level:.1f}H{x + 5:.1f}M{x:.1f} {floor:.1f}V{level:.1f}" class="size"/>')
        lines.append(_text(place + 44.0, at + 6.0, f"{1e3 * height:.1f} mm, {name}", "start"))
    travel = ("travel", f"{1e3 * (high - low):.1f} mm", "from closed", f"{1e3 * (high - diameter):.1f} mm")
    top = floor - 0.5 * (low + high) * scale
    lines += [_text(left - 12.0, top + 21.0 * row, words, "end") for row, words in enumerate(travel)]
    tall, wide = floor + _MARGIN, max(_WIDE, place + 210.0)
    return (
        f'<svg viewBox="0 0 {wide:.0f} {tall:.0f}" role="img" aria-label="The container with its dimensions"'
        ' class="sketch"><style>.sketch{max-width:560px;width:100%;font:18px var(--sans)}.sketch text{fill:var(--ink)}'
        ".sketch path{fill:none;stroke:var(--muted)}.sketch .wall{stroke:var(--ink);stroke-width:2.5}"
        ".sketch .ceiling{stroke:var(--own);stroke-width:3}.sketch .closed{stroke-dasharray:4 4}"
        f".sketch circle{{fill:var(--soft);stroke:var(--own)}}</style>{''.join(lines)}</svg>"
    )


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'
