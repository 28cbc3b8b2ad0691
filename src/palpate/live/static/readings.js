"use strict";
// The readings as they came, each where its taxel lies: one small map for each channel, coloured by the change since the zero.

const GAP = 22; // above each map, for its name and scale
let largest = [], // of each channel, so far: colours that change with every frame tell nothing
  places = []; // where each channel's map lies on the canvas

function forgetReadings() {
  largest = [];
}

/** Channels of all planes, one after another, with where their readings begin. */
function channels(layout) {
  const out = [];
  let from = 0;
  for (const plane of layout.planes)
    plane.channels.forEach((name, c) => {
      out.push({ plane, name, unit: plane.units[c], from });
      from += plane.names.length;
    });
  return out;
}

function extent(plane) {
  const [w, h] = plane.size;
  let x0 = Infinity,
    x1 = -Infinity,
    y0 = Infinity,
    y1 = -Infinity;
  for (let i = 0; i < plane.names.length; i++) {
    x0 = Math.min(x0, plane.x[i] - w / 2);
    x1 = Math.max(x1, plane.x[i] + w / 2);
    y0 = Math.min(y0, plane.y[i] - h / 2);
    y1 = Math.max(y1, plane.y[i] + h / 2);
  }
  return { x0, x1, y0, y1 };
}

function sizeReadings(layout) {
  const c = document.getElementById("readings"),
    ratio = devicePixelRatio || 1,
    hint = document.getElementById("readings-hint");
  c.hidden = layout.readings === 0;
  if (c.hidden) {
    hint.textContent = "More readings than a page shows one by one.";
    return;
  }
  const wide = c.clientWidth,
    each = channels(layout);
  let top = 0;
  places = each.map(({ plane }) => {
    const e = extent(plane),
      across = e.x1 - e.x0,
      line = layout.shape[0] === 1,
      high = line ? 34 : Math.min((wide * (e.y1 - e.y0)) / across, 1.1 * wide),
      used = line ? wide : (high * across) / (e.y1 - e.y0),
      place = { e, line, x: 0, y: (top + GAP) * ratio, w: used * ratio, h: high * ratio };
    top += GAP + high + 8;
    return place;
  });
  c.style.height = `${top}px`;
  c.width = Math.round(wide * ratio);
  c.height = Math.round(top * ratio);
}

/** A number of few digits, without an exponent where it can be. */
function short(v) {
  const a = Math.abs(v);
  if (a >= 1e9 || (a > 0 && a < 1e-3)) return v.toExponential(1);
  if (a >= 1e5) return `${Number((v / (a >= 1e6 ? 1e6 : 1e3)).toPrecision(3))}${a >= 1e6 ? "M" : "k"}`;
  return a >= 1e3 ? String(Math.round(v)) : String(Number(v.toPrecision(3)));
}

function paintReadings(layout, frame, theme, colour) {
  if (!layout.readings || !frame.raw) return;
  const c = document.getElementById("readings"),
    x = c.getContext("2d"),
    r = devicePixelRatio || 1,
    back = theme === "dark" ? [29, 29, 27] : [255, 255, 255],
    up = theme === "dark" ? [240, 163, 92] : [179, 89, 10],
    down = theme === "dark" ? [127, 180, 245] : [26, 95, 180];
  x.clearRect(0, 0, c.width, c.height);
  channels(layout).forEach(({ plane, name, unit: u, from }, k) => {
    const at = places[k],
      n = plane.names.length;
    let most = 0;
    for (let i = 0; i < n; i++) {
      const v = Math.abs(frame.change[from + i]);
      if (v > most) most = v;
    }
    largest[k] = Math.max(most, (largest[k] || 0) * 0.995, 1e-30);
    x.fillStyle = colour("--soft");
    x.font = `${11 * r}px system-ui,sans-serif`;
    x.textAlign = "left";
    x.textBaseline = "bottom";
    x.fillText(`${name}  ±${unit(largest[k], u === "1" ? "" : u, 2)}`, at.x, at.y - 4 * r);
    const sx = at.w / (at.e.x1 - at.e.x0),
      w = plane.size[0] * sx,
      h = at.line ? at.h : plane.size[1] * sx;
    // one size for all, in which the widest has room
    const texts = Array.from(frame.raw.subarray(from, from + n), (v) => (Number.isNaN(v) ? "–" : short(v)));
    x.font = `${11 * r}px system-ui,sans-serif`;
    const widest = Math.max(1, ...texts.map((text) => x.measureText(text).width)),
      small = Math.min(11, (11 * 0.92 * w) / widest, (0.8 * h) / r);
    for (let i = 0; i < n; i++) {
      const cx = at.x + (plane.x[i] - at.e.x0) * sx,
        cy = at.line ? at.y + at.h / 2 : at.y + at.h - (plane.y[i] - at.e.y0) * sx,
        v = frame.change[from + i],
        f = Math.min(1, Math.abs(v) / largest[k]),
        tint = v < 0 ? down : up,
        rgb = back.map((b, j) => Math.round(b + f * (tint[j] - b)));
      x.fillStyle = Number.isNaN(v) ? "rgb(128,128,128)" : `rgb(${rgb.join(",")})`;
      x.strokeStyle = colour(plane.works[i] ? "--line" : "--alarm");
      x.lineWidth = r;
      x.beginPath();
      if (plane.round && !at.line) x.ellipse(cx, cy, w / 2, h / 2, 0, 0, 2 * Math.PI);
      else x.rect(cx - w / 2, cy - h / 2, w, h);
      x.fill();
      x.stroke();
      if (small < 6.5) continue;
      x.font = `${small * r}px system-ui,sans-serif`;
      x.fillStyle = f > 0.6 && !Number.isNaN(v) ? (theme === "dark" ? "#111" : "#fff") : colour("--fore");
      x.textAlign = "center";
      x.textBaseline = "middle";
      x.fillText(texts[i], cx, cy);
    }
  });
}
