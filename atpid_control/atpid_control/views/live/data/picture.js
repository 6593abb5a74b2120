// SPDX-License-Identifier: Apache-2.0
// The damper as it moves: support, beam with container, ceiling, and the grain where it is simulated. Metres, up is up.

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 320, HEIGHT = 320, LEFT = 100, RIGHT = 225, MIDDLE = 0.5 * (LEFT + RIGHT);
const UNKNOWN_RADIUS = 0.0085; // of a grain whose scene is not given [m]

function add(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return parent.appendChild(made);
}

export class Picture {
  constructor(svg) {
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    const line = { stroke: "currentColor", "stroke-width": 3, fill: "none" };
    this.support = add(svg, "line", { ...line, stroke: "var(--one)", "stroke-width": 7, x1: LEFT - 30, x2: RIGHT + 30 });
    this.spring = add(svg, "polyline", { ...line, "stroke-width": 2 });
    this.walls = add(svg, "path", { ...line, "stroke-width": 2, "stroke-dasharray": "2 4" });
    this.floor = add(svg, "line", { ...line, stroke: "var(--two)", "stroke-width": 9, x1: LEFT, x2: RIGHT });
    this.target = add(svg, "line", { ...line, "stroke-width": 2, "stroke-dasharray": "8 6", x1: LEFT - 20, x2: RIGHT + 20 });
    this.ceiling = add(svg, "line", { ...line, "stroke-width": 7, x1: LEFT, x2: RIGHT });
    this.grain = add(svg, "circle", { cx: MIDDLE, fill: "var(--good)" });
    this.scale = add(svg, "line", { ...line, x1: 24, x2: 24 });
    this.scaleText = add(svg, "text", { x: 32, "font-size": 13, fill: "currentColor" });
    for (const [place, text] of [["floor", "beam"], ["ceiling", "ceiling"], ["support", "support"]]) {
      this[`${place}Text`] = add(svg, "text", { x: RIGHT + 38, "font-size": 13, fill: "currentColor" }, text);
    }
  }

  // place: support, beam, grain, ceiling and commanded height [m]; null: not known. radius: of the grain [m].
  draw(place, radius) {
    const beam = place.beam ?? 0, support = place.support ?? 0, height = place.ceiling;
    const size = 2 * (radius ?? UNKNOWN_RADIUS), room = Math.max(height ?? 0, place.commanded ?? 0, size);
    const top = beam + (height ?? room);
    this.fit(Math.min(beam, 0), Math.max(beam + room, (place.grain ?? 0) + size));
    const span = this.high - this.low, below = 0.22 * span; // drawn under the beam, where it is in truth is not measured
    const y = (metres) => 300 - (280 * (metres - this.low + below)) / (span + below);
    const level = (element, metres, text, offset = 0) => {
      element.style.display = metres === null ? "none" : "";
      if (metres === null) return;
      element.setAttribute("y1", y(metres) + offset);
      element.setAttribute("y2", y(metres) + offset);
      if (text) text.setAttribute("y", y(metres) + offset + 4);
    };
    const base = support + this.low - 0.75 * below;
    level(this.support, base, this.supportText);
    level(this.floor, beam, this.floorText, 4);
    level(this.ceiling, height === null ? null : top, this.ceilingText, -3);
    this.ceilingText.style.display = this.ceiling.style.display;
    level(this.target, place.commanded === null ? null : beam + place.commanded, null, -3);
    const from = y(base), to = y(beam) + 8, points = [];
    for (let k = 0; k <= 12; k++) points.push(`${MIDDLE + (k % 12 ? (k % 2 ? 12 : -12) : 0)},${from + ((to - from) * k) / 12}`);
    this.spring.setAttribute("points", points.join(" "));
    this.walls.setAttribute("d", `M${LEFT} ${y(beam)}V${y(top)}M${RIGHT} ${y(beam)}V${y(top)}`);
    this.grain.style.display = place.grain === null ? "none" : "";
    if (place.grain !== null) {
      this.grain.setAttribute("r", Math.max(4, (140 * size) / (span + below)));
      this.grain.setAttribute("cy", y(place.grain + 0.5 * size));
    }
    const unit = round(Math.min(Math.max((height ?? 0) - size, 0.06 * span), 0.4 * span));
    this.scale.setAttribute("y1", y(0));
    this.scale.setAttribute("y2", y(unit));
    this.scaleText.setAttribute("y", 0.5 * (y(0) + y(unit)) + 4);
    this.scaleText.textContent = `${Number((1e3 * unit).toPrecision(1))} mm`;
  }

  // The scale grows at once and shrinks slowly, so that it does not follow every swing.
  fit(low, high) {
    this.low ??= low;
    this.high ??= high * 1.05;
    this.low = low < this.low ? low : this.low + 0.002 * (low - this.low);
    this.high = high > this.high ? high * 1.05 : this.high + 0.002 * (high - this.high);
  }
}

// The largest of 1, 2 and 5 times a power of ten up to a length.
function round(length) {
  const decade = 10 ** Math.floor(Math.log10(length));
  return decade * [5, 2, 1].find((each) => each * decade <= 1.000001 * length);
}
