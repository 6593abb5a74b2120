# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the drawings of the mechanism in SVG: container with grain, ceiling and motor; the labelled drawing."""

from xml.sax.saxutils import escape

#: Scale [px/mm]; width of the container and of its motor, and height of the walls above the floor [px].
PIXELS, _WIDE, _MOTOR, _WALLS = 1.1, 50, 26, 140


def text(x: float, y: float, words: str, kind: str) -> str:
    """Return words at a place; kind: classes of the style."""
    return f'<text x="{x:g}" y="{y:g}" class="{kind}">{escape(words)}</text>'


def container(height: float, radius: float, moves: str, scale: float = 1.0) -> str:
    """Return a container that stands on (0, 0): floor, walls, ceiling at `height` [m], grain of `radius` [m], motor.

    moves: class of the grain, which lifts it from the floor; scale: of this drawing over that of the animation.
    """
    size = PIXELS * scale
    wide, walls, motor = _WIDE * scale, _WALLS * scale, _MOTOR * scale
    ceiling, r, half, plate = -1e3 * height * size, 1e3 * radius * size, 0.5 * _WIDE * scale, 6.0 * scale
    foot = -3.0 * scale  # the floor's upper side
    top = -walls - 0.7 * motor
    return (
        f'<g transform="translate(0 {foot:g})">'
        f'<rect x="{-half:g}" y="{-walls:g}" width="{wide:g}" height="{walls:g}" class="inside"/>'
        f'<path d="M{-half:g} 0V{-walls:g}H{half:g}V0" class="wall"/>'
        f'<rect x="{-half - 4:g}" y="0" width="{wide + 8:g}" height="{plate:g}" class="floor"/>'
        f'<path d="M0 {ceiling - plate:.1f}V{-walls:g}" class="screw"/>'
        f'<rect x="{-half + 2:g}" y="{ceiling - plate:.1f}" width="{wide - 4:g}" height="{plate:g}" class="plate"/>'
        f'<rect x="{-0.5 * motor:g}" y="{top:g}" width="{motor:g}" height="{0.7 * motor:g}" rx="3" class="motor"/>'
        f'<g class="{moves}"><circle cy="{-r:.1f}" r="{r:.1f}" class="grain"/></g></g>'
    )


def legend(x: float, y: float) -> str:
    """Return the meaning of the colours in one line."""
    return (
        f'<g transform="translate({x:g} {y:g})"><circle cx="6" cy="-5" r="6" class="grain"/>'
        f'{text(20, 0, "loose grain", "small")}<rect x="130" y="-8" width="22" height="6" class="plate"/>'
        f'{text(160, 0, "ceiling, moved by a motor", "small")}<path d="M380 -5h28" class="bare"/>'
        f"{text(416, 0, 'how far the beam swings without the damper', 'small')}</g>"
    )


def labelled(height: float, radius: float, support: float, fraction: float) -> str:
    """Return the drawing with names and dimensions; lengths in metres."""
    scale, x, y = 2.0, 460.0, 350.0
    size, foot = PIXELS * scale, y - 3.0 * scale
    d, h = 2e3 * radius, 1e3 * height
    side = x + 0.5 * _WIDE * scale + 60.0
    half, ceiling, walls = 0.5 * _WIDE * scale, foot - h * size, foot - _WALLS * scale

    def leader(x0: float, y0: float, x1: float, y1: float, name: str, more: str) -> str:
        return (
            f'<path d="M{x0:g} {y0:g}L{x1:g} {y1:g}" class="size"/>{text(x1 + 6, y1 + 1, name, "head")}'
            f"{text(x1 + 6, y1 + 19, more, 'small')}"
        )

    def measure(at: float, low: float, high: float, words: str) -> str:
        ends = ((low, low - 7.0), (high, high + 7.0))
        tips = "".join(f"M{at - 4:g} {back:.1f}L{at:g} {end:.1f}L{at + 4:g} {back:.1f}z" for end, back in ends)
        lines = "".join(f"M{x - half + 4:g} {one:.1f}H{at - 5:g}" for one in (low, high))
        return f'<path d="{lines}M{at:g} {low:.1f}V{high:.1f}" class="size"/><path d="{tips}" class="tip"/>' + text(
            at - 9, 0.5 * (low + high) + 5, words, "end"
        )

    return "".join([
        f'<rect x="40" y="{y - 60:g}" width="22" height="120" class="clamp"/>',
        f'<path d="M62 {y:g}H{x + half + 20:g}" class="beam"/>',
        f'<path d="M26 {y - 24:g}V{y + 24:g}" class="size"/><path d="M22 {y - 18:g}L26 {y - 28:g}L30 {y - 18:g}z'
        f'M22 {y + 18:g}L26 {y + 28:g}L30 {y + 18:g}z" class="tip"/>',
        text(72, y + 48, f"support: shakes the beam, here by ±{1e3 * support:g} mm", "small"),
        text(250, y + 26, "beam: the structure to be damped", "small"),
        f'<g transform="translate({x:g} {y:g})">{container(height, radius, "", scale)}</g>',
        measure(x - half - 26, foot, foot - d * size, f"grain 2r = {d:.1f} mm"),
        measure(x - half - 26, foot - d * size, ceiling, f"clearance h − 2r = {h - d:.1f} mm"),
        measure(x - half - 246, foot, ceiling, f"height h = {h:.1f} mm"),
        leader(x + 13 * scale, walls - 8 * scale, side, walls - 20, "motor", "sets the ceiling's height by a screw"),
        leader(x + half - 10, ceiling - 8, side, ceiling - 40, "ceiling", "the grain strikes it while it falls"),
        leader(x + 0.8e3 * radius * size, foot - d * size * 0.6, side, foot - d * size * 0.75, "grain",
               f"loose, one ball, {100 * fraction:g} % of the moving mass"),
        leader(x + half + 6, foot + 6, side, y + 14, "floor", "the grain strikes it while it rises"),
    ])  # fmt: skip
