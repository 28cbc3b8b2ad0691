"use strict";
// Only the newest packet is painted; the last minute is kept for looking back.
const $ = (id) => document.getElementById(id);
const KEEP = 1500;
const hook = { received: 0, painted: 0, dropped: 0, latencies: [], connected: false, failures: 0 };
window.palpate = hook;
hook.latency = (q) => {
  const s = [...hook.latencies].sort((a, b) => a - b);
  return s.length ? s[Math.min(s.length - 1, Math.floor(q * s.length))] : NaN;
};

let layout = null,
  frames = [],
  trail = [],
  fresh = null,
  shown = null,
  held = null, // what can be looked through while paused: it must not move on under the reader
  paused = false,
  back = 0,
  top_ = 0;
let state = { failure: null, ended: false, recording: null, sender: null, received: {} },
  bad = [],
  lastMessage = Date.now();
const decoder = new TextDecoder();

// -- theme ---------------------------------------------------------------------------------------
const wanted = new URLSearchParams(location.search).get("theme");
let theme = wanted || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
function dress() {
  document.documentElement.dataset.theme = theme;
  if (layout) makeCharts(layout, colour);
  if (box) repaint();
}

// -- packets -------------------------------------------------------------------------------------
function parse(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, false) !== 0x504c5031) throw new Error("not a packet");
  const size = view.getUint32(4, true);
  const numbers = JSON.parse(decoder.decode(new Uint8Array(buffer, 8, size)));
  const [ny, nx] = layout.shape,
    n = ny * nx,
    count = layout.components.length;
  const flat = new Float32Array(buffer.slice(8 + size));
  const shown = n * count,
    each = layout.readings;
  if (flat.length !== shown + 2 * each) throw new Error("a map of the wrong size");
  return {
    ...numbers,
    raw: flat.subarray(shown, shown + each),
    change: flat.subarray(shown + each),
    pressure: flat.subarray(0, n),
    sx: flat.subarray(n, 2 * n),
    sy: count > 2 ? flat.subarray(2 * n, 3 * n) : null,
  };
}

function connect() {
  const socket = new WebSocket(
    `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream${location.search}`,
  );
  socket.binaryType = "arraybuffer";
  hook.socket = socket;
  socket.onopen = () => {
    hook.connected = true;
    lastMessage = Date.now();
    say(standing());
    able();
    alarms();
  };
  socket.onclose = (event) => {
    hook.connected = false;
    say(event.reason === "pages" ? "too many pages are open; trying again" : "lost; trying again");
    able();
    alarms();
    setTimeout(connect, 1000);
  };
  socket.onmessage = (message) => {
    if (typeof message.data === "string") {
      told(JSON.parse(message.data));
      return;
    }
    hook.received++;
    lastMessage = Date.now();
    let frame;
    try {
      frame = parse(message.data);
    } catch (error) {
      hook.failures++;
      return;
    }
    frames.push(frame);
    if (frames.length > KEEP) frames.shift();
    trail.push(frame);
    if (trail.length > 2 * KEEP) trail.shift();
    if (fresh) hook.dropped++;
    fresh = frame;
  };
}
function told(facts) {
  if (facts.shape) {
    if (layout && String(layout.shape) !== String(facts.shape)) {
      // frames of another sensor do not fit
      pause(false);
      shown = fresh = null;
    }
    layout = facts;
    frames = [];
    trail = facts.history;
    $("name").textContent = facts.name;
    $("notes").textContent = facts.notes.join(" ");
    $("record").hidden = !facts.may_record;
    $("zero").hidden = !facts.may_zero;
    $("events").textContent = "";
    facts.past.forEach((text) => log(text));
    makeCharts(layout, colour);
    forgetReadings();
    size();
  }
  if (facts.log) facts.log.forEach((text) => log(text));
  if (facts.state) {
    state = facts.state;
    hook.state = state;
    recording(state.recording);
    say(standing());
    able();
    alarms();
    wire();
  }
  if ("recording" in facts) recording(facts.recording);
  if (facts.refused) log(facts.refused, true);
}
function recording(name) {
  $("record").dataset.on = String(Boolean(name));
  $("record").textContent = name ? "Stop recording" : "Record";
}
// what is wrong with the stream stays in sight until it is mended, whatever the contact does
function alarms() {
  const lost = layout && !hook.connected ? ["the connection is lost: this is the last that came"] : [];
  alarm([...lost, ...(state.failure ? [state.failure] : []), ...bad].join("; "));
}
// with the connection, and without: a button that would do nothing is off
function able() {
  $("zero").disabled = !hook.connected || state.ended;
  $("record").disabled = !hook.connected || (state.ended && !state.recording);
  if (back === 0) stand(newest());
}
// what is shown when nobody looks back
const last = (list) => list[list.length - 1];
const over = () => state.ended || (layout !== null && !hook.connected);
const newest = () =>
  paused && (!over() || last(held.frames) !== last(frames)) ? "paused" : over() ? "last frame" : "now";
