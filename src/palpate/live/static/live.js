"use strict";
// Only the newest packet is painted; the last minute is kept for looking back.
const $ = (id) => document.getElementById(id);
const KEEP = 1500, SPAN = 10;
const hook = { received: 0, painted: 0, dropped: 0, latencies: [], connected: false, failures: 0 };
window.palpate = hook;
hook.latency = (q) => { const s = [...hook.latencies].sort((a, b) => a - b); return s.length ? s[Math.min(s.length - 1, Math.floor(q * s.length))] : NaN; };

let layout = null, frames = [], trail = [], fresh = null, shown = null, paused = false, back = 0, top_ = 0;
let state = { failure: null, ended: false, recording: null, sender: null, received: {} }, bad = [], lastMessage = Date.now();
const decoder = new TextDecoder();

// -- theme ---------------------------------------------------------------------------------------
const wanted = new URLSearchParams(location.search).get("theme");
let theme = wanted || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
function dress() { document.documentElement.dataset.theme = theme; paintBar(); repaint(); }

// perceptually even from background to strong: light and dark ends follow the theme (sampled from viridis-like hues of our own)
const RAMP = { light: [[247,247,243],[190,217,214],[98,178,187],[33,124,158],[33,68,122],[36,18,77]], dark: [[24,24,24],[36,42,92],[30,95,140],[44,150,150],[138,200,120],[248,236,140]] };
function ramp(v) {
  const r = RAMP[theme], t = Math.max(0, Math.min(1, v)) * (r.length - 1), i = Math.min(r.length - 2, Math.floor(t)), f = t - i;
  return [0, 1, 2].map((k) => r[i][k] + f * (r[i + 1][k] - r[i][k]));
}
function paintBar() {
  const c = $("bar"), x = c.getContext("2d"), img = x.createImageData(c.width, c.height);
  for (let i = 0; i < c.width; i++) { const [r, g, b] = ramp(i / (c.width - 1)); for (let j = 0; j < c.height; j++) img.data.set([r, g, b, 255], 4 * (j * c.width + i)); }
  x.putImageData(img, 0, 0);
}

