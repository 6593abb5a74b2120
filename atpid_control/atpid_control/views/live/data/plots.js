// SPDX-License-Identifier: Apache-2.0
// The plots, by Plotly. Rows come as [time, value, ...] in seconds and SI units; null: not known.

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ONE = colour("--one"), TWO = colour("--two"), INK = colour("--ink"), GRID = colour("--rule"), SHADE = `${ONE}40`;
const line = (color, dash) => ({ mode: "lines", hoverinfo: "skip", line: { color, width: 2, dash } });
const steps = (color, dash) => ({ ...line(color, dash), line: { color, width: 2, dash, shape: "hv" } });
const bound = (fill) => ({ ...line(SHADE), line: { width: 0 }, fill, fillcolor: SHADE });
const scaled = (value, factor) => (value === null || value === undefined ? null : factor * value);
const column = (rows, place, factor) => rows.map((row) => scaled(row[place], factor));
const LEAST = -100, STEP = 50; // of the efficiency's axis [%]
const DECADES = 5; // of the spectrum's axis
const PERIOD = 25; // least width of a period of the motion [pixels]

class Plot {
  constructor(element, lines, unit, y = {}, shapes = []) {
    const axis = { zeroline: false, automargin: false, gridcolor: GRID };
    this.element = element;
    this.lines = lines;
    this.layout = {
      margin: { l: 52, r: 8, t: 6, b: 36 }, showlegend: false, font: { color: INK }, paper_bgcolor: "transparent", plot_bgcolor: "transparent",
      xaxis: { ...axis, title: { text: unit, standoff: 4 } }, yaxis: { ...axis, ...y }, shapes,
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
    // dashes of a fast trace make a pattern of their own: there width, and what is on top, tells the two apart
    const two = [line(ONE), line(TWO, "dash")], fast = [{ ...line(ONE), zorder: 1, line: { color: ONE, width: 3 } }, { ...line(TWO), line: { color: TWO, width: 1.3 } }];
    this.motion = new Plot(find("motion"), fast, "s");
    this.excitation = new Plot(find("plot-excitation"), [bound(), bound("tonexty"), line(ONE)], "s");
    this.ceiling = new Plot(find("plot-ceiling"), [steps(ONE), steps(TWO, "dash")], "s");
    const worse = { type: "rect", xref: "paper", x0: 0, x1: 1, y0: LEAST, y1: 0, fillcolor: `${colour("--bad")}20`, line: { width: 0 }, layer: "below" };
    this.efficiency = new Plot(find("plot-efficiency"), two, "s", { zeroline: true, zerolinecolor: INK }, [worse]);
    this.spectrum = new Plot(find("plot-spectrum"), fast, "Hz", { type: "log", dtick: 1, tickformat: "~g" });
    this.drive = 1e3; // what is shown of support [m] or force [N] is so many times that
    this.restart();
  }

  restart() {
    this.lowest = 0;
  }

  // The last `longest` seconds up to `end`, or as many periods as can be told apart.
  drawMotion(rows, end, longest, frequency) {
    const width = Math.max(1, this.motion.element.clientWidth - 60);
    const begin = end - (frequency ? Math.min(longest, width / PERIOD / frequency) : longest);
    const shown = rows.filter((row) => row[0] > begin && row[0] <= end);
    const lines = [this.drive, 1e3].map((scale, line) => envelope(shown, line + 1, scale, begin, (end - begin) / width));
    const top = 1.1 * Math.max(...lines.map((each) => largest(each[1])), 1e-3);
    this.motion.draw(lines, { x: [begin, end], y: [-top, top] });
  }

  drawLong(rows) {
    const time = column(rows.excitation, 0, 1);
    const bar = (sign) => rows.excitation.map((r) => (r[1] === null || r[2] === null ? null : this.drive * (r[1] + sign * 2 * r[2])));
    this.excitation.draw([[time, bar(-1)], [time, bar(1)], [time, column(rows.excitation, 1, this.drive)]]);
    const shares = [1, 2].map((place) => column(rows.efficiency, place, 100).map((share) => share && Math.max(share, LEAST)));
    // the axis grows in steps and does not shrink within a run
    this.lowest = shares.flat().reduce((least, share) => Math.min(least, STEP * Math.floor(share / STEP)), this.lowest);
    this.efficiency.draw(shares.map((each) => [column(rows.efficiency, 0, 1), each]), { y: [this.lowest - 5, 105] });
    this.ceiling.draw([rows.ceiling, rows.command].map((each) => [column(each, 0, 1), column(each, 1, 1e3)]));
  }

  // Whole decades, so that the axis does not move with every spectrum.
  drawSpectrum(lines) {
    const values = [[lines.support, this.drive], [lines.beam, 1e3]].map(([each, scale]) => (each ?? []).map((v) => scale * v));
    const top = Math.ceil(Math.log10(Math.max(largest(values.flat()), 1e-6)));
    this.spectrum.draw(values.map((each) => [lines.frequency, each]), { y: [top - DECADES, top] });
  }
}

const largest = (values) => values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);

// Times [s] and values times scale: of the rows in a pixel the least and the largest; a gap remains one.
function envelope(rows, place, scale, begin, pixel) {
  const chosen = [], at = (row) => Math.floor((row[0] - begin) / pixel);
  for (let from = 0, to; from < rows.length; from = to) {
    let low = null, high = null, gap = null;
    for (to = from; to < rows.length && at(rows[to]) === at(rows[from]); to++) {
      const row = rows[to], value = row[place];
      if (value === null) gap = row;
      else {
        if (low === null || value < low[place]) low = row;
        if (high === null || value > high[place]) high = row;
      }
    }
    chosen.push(...[...new Set([low, high, gap])].filter(Boolean).sort((a, b) => a[0] - b[0]));
  }
  return [column(chosen, 0, 1), column(chosen, place, scale)];
}