function stand(text) {
  $("ago").textContent = text;
  // a screen reader says when, not the number of the frame
  $("scrub").setAttribute("aria-valuetext", `${text} ${$("at").textContent}`.trim());
}
function standing() {
  if (paused) return "paused";
  if (state.ended) return state.failure ? "the stream has failed" : "the stream has ended";
  const silent = Math.floor((Date.now() - lastMessage) / 1000);
  return silent < 2 ? "live" : frames.length ? `no frame for ${silent} s` : "waiting for the first frame";
}
const COUNTED = ["frames", "sessions"];
function wire() {
  const lost = Object.entries(state.received)
    .filter(([k, v]) => v && !COUNTED.includes(k))
    .map(([k, v]) => `${v} ${k}`);
  const some = Object.keys(state.received).length > 0;
  $("wire").hidden = !some;
  $("wire").textContent = some
    ? `on the wire: ${state.sender ? `${state.sender} is served` : "nobody sends"}; ${state.received.frames} frames, ${state.received.sessions} sessions; not taken: ${lost.join(", ") || "none"}`
    : "";
}
setInterval(() => {
  if (hook.connected) say(standing());
}, 500);
function say(text) {
  if ($("status").textContent !== text) $("status").textContent = text;
}
function log(text, warn) {
  const item = document.createElement("li");
  item.textContent = text;
  if (warn === true || /(slip|excess).*began|refused|began again|went back/.test(text)) item.className = "warn";
  $("events").prepend(item);
  while ($("events").children.length > 200) $("events").lastChild.remove();
}
function alarm(text) {
  $("alarm").hidden = !text;
  if ($("alarm").textContent !== text) $("alarm").textContent = text;
}

