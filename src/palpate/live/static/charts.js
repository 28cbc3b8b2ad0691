"use strict";
// Forces and friction left over time, by uPlot. The axis shows the stream's own time, also while looking back.

const SPAN = 10,
  HIGH = 150;
let charts = null,
  forceAxis = [0, 1];

/**
 * An axis that shows all values and the intervals as they mostly are, and whether some interval does not fit: a frame that is hardly known has one
 * hundreds of times as wide as the values. Columns come as value, low, high.
 */
function axisOf(columns) {
  const there = (v) => v !== null && v !== undefined && Number.isFinite(v);
  let low = 0,
    high = 0;
  const halves = [];
  for (const [values, below, above] of columns)
    for (let i = 0; i < values.length; i++) {
      if (!there(values[i])) continue;
      low = Math.min(low, values[i]);
      high = Math.max(high, values[i]);
      if (there(below[i]) && there(above[i])) halves.push(Math.max(values[i] - below[i], above[i] - values[i]));
    }
  halves.sort((a, b) => a - b);
  const usual = halves.length ? halves[Math.min(halves.length - 1, Math.floor(0.9 * halves.length))] : 0,
    widest = Math.max(3 * usual, 0.25 * (high - low));
  let least = low,
    most = high,
    cut = false;
  for (const [values, below, above] of columns)
    for (let i = 0; i < values.length; i++)
      if (there(values[i]) && there(below[i]) && there(above[i])) {
        least = Math.min(least, Math.max(below[i], values[i] - widest));
        most = Math.max(most, Math.min(above[i], values[i] + widest));
      }
  const ends = [least < 0 ? -roundAbove(-least) : 0, most > 0 ? roundAbove(most) : least < 0 ? 0 : 1];
  for (const [, below, above] of columns)
    for (let i = 0; i < below.length; i++)
      if ((there(below[i]) && below[i] < ends[0]) || (there(above[i]) && above[i] > ends[1])) cut = true;
  return { ends, cut };
}

function axes(colour, label) {
  const plain = {
    stroke: () => colour("--soft"),
    grid: { stroke: () => colour("--line"), width: 1 },
    ticks: { stroke: () => colour("--line"), width: 1, size: 4 },
    font: "11px system-ui,sans-serif",
    labelFont: "11px system-ui,sans-serif",
    labelSize: 14,
    labelGap: 0,
  };
  return [
    { ...plain, label: "time [s]", size: 26, space: 60 },
    { ...plain, label, size: 44, space: 28 },
  ];
}
function line(colour, name) {
  return { stroke: () => colour(name), width: 1.8, points: { show: false } };
}
// before the first frame: an axis without a line
const during = (_, a, b) => (a === null || a === undefined ? [0, SPAN] : [a, b]);
const EDGE = { stroke: "transparent", width: 0, points: { show: false } };

function makeCharts(layout, colour) {
  if (charts) for (const chart of Object.values(charts)) chart.destroy();
  const wide = (id) => document.getElementById(id).clientWidth;
  const common = { height: HIGH, legend: { show: false }, cursor: { show: false }, padding: [8, 8, 0, 0] };
  const fill = (name) => `${colour(name)}38`; // the hex digits of a third of a quarter: 22 %
  const forces = new uPlot(
    {
      ...common,
      width: wide("forces"),
      axes: axes(colour, layout.unit),
      scales: {
        x: { time: false, range: during },
        y: { range: () => forceAxis },
      },
      series: [{}, line(colour, "--normal"), EDGE, EDGE, line(colour, "--shear"), EDGE, EDGE],
      bands: [
        { series: [3, 2], fill: fill("--normal") },
        { series: [6, 5], fill: fill("--shear") },
      ],
    },
    [[], [], [], [], [], [], []],
    document.getElementById("forces"),
  );
  const margins = new uPlot(
    {
      ...common,
      width: wide("margins"),
      axes: axes(colour, "1 − Q/(µP)"),
      scales: { x: { time: false, range: during }, y: { range: () => [0, 1] } },
      series: [{}, line(colour, "--good"), EDGE, EDGE],
      bands: [{ series: [3, 2], fill: fill("--good") }],
    },
    [[], [], [], []],
    document.getElementById("margins"),
  );
  charts = { forces, margins };
}

function sizeCharts() {
  for (const [id, chart] of Object.entries(charts || {}))
    chart.setSize({ width: document.getElementById(id).clientWidth, height: HIGH });
}

/** Draw what came up to the frame that is shown; its time is the right edge. */
function paintCharts(trail, shown) {
  const end = shown.time,
    some = trail.filter((f) => f.time !== null && f.time <= end && f.time > end - SPAN),
    last = shown.force.length - 1;
  const column = (of) =>
    some.map((f) => {
      const v = of(f);
      return v === undefined ? null : v;
    });
  const known = (f) => f.touching && f.force_low;
  const times = column((f) => f.time);
  // where frames are missing nothing is known between: a gap
  const forces = [
    times,
    column((f) => f.force[last]),
    column((f) => (known(f) ? f.force_low[last] : null)),
    column((f) => (known(f) ? f.force_high[last] : null)),
    column(shearOf),
    column((f) => (f.touching ? shearRange(f)[0] : null)),
    column((f) => (f.touching ? shearRange(f)[1] : null)),
  ];
  const margin = (f, times) =>
    f.utilisation === null || f.utilisation === undefined
      ? null
      : Math.max(0, Math.min(1, 1 - f.utilisation + times * 2 * f.utilisation_std));
  const axis = axisOf([forces.slice(1, 4), forces.slice(4, 7)]);
  forceAxis = axis.ends;
  document.getElementById("cut").hidden = !axis.cut;
  charts.forces.setData(forces, false);
  charts.margins.setData(
    [times, column((f) => margin(f, 0)), column((f) => margin(f, -1)), column((f) => margin(f, 1))],
    false,
  );
  for (const chart of Object.values(charts)) chart.setScale("x", { min: end - SPAN, max: end });
}
