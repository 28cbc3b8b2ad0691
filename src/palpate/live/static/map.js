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
  paintTaxels(x, layout, colour);
  paintOutside(x, layout, frame, top, colour);
  paintAxes(x, layout, colour);
  paintKey(layout, paintArrows(x, layout, frame, top, colour), colour);
  paintCentre(x, layout, frame, colour);
  sayOutside(x, frame, colour);
}

/** Where a place of the surface [m] lies on the canvas [px]. */
function spot(e, px, py) {
  return [
    box.x + ((px - e.x0) / (e.x1 - e.x0)) * box.w,
    e.line ? box.y + box.h / 2 : box.y + box.h - ((py - e.y0) / (e.y1 - e.y0)) * box.h,
  ];
}

/** Text that is read on any colour. */
function haloed(x, text, ax, ay, colour, name) {
  x.lineJoin = "round";
  x.lineWidth = 3 * box.ratio;
  x.strokeStyle = colour("--card");
  x.strokeText(text, ax, ay);
  x.fillStyle = colour(name);
  x.fillText(text, ax, ay);
}

/** Outline and name of each taxel, as far as they have room, and the edge of the array. */
function paintTaxels(x, layout, colour) {
  const e = edges(layout),
    r = box.ratio,
    perX = box.w / (e.x1 - e.x0);
  x.save();
  x.beginPath();
  x.rect(box.x, box.y, box.w, box.h);
  x.clip();
  for (const plane of layout.planes) {
    const w = plane.size[0] * perX,
      h = e.line ? box.h - 2 * r : plane.size[1] * perX;
    if (w < 4 * r) continue;
    const small = Math.max(8, Math.min(11, w / r / 3.4));
    x.font = `${small * r}px system-ui,sans-serif`;
    x.textAlign = "left";
    x.textBaseline = "top";
    for (let i = 0; i < plane.names.length; i++) {
      const [cx, cy] = spot(e, plane.x[i], plane.y[i]);
      x.strokeStyle = colour(plane.works[i] ? "--taxel" : "--alarm");
      x.lineWidth = r;
      x.beginPath();
      if (plane.round && !e.line) x.ellipse(cx, cy, w / 2, h / 2, 0, 0, 2 * Math.PI);
      else x.rect(cx - w / 2, cy - h / 2, w, h);
      x.stroke();
      const wide = x.measureText(plane.names[i]).width;
      if (wide < 0.8 * w && small * r < 0.7 * h) {
        x.globalAlpha = 0.8;
        const round = plane.round && !e.line;
        haloed(
          x,
          plane.names[i],
          round ? cx - wide / 2 : cx - w / 2 + 2 * r,
          round ? cy - (small * r) / 2 : cy - h / 2 + 2 * r,
          colour,
          "--soft",
        );
        x.globalAlpha = 1;
      }
    }
  }
  x.strokeStyle = colour("--fore");
  x.lineWidth = 1.5 * r;
  x.setLineDash([6 * r, 4 * r]);
  x.beginPath();
  if (e.line)
    for (const [px] of layout.edge) {
      const [at] = spot(e, px, 0);
      x.moveTo(at, box.y);
      x.lineTo(at, box.y + box.h);
    }
  else {
    layout.edge.forEach(([px, py], i) => (i ? x.lineTo(...spot(e, px, py)) : x.moveTo(...spot(e, px, py))));
    x.closePath();
  }
  x.stroke();
  x.restore();
}