// -- painting ------------------------------------------------------------------------------------
function size() {
  if (!layout) return;
  sizeMap(layout);
  sizeReadings(layout);
  sizeCharts();
  repaint();
}
function unit(v, u, digits = 3) {
  if (v === null || v === undefined || Number.isNaN(v)) return "–";
  // rounded first: 999.9 is 1.00 k; what is too small for milli is written out
  const a = Math.abs(Number(v.toPrecision(digits))),
    [by, prefix] = a >= 1e6 ? [1e-6, "M"] : a >= 1e3 ? [1e-3, "k"] : a >= 1 || a === 0 ? [1, ""] : [1e3, "m"];
  const scaled = Number((v * by).toPrecision(digits));
  const places = Math.max(0, Math.min(9, digits - 1 - Math.floor(Math.log10(Math.max(Math.abs(scaled), 1e-9)))));
  return `${digits < 3 ? scaled : scaled.toFixed(scaled === 0 ? digits - 1 : places)} ${prefix}${u}`;
}
const range = (a, b, u) => (a === undefined || a === null ? "" : `95 %: ${unit(a, u)} to ${unit(b, u)}`);
function paint(frame) {
  let peak = 0;
  for (const v of frame.pressure) if (v > peak) peak = v;
  top_ = Math.max(peak, top_ * 0.995, 1e-9);
  paintMap(layout, frame, theme, top_, colour);
  paintReadings(layout, frame, theme, colour);
  paintBar(
    theme,
    top_,
    frame.touching && frame.peak_low ? frame.peak_low[0] : null,
    frame.touching && frame.peak_high ? frame.peak_high[0] : null,
    colour,
  );
  $("high").textContent = unit(top_, "Pa");
  $("at").textContent = frame.time === null ? "" : `at ${frame.time.toFixed(2)} s`;
  numbers(frame);
}
const shearOf = (f) => (f.force.includes(null) ? null : Math.hypot(...f.force.slice(0, -1)));
function shearRange(f) {
  if (!f.force_low) return [undefined, undefined];
  // interval of the size from those of the parts: nearest and farthest corner
  let near = 0,
    far = 0;
  for (let i = 0; i + 1 < f.force.length; i++) {
    const a = f.force_low[i],
      b = f.force_high[i];
    near += Math.max(a, -b, 0) ** 2;
    far += Math.max(Math.abs(a), Math.abs(b)) ** 2;
  }
  return [Math.sqrt(near), Math.sqrt(far)];
}
function numbers(f) {
  const u = layout.unit,
    last = f.force.length - 1;
  $("normal").textContent = unit(f.force[last], u);
  $("normal-range").textContent = f.force_low ? range(f.force_low[last], f.force_high[last], u) : "";
  $("shear").textContent = unit(shearOf(f), u);
  const [a, b] = shearRange(f);
  $("shear-range").textContent = range(a, b, u);
  $("peak").textContent = unit(f.peak, "Pa");
  $("peak-range").textContent = f.peak_low ? range(f.peak_low[0], f.peak_high[0], "Pa") : "";
  $("margin").textContent = f.utilisation === null ? "–" : (1 - f.utilisation).toFixed(2);
  $("margin-range").textContent =
    f.utilisation === null ? "" : `± ${(2 * f.utilisation_std).toFixed(2)}, friction ${f.friction.toFixed(2)}`;
  bad = f.going_on.filter((k) => k !== "contact");
  if (f.touching === null || f.status === "frozen")
    bad.unshift(f.touching === null ? `this frame is not known: ${f.status}` : "the sensor repeats itself: frozen?");
  alarms();
  health(f);
  $("map").setAttribute(
    "aria-label",
    f.touching
      ? `Contact: ${unit(f.force[last], u)} normal, ${unit(shearOf(f), u)} shear`
      : f.touching === null
        ? `Not known: ${f.status}`
        : "No contact",
  );
}
// what became of frames and taxels, in words; what did not happen is not said
function health(f) {
  const h = f.health,
    said = [`${h.frames} frames, the last in ${f.ms.toFixed(1)} ms`];
  const some = (count, words) => {
    if (count) said.push(`${count} ${words}`);
  };
  some(h.approximate, "approximate: answered before they were finished, because time was up");
  some(h.behind, "skipped: newer frames had come already");
  some(h.late, "late: with the time of the frame before");
  some(h.unknown, "unknown: without an answer");
  some(h.restarts, "restarts of the sensor’s clock");
  said.push(
    h.left_out_count
      ? `taxels left out: ${h.left_out.join(", ")}${h.left_out_count > h.left_out.length ? ` and ${h.left_out_count - h.left_out.length} more` : ""}`
      : "every taxel is used",
  );
  const text = said.join("\n");
  if ($("health").dataset.text === text) return;
  $("health").dataset.text = text;
  $("health").replaceChildren(
    ...said.map((one) => {
      const item = document.createElement("li");
      item.textContent = one;
      return item;
    }),
  );
}
let plotted = 0;
function repaint() {
  if (shown && layout && charts) {
    paint(shown);
    paintCharts(paused ? held.trail : trail, shown);
  }
}
function tick(now) {
  requestAnimationFrame(tick);
  if (!fresh || !layout) return;
  const frame = fresh;
  fresh = null;
  if (paused || back > 0) return;
  shown = frame;
  paint(frame);
  if (now - plotted > 60) {
    paintCharts(trail, frame);
    plotted = now;
  }
  hook.painted++;
  hook.latencies.push(Date.now() - frame.born);
  if (hook.latencies.length > 20000) hook.latencies.shift();
  $("scrub").max = String(Math.max(1, frames.length - 1));
  $("scrub").value = $("scrub").max;
  stand(newest());
}

