// SPDX-License-Identifier: Apache-2.0
// The plots, by Plotly. Rows come as [time, value, ...] in seconds and SI units; null: not known.

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ONE = colour("--one"), TWO = colour("--two"), INK = colour("--ink"), GRID = colour("--rule"), SHADE = `${ONE}40`;
const line = (color, dash) => ({ mode: "lines", hoverinfo: "skip", line: { color, width: 2, dash } });
const steps = (color, dash) => ({ ...line(color, dash), line: { color, width: 2, dash, shape: "hv" } });
const bound = (fill) => ({ ...line(SHADE), line: { width: 0 }, fill, fillcolor: SHADE });
const scaled = (value, factor) => (value === null || value === undefined ? null : factor * value);
const column = (rows, place, factor) => rows.map((row) => scaled(row[place], factor));

class Plot {
  constructor(element, lines, unit) {
    const axis = { zeroline: false, automargin: false, gridcolor: GRID };
    this.element = element;
    this.lines = lines;
    this.layout = {
      margin: { l: 52, r: 8, t: 6, b: 36 }, showlegend: false, font: { color: INK }, paper_bgcolor: "transparent", plot_bgcolor: "transparent",
      xaxis: { ...axis, title: { text: unit, standoff: 4 } }, yaxis: axis,
    };
    this.draw(lines.map(() => [[], []]));
    new ResizeObserver(() => Plotly.Plots.resize(element)).observe(element);
  }

  // series: [abscissas, ordinates] of each line; ranges: of the axes, by default as wide as the series.
  draw(series, ranges = {}) {
    const data = this.lines.map((style, place) => ({ ...style, x: series[place][0], y: series[place][1] }));
    const { xaxis, yaxis } = this.layout;
    const layout = { ...this.layout, xaxis: { ...xaxis, range: ranges.x }, yaxis: { ...yaxis, range: ranges.y } };
    Plotly.react(this.element, data, layout, { staticPlot: true });
  }
}

export class Plots {
  constructor(find) {
    const two = [line(ONE), line(TWO, "dash")];
    this.motion = new Plot(find("motion"), two, "s");
    this.excitation = new Plot(find("plot-excitation"), [bound(), bound("tonexty"), line(ONE)], "s");
    this.ceiling = new Plot(find("plot-ceiling"), [steps(ONE), steps(TWO, "dash")], "s");
    this.efficiency = new Plot(find("plot-efficiency"), [line(ONE)], "s");
    this.spectrum = new Plot(find("plot-spectrum"), two, "Hz");
  }

  // The last `span` seconds up to `end`.
  drawMotion(rows, end, span) {
    const shown = rows.filter((row) => row[0] > end - span && row[0] <= end), time = column(shown, 0, 1);
    const values = [column(shown, 1, 1e3), column(shown, 2, 1e3)], top = 1.1 * Math.max(largest(values.flat()), 1e-3);
    this.motion.draw(values.map((each) => [time, each]), { x: [end - span, end], y: [-top, top] });
  }

  drawLong(rows) {
    const time = column(rows.excitation, 0, 1);
    const bar = (sign) => rows.excitation.map((r) => (r[1] === null || r[2] === null ? null : 1e3 * (r[1] + sign * 2 * r[2])));
    this.excitation.draw([[time, bar(-1)], [time, bar(1)], [time, column(rows.excitation, 1, 1e3)]]);
    const efficiency = column(rows.efficiency, 1, 100);
    const lowest = efficiency.reduce((least, value) => Math.min(least, value ?? 0), 0);
    this.efficiency.draw([[column(rows.efficiency, 0, 1), efficiency]], { y: [Math.max(lowest, -100) - 5, 105] });
    this.ceiling.draw([rows.ceiling, rows.command].map((each) => [column(each, 0, 1), column(each, 1, 1e3)]));
  }

  drawSpectrum(lines) {
    this.spectrum.draw([lines.support, lines.beam].map((each) => [lines.frequency, (each ?? []).map((v) => 1e3 * v)]));
  }
}

function largest(values) {
  return values.reduce((most, value) => (value === null ? most : Math.max(most, Math.abs(value))), 0);
}
