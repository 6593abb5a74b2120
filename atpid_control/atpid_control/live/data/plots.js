// SPDX-License-Identifier: Apache-2.0
// The plots, by uPlot. Rows come as [time, value, ...] in seconds and SI units; null: not known.

const ONE = "#0b5394", TWO = "#a83200";
const line = (colour, dash) => ({ stroke: colour, width: 2, dash, points: { show: false }, spanGaps: false });

function plot(element, series, bands, unit) {
  const options = {
    width: element.clientWidth, height: element.clientHeight, legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false } }, series: [{}, ...series], bands,
    axes: [{ label: unit, labelSize: 18, size: 34 }, { size: 52 }],
  };
  const made = new uPlot(options, [[], ...series.map(() => [])], element);
  new ResizeObserver(() => made.setSize({ width: element.clientWidth, height: element.clientHeight })).observe(element);
  return made;
}

const scaled = (value, factor) => (value === null || value === undefined ? null : factor * value);

export class Plots {
  constructor(find) {
    const two = [line(ONE), line(TWO, [6, 4])];
    const shade = { stroke: "transparent", points: { show: false } };
    this.motion = plot(find("motion"), two, [], "s");
    this.excitation = plot(find("plot-excitation"), [line(ONE), shade, shade], [{ series: [2, 3], fill: "#0b539440" }], "s");
    this.ceiling = plot(find("plot-ceiling"), two, [], "s");
    this.efficiency = plot(find("plot-efficiency"), [line(ONE)], [], "s");
    this.spectrum = plot(find("plot-spectrum"), two, [], "Hz");
  }

  // The last `span` seconds up to `end`.
  drawMotion(rows, end, span) {
    const shown = rows.filter((row) => row[0] > end - span && row[0] <= end);
    this.motion.setData([shown.map((r) => r[0]), shown.map((r) => scaled(r[1], 1e3)), shown.map((r) => scaled(r[2], 1e3))], false);
    this.motion.batch(() => {
      this.motion.setScale("x", { min: end - span, max: end });
      this.motion.setScale("y", limits(shown, 1e3));
    });
  }

  drawLong(rows) {
    const at = (found, column, factor) => found.map((row) => scaled(row[column], factor));
    const bar = (sign) => rows.excitation.map((r) => (r[1] === null || r[2] === null ? null : 1e3 * (r[1] + sign * 2 * r[2])));
    this.excitation.setData([at(rows.excitation, 0, 1), at(rows.excitation, 1, 1e3), bar(1), bar(-1)]);
    this.efficiency.setData([at(rows.efficiency, 0, 1), at(rows.efficiency, 1, 100)]);
    const moved = [at(rows.ceiling, 0, 1), at(rows.ceiling, 1, 1e3)], sent = [at(rows.command, 0, 1), at(rows.command, 1, 1e3)];
    if (moved[0].length || sent[0].length) this.ceiling.setData(joined(moved, sent));
  }

  drawSpectrum(lines) {
    const none = lines.frequency.map(() => null);
    this.spectrum.setData([lines.frequency, lines.support?.map((v) => 1e3 * v) ?? none, lines.beam?.map((v) => 1e3 * v) ?? none]);
  }
}

function limits(rows, factor) {
  const values = rows.flatMap((row) => row.slice(1)).filter((value) => value !== null);
  const largest = values.length ? factor * Math.max(...values.map(Math.abs)) : 1;
  return { min: -1.1 * Math.max(largest, 1e-3), max: 1.1 * Math.max(largest, 1e-3) };
}

// Both heights over one time; each is held from its own sample to its next.
function joined(moved, sent) {
  const times = [...new Set([...moved[0], ...sent[0]])].sort((a, b) => a - b);
  const held = ([at, values]) => {
    let k = -1;
    return times.map((time) => {
      while (k + 1 < at.length && at[k + 1] <= time) k++;
      return k < 0 ? null : values[k];
    });
  };
  return [times, held(moved), held(sent)];
}