// -- what the user does --------------------------------------------------------------------------
function pause(on) {
  paused = on;
  back = 0;
  held = null;
  $("pause").dataset.on = String(on);
  $("pause").textContent = on ? "Resume" : "Pause";
  if (on) {
    const until = frames.lastIndexOf(shown) + 1 || frames.length;
    held = { frames: frames.slice(0, until), trail: [...trail] };
    $("scrub").max = String(Math.max(0, until - 1));
    $("scrub").value = $("scrub").max;
    stand(newest());
  } else fresh = last(frames) || null; // also where no other frame ever comes
  if (hook.connected) say(standing());
}
function look(index) {
  if (!paused) pause(true);
  if (!held.frames.length) return;
  const end = held.frames.length - 1,
    i = Math.max(0, Math.min(end, index));
  shown = held.frames[i];
  back = end - i;
  $("scrub").value = String(i);
  repaint();
  stand(back ? `−${(held.frames[end].time - shown.time).toFixed(2)} s` : newest());
}
$("pause").onclick = () => pause(!paused);
$("scrub").oninput = () => look(Number($("scrub").value));
$("theme").onclick = () => {
  theme = theme === "dark" ? "light" : "dark";
  dress();
};
$("record").onclick = () => hook.socket.send(JSON.stringify({ record: $("record").dataset.on !== "true" }));
$("zero").onclick = () => hook.socket.send(JSON.stringify({ zero: true }));
// single keys can be switched off (WCAG 2.1.4): speech input and a hand that slips press them without meaning to
const KEYS = "palpate keys",
  TITLES = new Map(
    ["pause", "zero", "record", "theme"].map((id) => [id, [$(id).title, $(id).getAttribute("aria-keyshortcuts")]]),
  );
let keys = true;
try {
  keys = localStorage.getItem(KEYS) !== "off";
} catch {
  // a browser that keeps nothing
}
function listen(on) {
  keys = on;
  $("keys").setAttribute("aria-checked", String(on));
  $("keys").lastElementChild.textContent = on ? "on" : "off";
  $("keys").title = on
    ? "Space, arrows, T, Z and R act: switch them off"
    : "Space, arrows, T, Z and R do nothing: switch them on";
  for (const [id, [title, key]] of TITLES) {
    $(id).title = on ? title : title.replace(/^(Space|[A-Z])(: |$)/, "");
    if (on) $(id).setAttribute("aria-keyshortcuts", key);
    else $(id).removeAttribute("aria-keyshortcuts");
  }
  try {
    localStorage.setItem(KEYS, on ? "on" : "off");
  } catch {
    // as above
  }
}
$("keys").onclick = () => listen(!keys);
listen(keys);
document.addEventListener("keydown", (event) => {
  if (!keys || event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.toLowerCase(),
    onButton = event.target instanceof HTMLButtonElement;
  if (key === " " && !onButton) {
    event.preventDefault();
    if (!event.repeat) pause(!paused);
  } else if ("tzr".includes(key)) {
    // once, however long it is held down
    if (!event.repeat) {
      const button = $({ t: "theme", z: "zero", r: "record" }[key]);
      if (!button.hidden) button.click();
    }
  } else if ((key === "arrowleft" || key === "arrowright") && event.target !== $("scrub"))
    look(Number($("scrub").value) + (key === "arrowleft" ? -1 : 1) * (event.shiftKey ? 25 : 1));
});
addEventListener("resize", size);
dress();
connect();
requestAnimationFrame(tick);
