"use strict";
// Forces and slip margin over time, by uPlot. The axis shows the stream's own time, also while looking back.

const SPAN = 10,
  HIGH = 150;
let charts = null;

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
        y: { range: (_, a, b) => [a < 0 ? -roundAbove(-a) : 0, b > 0 ? roundAbove(b) : 1] },
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
  charts.forces.setData(forces, false);
  charts.margins.setData(
    [times, column((f) => margin(f, 0)), column((f) => margin(f, -1)), column((f) => margin(f, 1))],
    false,
  );
  for (const chart of Object.values(charts)) chart.setScale("x", { min: end - SPAN, max: end });
}
