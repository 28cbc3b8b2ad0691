"use strict";
// The map: pressure as colour, shear as arrows, axes in millimetres, a scale bar and a key for the arrows.

// perceptually even from background to strong: light and dark ends follow the theme
const RAMP = {
  light: [
    [247, 247, 243],
    [190, 217, 214],
    [98, 178, 187],
    [33, 124, 158],
    [33, 68, 122],
    [36, 18, 77],
  ],
  dark: [
    [24, 24, 24],
    [36, 42, 92],
    [30, 95, 140],
    [44, 150, 150],
    [138, 200, 120],
    [248, 236, 140],
  ],
};
const LEFT = 44,
  BOTTOM = 34,
  TOP = 6,
  RIGHT = 10;
const cells = document.createElement("canvas");
let box = null; // where the surface lies on the canvas [px]

function ramp(theme, v) {
  const r = RAMP[theme],
    t = Math.max(0, Math.min(1, v)) * (r.length - 1),
    i = Math.min(r.length - 2, Math.floor(t)),
    f = t - i;
  return [0, 1, 2].map((k) => r[i][k] + f * (r[i + 1][k] - r[i][k]));
}

/** The largest of 1, 2, 5, 10, 20 ... that is not above v. */
function roundBelow(v) {
  const p = 10 ** Math.floor(Math.log10(v));
  return p * [5, 2, 1].find((k) => k * p <= v * (1 + 1e-9));
}
function roundAbove(v) {
  const p = 10 ** Math.floor(Math.log10(v));
  return p * [1, 2, 5, 10].find((k) => k * p >= v * (1 - 1e-9));
}

/** Sizes of the surface [m]: its edges, one cell wide where it is a line. */
function edges(layout) {
  const dx = layout.spacing[layout.spacing.length - 1],
    dy = layout.spacing[0],
    line = layout.shape[0] === 1;
  return {
    line,
    x0: layout.x[0] - dx / 2,
    x1: layout.x[1] + dx / 2,
    y0: line ? 0 : layout.y[0] - dy / 2,
    y1: line ? 0 : layout.y[1] + dy / 2,
  };
}

function sizeMap(layout) {
  const c = document.getElementById("map"),
    ratio = devicePixelRatio || 1,
    wide = c.clientWidth,
    e = edges(layout);
  const inner = wide - LEFT - RIGHT,
    high = e.line ? Math.max(48, 0.2 * inner) : Math.min((inner * (e.y1 - e.y0)) / (e.x1 - e.x0), 1.2 * inner);
  const across = e.line ? inner : Math.min(inner, (high * (e.x1 - e.x0)) / (e.y1 - e.y0));
  c.width = Math.round(wide * ratio);
  c.height = Math.round((high + TOP + BOTTOM) * ratio);
  box = { x: LEFT * ratio, y: TOP * ratio, w: across * ratio, h: high * ratio, ratio };
  cells.width = layout.shape[1];
  cells.height = layout.shape[0];
  const key = document.getElementById("key");
  key.width = Math.round(key.clientWidth * ratio);
  key.height = Math.round(key.clientHeight * ratio);
}

function paintMap(layout, frame, theme, top, colour) {
  const [ny, nx] = layout.shape,
    c = document.getElementById("map"),
    x = c.getContext("2d");
  const small = cells.getContext("2d"),
    img = small.createImageData(nx, ny);
  for (let i = 0; i < ny; i++)
    for (let j = 0; j < nx; j++) {
      // y points up; grey: not known
      const v = frame.pressure[i * nx + j],
        [r, g, b] = Number.isNaN(v) ? [128, 128, 128] : ramp(theme, v / top);
      img.data.set([r, g, b, 255], 4 * ((ny - 1 - i) * nx + j));
    }
  small.putImageData(img, 0, 0);
  x.clearRect(0, 0, c.width, c.height);
  x.imageSmoothingEnabled = false;
  x.drawImage(cells, box.x, box.y, box.w, box.h);
  paintAxes(x, layout, colour);
  paintKey(layout, paintArrows(x, layout, frame, top, colour), colour);
}

function paintAxes(x, layout, colour) {
  const e = edges(layout),
    r = box.ratio,
    bottom = box.y + box.h;
  x.strokeStyle = colour("--soft");
  x.fillStyle = colour("--soft");
  x.lineWidth = r;
  x.font = `${11 * r}px system-ui,sans-serif`;
  x.strokeRect(box.x, box.y, box.w, box.h);
  const ticks = (a, b, most) => {
    const step = roundAbove(((b - a) * 1e3) / most),
      out = [];
    for (let v = Math.ceil((a * 1e3) / step - 1e-9) * step; v <= b * 1e3 + 1e-9; v += step) out.push(v);
    return out;
  };
  const text = (v) => String(Number(v.toPrecision(6)));
  x.textAlign = "center";
  x.textBaseline = "top";
  for (const v of ticks(e.x0, e.x1, Math.max(2, box.w / r / 55))) {
    const at = box.x + ((v * 1e-3 - e.x0) / (e.x1 - e.x0)) * box.w;
    x.beginPath();
    x.moveTo(at, bottom);
    x.lineTo(at, bottom + 4 * r);
    x.stroke();
    x.fillText(text(v), at, bottom + 5 * r);
  }
  x.fillText("x [mm]", box.x + box.w / 2, bottom + 19 * r);
  if (e.line) return;
  x.textAlign = "right";
  x.textBaseline = "middle";
  for (const v of ticks(e.y0, e.y1, Math.max(2, box.h / r / 45))) {
    const at = bottom - ((v * 1e-3 - e.y0) / (e.y1 - e.y0)) * box.h;
    x.beginPath();
    x.moveTo(box.x - 4 * r, at);
    x.lineTo(box.x, at);
    x.stroke();
    x.fillText(text(v), box.x - 6 * r, at);
  }
  x.save();
  x.translate(9 * r, box.y + box.h / 2);
  x.rotate(-Math.PI / 2);
  x.textAlign = "center";
  x.fillText("y [mm]", 0, 0);
  x.restore();
}

