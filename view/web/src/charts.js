// Time series charts: data and style; drawn by uPlot.
import uPlot from "uplot";
import { RESIDUAL_GAP_S, trailOf, withGaps } from "./gaps.js";
import { colour } from "./theme.js";

// Legible on both themes.
const HUES = ["#3b82f6", "#d9463f", "#1f9d6b", "#d07a00", "#8b74e8", "#0e8fa3", "#c2579f", "#7c8c1a"];
const grid = { stroke: () => colour("grid"), width: 1 };
const noPoints = { points: { show: false } };
const axis = (more = {}) => ({ grid, ticks: grid, stroke: () => colour("soft"), font: "11px system-ui, 'DejaVu Sans', sans-serif", ...more });
const SHOWN_MIN_S = 5;
// Time axis: seconds before now, which is at the right edge.
const ago = (u, splits) => splits.map((at) => `${Number(at.toFixed(1))} s`);

class Chart {
  constructor(element, options, data) {
    this.element = element;
    const size = () => ({ width: Math.max(200, element.clientWidth), height: Math.max(180, element.clientHeight - (options.legend?.show === false ? 0 : 32)) });
    this.plot = new uPlot({
      ...size(), cursor: { drag: { x: false, y: false } }, axes: [axis({ values: ago }), axis({ size: 46 })],
      ...options, scales: { x: { time: false, range: (u, low, high) => [Math.min(low ?? 0, (high ?? 0) - SHOWN_MIN_S), high ?? 0] }, ...options.scales },
    }, data, element);
    new ResizeObserver(() => {
      const { width } = size();
      if (Math.abs(width - this.plot.width) > 1) this.plot.setSize({ ...size(), height: this.plot.height });
    }).observe(element);
  }

  // The first column is time, s. A single point is not drawn: it gives no axis range. Gaps longer than `gapAfter` seconds
  // interrupt the curves.
  show([times, ...columns], gapAfter) {
    const data = times.length > 1 ? [times.map((at) => at - times.at(-1)), ...columns] : [[], ...columns.map(() => [])];
    this.plot.setData(withGaps(data, gapAfter));
    // For tests of the page.
    this.element.dataset.points = String(data[0].length);
    this.element.dataset.curves = String(columns.length);
  }
}

// Residual (measured minus estimated CoP) of the last 30 s, with ± 2σ of measurement and estimate.
export class ResidualChart extends Chart {
  // `rows` are those of an earlier chart, in other colours or words.
  constructor(element, words, rows = []) {
    const line = (label, stroke) => ({ label, stroke, width: 1.8, spanGaps: false, ...noPoints, value: (u, v) => (v == null ? "–" : v.toFixed(1)) });
    const edge = (label) => ({ label, stroke: "transparent", ...noPoints });
    super(element, {
      series: [{ label: "t", value: () => "" }, line(words.forward, HUES[0]), line(words.left, HUES[3]), edge(words.noise), edge("\u00a0")],
      bands: [{ series: [3, 4], fill: "#3b82f62b" }],
      scales: { y: { range: (u, low, high) => [Math.min(-15, low ?? 0), Math.max(15, high ?? 0)] } },
      legend: { show: true, live: false, markers: { fill: (u, i) => (i === 3 ? "#3b82f640" : null) } },
    }, [[], [], [], [], []]);
    this.rows = rows;
    this.changed = rows.length > 0;
  }

  add({ t, cop_measured: a, cop_estimated: b, cop_sigma: s, cop_measured_sigma: m = [0, 0] }) {
    const last = this.rows.at(-1);
    // At most 10 points/s. Time runs backwards after a restart of the daemon: clear.
    if (last && t - last[0] < 0.1 && t >= last[0]) return;
    if (last && t < last[0]) this.rows = [];
    const both = a && b;
    const band = both && s ? 2000 * Math.max(...[0, 1].map((i) => Math.hypot(s[i], m[i]))) : null;
    const row = [t, both ? 1000 * (a[0] - b[0]) : null, both ? 1000 * (a[1] - b[1]) : null, band, band === null ? null : -band];
    this.rows.push(Object.assign(row, { cop: a }));
    while (this.rows[0][0] < t - 30) this.rows.shift();
    this.changed = true;
  }

  get trail() {
    return trailOf(this.rows);
  }

  paint() {
    if (!this.changed) return;
    this.changed = false;
    this.show([0, 1, 2, 3, 4].map((i) => this.rows.map((row) => row[i])), RESIDUAL_GAP_S);
  }
}

// √ of the largest P_jj, predicted σ of the CoP and its target, mm, on a logarithmic axis.
export class ConvergenceChart extends Chart {
  constructor(element, words) {
    const line = (label, stroke, more = {}) => ({ label, stroke, width: 2, ...noPoints, ...more });
    super(element, {
      series: [{ label: "t" }, line(words.variance, HUES[4]), line(words.cop_sigma, HUES[0]), line(words.target, () => colour("soft"), { dash: [6, 5], width: 1.2 })],
      scales: { y: { distr: 3 } }, axes: [axis({ values: ago }), axis({ size: 46, values: (u, splits) => splits.map((v) => (v == null ? "" : String(v))) })],
      legend: { show: true, live: false },
    }, [[], [], [], []]);
  }

  paint({ t, variance_max_m2: variance, predicted_cop_sigma_m: sigma }, targetM) {
    this.show([t, variance.map((v) => (v ? 1000 * Math.sqrt(v) : null)), sigma.map((v) => (v ? 1000 * v : null)),
      t.map(() => (targetM ? 1000 * targetM : null))], 2);
  }
}

// All parameters of the filter, mm.
export class PhiChart {
  constructor(element) {
    this.element = element;
    this.names = "";
  }

  paint(parameters) {
    if (!parameters.length) return;
    const { names } = parameters[0];
    if (this.names !== names.join()) {
      this.names = names.join();
      this.element.replaceChildren();
      const series = names.map((label, i) => ({ label, stroke: HUES[i % HUES.length], width: 1.5, dash: i >= HUES.length ? [6, 3] : [], ...noPoints }));
      this.chart = new Chart(this.element, { series: [{ label: "t" }, ...series], legend: { show: false } }, [[], ...names.map(() => [])]);
    }
    this.chart.show([parameters.map(({ t }) => t),
      ...names.map((_, i) => parameters.map(({ theta_m: theta }) => 1000 * theta[i]))], 5);
  }
}