/** Cells beyond the edge of the array: 1 outside, 0 inside. */
function beyond(layout) {
  const e = edges(layout),
    [ny, nx] = layout.shape,
    out = new Uint8Array(nx * ny),
    corners = layout.edge;
  for (let i = 0; i < ny; i++)
    for (let j = 0; j < nx; j++) {
      const px = e.x0 + ((j + 0.5) * (e.x1 - e.x0)) / nx,
        py = e.line ? 0 : e.y0 + ((i + 0.5) * (e.y1 - e.y0)) / ny;
      let left = 0,
        right = 0;
      for (let k = 0; k < corners.length; k++) {
        const [ax, ay] = corners[k],
          [bx, by] = corners[(k + 1) % corners.length];
        if ((bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0) left++;
        else right++;
      }
      out[i * nx + j] = e.line ? px < corners[0][0] || px > corners[1][0] : left && right ? 1 : 0;
    }
  return out;
}
const OUTSIDE = 0.05; // the part of the load from which on it is said, as the summary of a touch says it
let outside = null,
  outsideOf = null;

/** Pressure where no taxel measures: hatched, with its part of the load. */
function paintOutside(x, layout, frame, top, colour) {
  if (outsideOf !== layout) {
    outside = beyond(layout);
    outsideOf = layout;
  }
  const [ny, nx] = layout.shape,
    r = box.ratio,
    w = box.w / nx,
    h = box.h / ny;
  let all = 0,
    there = 0;
  for (let k = 0; k < nx * ny; k++) {
    const p = Math.abs(frame.pressure[k]);
    if (Number.isNaN(p)) continue;
    all += p;
    if (outside[k]) there += p;
  }
  frame.outside = all > 0 ? there / all : 0;
  if (!frame.touching || frame.outside <= OUTSIDE) return;
  x.save();
  x.beginPath();
  for (let i = 0; i < ny; i++)
    for (let j = 0; j < nx; j++)
      if (outside[i * nx + j] && Math.abs(frame.pressure[i * nx + j]) > 0.05 * top)
        x.rect(box.x + j * w, box.y + (ny - 1 - i) * h, w, h);
  x.clip();
  x.strokeStyle = colour("--alarm");
  x.lineWidth = r;
  x.beginPath();
  for (let at = -box.h; at < box.w; at += 6 * r) {
    x.moveTo(box.x + at, box.y + box.h);
    x.lineTo(box.x + at + box.h, box.y);
  }
  x.stroke();
  x.restore();
}

/** What lies beyond, in words, over all else. */
function sayOutside(x, frame, colour) {
  if (!frame.touching || frame.outside <= OUTSIDE) return;
  const r = box.ratio;
  const text = `outside the array: ${Math.round(100 * frame.outside)} % of the load`;
  x.font = `600 ${12 * r}px system-ui,sans-serif`;
  const fits = Math.min(1, (box.w - 8 * r) / x.measureText(text).width);
  x.font = `600 ${12 * fits * r}px system-ui,sans-serif`;
  x.textAlign = "center";
  x.textBaseline = "top";
  haloed(x, text, box.x + box.w / 2, box.y + 4 * r, colour, "--alarm");
}

/** The centre of pressure, its arms as long as its interval. */
function paintCentre(x, layout, frame, colour) {
  if (!frame.touching || !frame.center || frame.center.includes(null)) return;
  const e = edges(layout),
    r = box.ratio,
    [cx, cy] = spot(e, frame.center[0], frame.center[1] ?? 0);
  const draw = (name, wide) => {
    x.strokeStyle = colour(name);
    x.lineWidth = wide * r;
    x.beginPath();
    x.arc(cx, cy, 5 * r, 0, 2 * Math.PI);
    const low = frame.center_low,
      high = frame.center_high,
      known = low && high && !low.includes(null) && !high.includes(null);
    const [x0, y1] = known ? spot(e, low[0], low[1] ?? 0) : [cx - 9 * r, cy + 9 * r],
      [x1, y0] = known ? spot(e, high[0], high[1] ?? 0) : [cx + 9 * r, cy - 9 * r];
    x.moveTo(Math.min(x0, cx - 9 * r), cy);
    x.lineTo(Math.max(x1, cx + 9 * r), cy);
    x.moveTo(cx, e.line ? box.y : Math.min(y0, cy - 9 * r));
    x.lineTo(cx, e.line ? box.y + box.h : Math.max(y1, cy + 9 * r));
    x.stroke();
  };
  x.save();
  x.beginPath();
  x.rect(box.x, box.y, box.w, box.h);
  x.clip();
  draw("--card", 4);
  draw("--fore", 1.6);
  x.restore();
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