// -- packets -------------------------------------------------------------------------------------
function parse(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, false) !== 0x504c5031) throw new Error("not a packet");
  const size = view.getUint32(4, true);
  const numbers = JSON.parse(decoder.decode(new Uint8Array(buffer, 8, size)));
  const [ny, nx] = layout.shape, n = ny * nx, count = layout.components.length;
  const flat = new Float32Array(buffer.slice(8 + size));
  if (flat.length !== n * count) throw new Error("a map of the wrong size");
  return { ...numbers, pressure: flat.subarray(0, n), sx: flat.subarray(n, 2 * n), sy: count > 2 ? flat.subarray(2 * n, 3 * n) : null };
}

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream${location.search}`);
  socket.binaryType = "arraybuffer";
  hook.socket = socket;
  socket.onopen = () => { hook.connected = true; lastMessage = Date.now(); say(standing()); };
  socket.onclose = (event) => { hook.connected = false; say(event.reason === "pages" ? "too many pages are open; trying again" : "lost; trying again"); setTimeout(connect, 1000); };
  socket.onmessage = (message) => {
    if (typeof message.data === "string") { told(JSON.parse(message.data)); return; }
    hook.received++; lastMessage = Date.now();
    let frame;
    try { frame = parse(message.data); } catch (error) { hook.failures++; return; }
    frames.push(frame);
    if (frames.length > KEEP) frames.shift();
    trail.push(frame); if (trail.length > 2 * KEEP) trail.shift();
    if (fresh) hook.dropped++;
    fresh = frame;
  };
}
function told(facts) {
  if (facts.shape) {
    layout = facts; frames = []; trail = facts.history; $("name").textContent = facts.name; $("notes").textContent = facts.notes.join(" ");
    $("record").hidden = !facts.may_record; $("zero").hidden = !facts.may_zero; $("events").textContent = ""; facts.past.forEach((text) => log(text)); size();
  }
  if (facts.log) facts.log.forEach((text) => log(text));
  if (facts.state) { state = facts.state; hook.state = state; recording(state.recording); say(standing()); alarms(); wire(); }
  if ("recording" in facts) recording(facts.recording);
  if (facts.refused) log(facts.refused, true);
}
function recording(name) { $("record").setAttribute("aria-pressed", String(Boolean(name))); $("record").textContent = name ? "Stop recording" : "Record"; }
// what is wrong with the stream stays in sight until it is mended, whatever the contact does
function alarms() { alarm([...(state.failure ? [state.failure] : []), ...bad].join("; ")); }
function standing() {
  if (paused) return "paused";
  if (state.ended) return state.failure ? "the stream has failed" : "the stream has ended";
  const silent = Math.floor((Date.now() - lastMessage) / 1000);
  return silent < 2 ? "live" : frames.length ? `no frame for ${silent} s` : "waiting for the first frame";
}
const COUNTED = ["frames", "sessions"];
function wire() {
  const lost = Object.entries(state.received).filter(([k, v]) => v && !COUNTED.includes(k)).map(([k, v]) => `${v} ${k}`);
  const some = Object.keys(state.received).length > 0;
  $("wire").hidden = !some;
  $("wire").textContent = some ? `on the wire: ${state.sender ? `${state.sender} is served` : "nobody sends"}; ${state.received.frames} frames, ${state.received.sessions} sessions; not taken: ${lost.join(", ") || "none"}` : "";
}
setInterval(() => { if (hook.connected) say(standing()); }, 500);
function say(text) { if ($("status").textContent !== text) $("status").textContent = text; }
function log(text, warn) {
  const item = document.createElement("li");
  item.textContent = text;
  if (warn === true || /(slip|excess).*began|refused|began again|went back/.test(text)) item.className = "warn";
  $("events").prepend(item);
  while ($("events").children.length > 200) $("events").lastChild.remove();
}
function alarm(text) { $("alarm").hidden = !text; if ($("alarm").textContent !== text) $("alarm").textContent = text; }

// -- painting ------------------------------------------------------------------------------------
const cells = document.createElement("canvas");
function size() {
  if (!layout) return;
  const c = $("map"), ratio = devicePixelRatio || 1, [ny, nx] = layout.shape;
  const high = ny === 1 ? 0.25 : (ny * layout.spacing[0]) / (nx * layout.spacing[layout.spacing.length - 1]);
  c.width = Math.round(c.clientWidth * ratio); c.height = Math.round(c.clientWidth * Math.min(high, 1.2) * ratio);
  cells.width = nx; cells.height = ny;
  for (const id of ["forces", "margins"]) { const p = $(id); p.width = Math.round(p.clientWidth * ratio); p.height = Math.round(p.clientHeight * ratio); }
  repaint();
}
const unit = (v, u) => { if (v === null || v === undefined || Number.isNaN(v)) return "–"; const a = Math.abs(v); return a >= 1e6 ? (v / 1e6).toPrecision(3) + " M" + u : a >= 1e3 ? (v / 1e3).toPrecision(3) + " k" + u : a >= 1 || a === 0 ? v.toPrecision(3) + " " + u : (v * 1e3).toPrecision(3) + " m" + u; };
const range = (a, b, u) => (a === undefined || a === null ? "" : `95 %: ${unit(a, u)} to ${unit(b, u)}`);
function paint(frame) {
  const [ny, nx] = layout.shape, c = $("map"), x = c.getContext("2d"), img = cells.getContext("2d").createImageData(nx, ny);
  let peak = 0; for (const v of frame.pressure) if (v > peak) peak = v;
  top_ = Math.max(peak, top_ * 0.995, 1e-9);
  for (let i = 0; i < ny; i++) for (let j = 0; j < nx; j++) {
    // y points up
    const v = frame.pressure[i * nx + j], [r, g, b] = Number.isNaN(v) ? [128, 128, 128] : ramp(v / top_);  // grey: not known
    img.data.set([r, g, b, 255], 4 * ((ny - 1 - i) * nx + j));
  }
  cells.getContext("2d").putImageData(img, 0, 0);
  x.imageSmoothingEnabled = false; x.drawImage(cells, 0, 0, c.width, c.height);
  arrows(x, frame, c.width / nx, c.height / ny, nx, ny);
  $("high").textContent = unit(top_, "Pa");
  numbers(frame);
}
function arrows(x, frame, w, h, nx, ny) {
  let most = 0;
  for (let k = 0; k < nx * ny; k++) { const q = Math.hypot(frame.sx[k], frame.sy ? frame.sy[k] : 0); if (q > most) most = q; }
  if (most < 0.02 * top_) return;
  const step = Math.max(1, Math.round(nx / 24)), long = 1.6 * step * w / Math.max(most, 0.2 * top_);
  x.strokeStyle = colour("--shear"); x.fillStyle = x.strokeStyle; x.lineWidth = Math.max(1.2, w / 10);
  for (let i = 0; i < ny; i += ny === 1 ? 1 : step) for (let j = 0; j < nx; j += step) {
    const k = i * nx + j, dx = frame.sx[k] * long, dy = frame.sy ? -frame.sy[k] * long : 0;
    if (Math.hypot(dx, dy) < 3) continue;
    const ax = (j + 0.5) * w, ay = (ny - i - 0.5) * h, angle = Math.atan2(dy, dx), tip = Math.min(7, 0.5 * Math.hypot(dx, dy)) * (devicePixelRatio || 1) * 0.8;
    x.beginPath(); x.moveTo(ax, ay); x.lineTo(ax + dx, ay + dy); x.stroke();
    x.beginPath(); x.moveTo(ax + dx, ay + dy);
    for (const turn of [2.6, -2.6]) x.lineTo(ax + dx + tip * Math.cos(angle + turn), ay + dy + tip * Math.sin(angle + turn));
    x.fill();
  }
}
const shearOf = (f) => f.force.includes(null) ? null : Math.hypot(...f.force.slice(0, -1));
function shearRange(f) {
  if (!f.force_low) return [undefined, undefined];
  // interval of the size from those of the parts: nearest and farthest corner
  let near = 0, far = 0;
  for (let i = 0; i + 1 < f.force.length; i++) { const a = f.force_low[i], b = f.force_high[i]; near += (a > 0 ? a : b < 0 ? b : 0) ** 2; far += Math.max(Math.abs(a), Math.abs(b)) ** 2; }
  return [Math.sqrt(near), Math.sqrt(far)];
}
function numbers(f) {
  const u = layout.unit, last = f.force.length - 1;
  $("normal").textContent = unit(f.force[last], u);
  $("normal-range").textContent = f.force_low ? range(f.force_low[last], f.force_high[last], u) : "";
  $("shear").textContent = unit(shearOf(f), u);
  const [a, b] = shearRange(f); $("shear-range").textContent = range(a, b, u);
  $("peak").textContent = unit(f.peak, "Pa"); $("peak-range").textContent = f.peak_low ? range(f.peak_low[0], f.peak_high[0], "Pa") : "";
  $("margin").textContent = f.utilisation === null ? "–" : (1 - f.utilisation).toFixed(2);
  $("margin-range").textContent = f.utilisation === null ? "" : `± ${(2 * f.utilisation_std).toFixed(2)}, friction ${f.friction.toFixed(2)}`;
  bad = f.going_on.filter((k) => k !== "contact");
  if (f.touching === null || f.status === "frozen") bad.unshift(f.touching === null ? `this frame is not known: ${f.status}` : "the sensor repeats itself: frozen?");
  alarms();
  const h = f.health;
  $("health").textContent = `frame ${h.frames}, ${f.ms.toFixed(1)} ms; ${h.late} late, ${h.approximate} approximate, ${h.behind} skipped, ${h.unknown || 0} unknown, ${h.restarts || 0} restarts of the clock; left out: ${h.left_out_count ? h.left_out.join(", ") : "none"}`;
  $("map").setAttribute("aria-label", f.touching ? `Contact: ${unit(f.force[last], u)} normal, ${unit(shearOf(f), u)} shear` : f.touching === null ? `Not known: ${f.status}` : "No contact");
}
function plot(id, upto, lines, low, high) {
  const c = $(id), x = c.getContext("2d"), ratio = devicePixelRatio || 1, end = upto.time, pad = 34 * ratio;
  x.clearRect(0, 0, c.width, c.height);
  const px = (t) => pad + ((t - end + SPAN) / SPAN) * (c.width - pad - 4 * ratio), py = (v) => c.height - 14 * ratio - ((v - low) / (high - low)) * (c.height - 22 * ratio);
  x.font = `${11 * ratio}px system-ui,sans-serif`; x.fillStyle = colour("--soft"); x.strokeStyle = colour("--line"); x.lineWidth = ratio;
  for (const v of [low, 0.5 * (low + high), high]) { x.beginPath(); x.moveTo(pad, py(v)); x.lineTo(c.width, py(v)); x.stroke(); x.textAlign = "right"; x.fillText(Number(v.toPrecision(2)), pad - 4 * ratio, py(v) + 4 * ratio); }
  x.textAlign = "left"; x.fillText(`−${SPAN} s`, pad, c.height - 2 * ratio); x.textAlign = "right"; x.fillText("now", c.width - 4 * ratio, c.height - 2 * ratio);
  const some = trail.filter((f) => f.time <= end && f.time > end - SPAN);
  for (const [name, value, band] of lines) {
    x.fillStyle = colour(name); x.strokeStyle = x.fillStyle; x.globalAlpha = 0.22;
    x.beginPath(); let open = [];
    const close = () => { if (open.length > 1) { x.beginPath(); open.forEach(([t, , b], i) => (i ? x.lineTo(px(t), py(b)) : x.moveTo(px(t), py(b)))); [...open].reverse().forEach(([t, a]) => x.lineTo(px(t), py(a))); x.fill(); } open = []; };
    for (const f of some) { const [a, b] = band(f); if (a === undefined || a === null) close(); else open.push([f.time, Math.max(low, Math.min(high, a)), Math.max(low, Math.min(high, b))]); }
    close(); x.globalAlpha = 1; x.lineWidth = 1.6 * ratio; x.beginPath(); let down = false;
    for (const f of some) { const v = value(f); if (v === null || v === undefined) { down = false; continue; } const y = py(Math.max(low, Math.min(high, v))); down ? x.lineTo(px(f.time), y) : x.moveTo(px(f.time), y); down = true; }
    x.stroke();
  }
}
function nice(v) { const p = 10 ** Math.floor(Math.log10(v)); return [1, 2, 5, 10].map((k) => k * p).find((k) => k >= v); }
function plots(frame) {
  const last = frame.force.length - 1;
  let most = 1e-9; for (const f of trail) most = Math.max(most, f.force[last], f.touching && f.force_high ? f.force_high[last] : 0);
  plot("forces", frame, [["--normal", (f) => f.force[last], (f) => (f.touching && f.force_low ? [f.force_low[last], f.force_high[last]] : [])], ["--shear", shearOf, (f) => (f.touching ? shearRange(f) : [])]], 0, nice(most));
  plot("margins", frame, [["--good", (f) => (f.utilisation === null ? null : 1 - f.utilisation), (f) => (f.utilisation === null ? [] : [1 - f.utilisation - 2 * f.utilisation_std, 1 - f.utilisation + 2 * f.utilisation_std])]], 0, 1);
}
let plotted = 0;
function repaint() { if (shown && layout) { paint(shown); plots(shown); } }
function tick(now) {
  requestAnimationFrame(tick);
  if (!fresh || !layout) return;
  const frame = fresh; fresh = null;
  if (paused || back > 0) return;
  shown = frame; paint(frame);
  if (now - plotted > 60) { plots(frame); plotted = now; }
  hook.painted++;
  hook.latencies.push(Date.now() - frame.born); if (hook.latencies.length > 20000) hook.latencies.shift();
  $("scrub").max = String(Math.max(1, frames.length - 1)); $("scrub").value = $("scrub").max; $("ago").textContent = "now";
}

// -- what the user does --------------------------------------------------------------------------
function pause(on) { paused = on; if (!on) back = 0; $("pause").setAttribute("aria-pressed", String(on)); $("pause").textContent = on ? "Go on" : "Pause"; if (on) $("scrub").max = String(frames.length - 1); say(standing()); }
function look(index) {
  if (!frames.length) return;
  const i = Math.max(0, Math.min(frames.length - 1, index));
  if (!paused) pause(true);
  shown = frames[i]; back = frames.length - 1 - i; $("scrub").value = String(i);
  $("ago").textContent = back ? `−${(frames[frames.length - 1].time - shown.time).toFixed(2)} s` : "now"; repaint();
}
$("pause").onclick = () => pause(!paused);
$("scrub").oninput = () => look(Number($("scrub").value));
$("theme").onclick = () => { theme = theme === "dark" ? "light" : "dark"; dress(); };
$("record").onclick = () => hook.socket.send(JSON.stringify({ record: $("record").getAttribute("aria-pressed") !== "true" }));
$("zero").onclick = () => hook.socket.send(JSON.stringify({ zero: true }));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase(), onButton = event.target instanceof HTMLButtonElement;
  if (key === " " && !onButton) { event.preventDefault(); pause(!paused); }
  else if (key === "t") $("theme").click();
  else if (key === "z" && !$("zero").hidden) $("zero").click();
  else if (key === "r" && !$("record").hidden) $("record").click();
  else if ((key === "arrowleft" || key === "arrowright") && event.target !== $("scrub")) look(Number($("scrub").value) + (key === "arrowleft" ? -1 : 1) * (event.shiftKey ? 25 : 1));
});
addEventListener("resize", size);
dress(); connect(); requestAnimationFrame(tick);