function arrow(x, ax, ay, dx, dy, r) {
  const angle = Math.atan2(dy, dx),
    tip = Math.min(7 * r, 0.5 * Math.hypot(dx, dy));
  x.beginPath();
  x.moveTo(ax, ay);
  x.lineTo(ax + dx, ay + dy);
  x.stroke();
  x.beginPath();
  x.moveTo(ax + dx, ay + dy);
  for (const turn of [2.6, -2.6])
    x.lineTo(ax + dx + tip * Math.cos(angle + turn), ay + dy + tip * Math.sin(angle + turn));
  x.fill();
}

/** Arrows where the shear is: of each block of cells the one with the most. Returns pixels per pascal, 0 where there are none. */
function paintArrows(x, layout, frame, top, colour) {
  const [ny, nx] = layout.shape,
    w = box.w / nx,
    h = box.h / ny,
    step = Math.max(1, Math.round(nx / 20));
  const at = (k) => Math.hypot(frame.sx[k], frame.sy ? frame.sy[k] : 0);
  let most = 0;
  for (let k = 0; k < nx * ny; k++) {
    const q = at(k);
    if (q > most) most = q;
  }
  if (!(most > 0.02 * top)) return 0;
  const long = Math.max(1.6 * step * w, 18 * box.ratio) / Math.max(most, 0.2 * top);
  x.strokeStyle = colour("--shear");
  x.fillStyle = x.strokeStyle;
  x.lineWidth = Math.max(1.4 * box.ratio, w / 12);
  for (let i = 0; i < ny; i += step)
    for (let j = 0; j < nx; j += step) {
      let best = -1,
        bi = i,
        bj = j;
      for (let a = i; a < Math.min(ny, i + step); a++)
        for (let b = j; b < Math.min(nx, j + step); b++)
          if (at(a * nx + b) > best) {
            best = at(a * nx + b);
            bi = a;
            bj = b;
          }
      if (best * long < 3 * box.ratio) continue;
      const k = bi * nx + bj;
      arrow(
        x,
        box.x + (bj + 0.5) * w,
        box.y + (ny - bi - 0.5) * h,
        frame.sx[k] * long,
        frame.sy ? -frame.sy[k] * long : 0,
        box.ratio,
      );
    }
  return long;
}

function paintKey(layout, long, colour) {
  const c = document.getElementById("key"),
    x = c.getContext("2d"),
    r = box.ratio,
    e = edges(layout),
    y = c.height / 2;
  x.clearRect(0, 0, c.width, c.height);
  x.font = `${12 * r}px system-ui,sans-serif`;
  x.textBaseline = "middle";
  x.textAlign = "left";
  x.lineWidth = 2 * r;
  const perMetre = box.w / (e.x1 - e.x0),
    length = roundBelow(0.3 * (e.x1 - e.x0) * 1e3) * 1e-3,
    wide = length * perMetre;
  x.strokeStyle = colour("--fore");
  x.fillStyle = x.strokeStyle;
  x.beginPath();
  x.moveTo(box.x, y - 4 * r);
  x.lineTo(box.x, y + 4 * r);
  x.moveTo(box.x, y);
  x.lineTo(box.x + wide, y);
  x.moveTo(box.x + wide, y - 4 * r);
  x.lineTo(box.x + wide, y + 4 * r);
  x.stroke();
  x.fillText(`${Number((length * 1e3).toPrecision(3))} mm`, box.x + wide + 8 * r, y);
  if (!long) return;
  const stress = roundBelow((46 * r) / long),
    from = box.x + wide + 78 * r;
  x.strokeStyle = colour("--shear");
  x.fillStyle = x.strokeStyle;
  arrow(x, from, y, stress * long, 0, r);
  x.fillStyle = colour("--fore");
  x.fillText(`shear ${unit(stress, "Pa", 1)}`, from + stress * long + 8 * r, y);
}

/** The colours, and below them where the peak lies with 95 %. */
function paintBar(theme, top, low, high, colour) {
  const c = document.getElementById("bar"),
    x = c.getContext("2d"),
    colours = 10,
    img = x.createImageData(c.width, colours);
  x.clearRect(0, 0, c.width, c.height);
  for (let i = 0; i < c.width; i++) {
    const [r, g, b] = ramp(theme, i / (c.width - 1));
    for (let j = 0; j < colours; j++) img.data.set([r, g, b, 255], 4 * (j * c.width + i));
  }
  x.putImageData(img, 0, 0);
  if (low === null || low === undefined || high === null || high === undefined) return;
  // an end beyond the colours is an arrow
  const px = (v) => Math.max(1, Math.min(c.width - 1, (v / top) * c.width)),
    beyond = high > top * 1.005;
  x.strokeStyle = colour("--fore");
  x.lineWidth = 2;
  x.beginPath();
  x.moveTo(px(low), 12);
  x.lineTo(px(low), 18);
  x.moveTo(px(low), 15);
  x.lineTo(px(high), 15);
  if (beyond) {
    x.moveTo(px(high) - 5, 11);
    x.lineTo(px(high), 15);
    x.lineTo(px(high) - 5, 19);
  } else {
    x.moveTo(px(high), 12);
    x.lineTo(px(high), 18);
  }
  x.stroke();
}
