// Polls the state of the drive. The next state is requested once the last one is shown, so that it
// is always the latest.

import { post } from "./command.js";

const POLL_MS = 100; // before the first answer; the driver sends a longer interval for many pages
const SALIENCY_MS = 500;
const HIDDEN_MS = 1000; // between polls while the page is hidden
const SILENT_S = 1.5; // without telemetry, after which the status warns
const LOST_S = 3; // that the status shows an intervention after which the car was put back at once
const CHART_S = 30;
const WAY_M = 3, JUMP_M = 50, MOST_WAY = 3000; // metres between points of the map, and its points
const USUAL_DEG = 25; // of the drawn front wheels at a steering of 1, if the car is unknown
const BAND = 1.96; // spreads on each side that hold 95 % of a normal distribution
const WHEEL_RATIO = 6; // angle of the drawn steering wheel per angle of the front wheels

const $ = (id) => document.getElementById(id);
const dash = "–";
let state = null;
let looking = false;
let shownFrame = -1;
let movedAt = 0; // state.time_s of the last telemetry
let lostAt = -Infinity; // state.time_s of the last intervention that the driver counted
let lostWords = "";
const counts = []; // [time_s, telemetry] of the last 2 s
const trace = []; // [time_s, steering or null, half the width of its band]

async function get(path) {
  const response = await fetch(path, { cache: "no-store", signal: AbortSignal.timeout(5000) });
  if (!response.ok) throw new Error((await response.json()).error);
  return response;
}

async function send(command) {
  try {
    show(await post(command));
    return true;
  } catch (error) {
    notify(error instanceof TypeError ? "The driver does not answer" : error.message, true);
    return false;
  }
}

// --- display ---

function number(value, digits, sign = false) {
  if (value === null || value === undefined) return dash;
  const text = Math.abs(value).toFixed(digits);
  const zero = Number(text) === 0;
  return (value < 0 && !zero ? "−" : sign && !zero ? "+" : "") + text;
}

// Degrees of the front wheels; of an unknown car the share of its full steering.
function angle(steering, digits, sign = false) {
  const degrees = state.steering_deg;
  if (degrees === null) return `${number(100 * steering, 0, sign)} %`;
  return `${number(steering * degrees, digits, sign)}°`;
}

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

function show(next) {
  if (state === null || next.telemetry !== state.telemetry) movedAt = next.time_s;
  noteLost(next);
  state = next;
  const { steering, spread, throttle, speed_mph: speed, cross_track_m: offset } = state;
  const band = spread === null ? 0 : BAND * spread;
  note(state.time_s, state.telemetry, steering, band);
  text("angle", steering === null ? dash : angle(steering, 1, true));
  text("band", spread === null ? "" : `± ${angle(band, 1)}`);
  text("strip-name", spread === null ? "Steering" : "Steering with its 95 % band");
  $("wheel").style.transform = `rotate(${(steering ?? 0) * (state.steering_deg ?? USUAL_DEG) * WHEEL_RATIO}deg)`;
  text("speed-value", number(speed, 1));
  text("pedal-name", throttle < 0 ? "Brake" : "Throttle");
  text("pedal-value", throttle === null ? dash : number(Math.abs(throttle), 2));
  $("throttle").style.transform = `scaleX(${Math.max(throttle ?? 0, 0)})`;
  $("brake").style.transform = `scaleX(${Math.max(-(throttle ?? 0), 0)})`;
  text("offset-value", offset === null ? dash : offsetWords(offset));
  $("offset-value").className = state.lost === "off_road" ? "bad" : "";
  showAutonomy();
  showPlace();
  text("clients", String(state.clients));
  text("rate", rate());
  text("p50", number(state.latency_p50_ms, 1));
  text("p99", number(state.latency_p99_ms, 1));
  showStatus();
  showControls();
  drawChart();
}

function showAutonomy() {
  const unknown = state.autonomy === null;
  const words = state.telemetry === 0 ? dash : "not measured";
  text("autonomy", unknown ? words : `${number(100 * state.autonomy, 1)} %`);
  $("autonomy").className = unknown && state.telemetry > 0 ? "words" : "";
  $("autonomy").title = unknown
    ? "This simulator sends no cross-track error, and nobody has taken over"
    : "1 − 6 s × interventions / time driven";
  text("interventions", String(state.interventions));
  const lost = state.off_road + state.standstills;
  $("interventions").className = lost > 0 ? "bad" : "";
  $("interventions").title =
    `${state.off_road} off the road, ${state.standstills} standing still, ` +
    `${state.takeovers} taken over by hand`;
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// The way that was driven since the page was opened, the lap and the time of driving.
const way = []; // [x, y], m
function showPlace() {
  const { lap, xy, driven_s: seconds } = state;
  const [minutes, rest] = [Math.floor(seconds / 60), Math.floor(seconds % 60)];
  $("map").hidden = state.telemetry === 0;
  $("way").hidden = xy === null;
  text("place", `${lap === null ? "" : `Lap ${lap} · `}${minutes}:${String(rest).padStart(2, "0")}`);
  if (xy === null) return;
  const moved = way.length ? Math.hypot(xy[0] - way.at(-1)[0], xy[1] - way.at(-1)[1]) : Infinity;
  if (moved > JUMP_M) way.length = 0; // another car or track
  if (moved > WAY_M) way.push(xy);
  if (way.length > MOST_WAY) way.shift();
  const { width, height } = $("way");
  const pen = $("way").getContext("2d");
  const bounds = [0, 1].map((axis) => [Math.min, Math.max].map((end) => end(...way.map((one) => one[axis]))));
  const scale = Math.min(...bounds.map(([low, high], axis) => ([width, height][axis] - 24) / Math.max(high - low, 40)));
  const centre = bounds.map(([low, high]) => (low + high) / 2);
  const at = ([x, y]) => [width / 2 + (x - centre[0]) * scale, height / 2 - (y - centre[1]) * scale];
  pen.clearRect(0, 0, width, height);
  pen.strokeStyle = colour("--text");
  pen.lineWidth = 4;
  pen.lineJoin = "round";
  pen.beginPath();
  for (const one of way) pen.lineTo(...at(one));
  pen.stroke();
  pen.fillStyle = colour("--accent");
  pen.beginPath();
  pen.arc(...at(xy), 9, 0, 7);
  pen.fill();
}

function noteLost(next) {
  if (state === null) return;
  const left = next.off_road > state.off_road;
  if (!left && next.standstills === state.standstills) return;
  lostAt = next.time_s;
  lostWords = (left ? "Left the road" : "Stood still") + (next.put_back ? ", put back" : "");
}

function lostNow() {
  const { lost, cross_track_m: offset } = state;
  if (state.put_back && state.time_s - lostAt < LOST_S) return lostWords;
  if (lost === "standstill") return "Standing still";
  if (lost === null) return null;
  return offset === null ? "Off the road" : `Off the road, ${offsetWords(offset)}`;
}

function offsetWords(offset) {
  return `${number(Math.abs(offset), 2)} m ${offset > 0 ? "right" : "left"}`;
}

function showStatus() {
  const lost = lostNow();
  const silent = state.time_s - movedAt > SILENT_S;
  const [kind, words] =
    state.clients === 0 ? ["", "Waiting for a simulator"]
    : silent ? ["warn", "No telemetry"]
    : state.overridden ? ["warn", "A person drives"]
    : lost !== null ? ["bad", lost]
    : state.paused ? ["warn", "Paused"]
    : ["good", "Driving"];
  $("status").className = kind;
  text("status-text", words);
}

function showControls() {
  press("pause", state.paused);
  text("pause", state.paused ? "Resume" : "Pause");
  press("record", state.recording);
  const rows = state.recorded.toLocaleString("en");
  text("record-text", state.recording ? `Recording ${rows}` : "Record");
  $("record").title = `To ${state.folder}`;
  const fixed = state.set_mph === null;
  for (const id of ["slower", "faster", "set-mph"]) $(id).disabled = fixed;
  $("set-speed").title = fixed ? "This drive holds no speed; restart with drive.speed=pi" : "Set speed";
  if (document.activeElement !== $("set-mph")) $("set-mph").value = state.set_mph ?? "";
  text("checkpoint-name", state.loading ? `loading ${shortName(state.loading)}` : shortName(state.checkpoint));
  $("checkpoint").title = state.checkpoint;
  $("checkpoint").disabled = Boolean(state.loading);
  const troubles = Object.entries(state.troubles).map(([kind, count]) => `${kind} (${count}×)`);
  text("troubles", troubles.slice(-2).join(" · "));
}

function press(id, pressed) {
  $(id).setAttribute("aria-pressed", String(pressed));
}

function shortName(path) {
  // Keep the run's folder, since all checkpoints are called best or last.
  const parts = path.split(/[\\/]/).filter((part) => part !== "checkpoints" && part !== "outputs");
  return parts.slice(-3).join(" / ") || "no checkpoint";
}

function note(time, telemetry, steering, band) {
  const moves = state.clients > 0 && time - movedAt < SILENT_S && !state.overridden;
  trace.push([time, moves ? steering : null, band]);
  while (trace[0][0] < time - CHART_S) trace.shift();
  counts.push([time, telemetry]);
  while (counts[0][0] < time - 2) counts.shift();
}

function rate() {
  const [first, last] = [counts[0], counts[counts.length - 1]];
  const elapsed = last[0] - first[0];
  return elapsed > 0.5 ? ((last[1] - first[1]) / elapsed).toFixed(0) : dash;
}

function drawChart() {
  const canvas = $("chart");
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  const most = Math.max(...trace.map(([, steering, band]) => Math.abs(steering ?? 0) + band));
  const range = [0.2, 0.4, 0.6, 0.8, 1].find((one) => most <= one * 0.95) ?? 1;
  const [top, bottom] = [40, height - 16]; // below the heading
  const middle = (top + bottom) / 2;
  const y = (steering) => middle + (steering / range) * (bottom - middle); // right is down
  const right = width - 80;
  const x = (time) => right * (1 - (state.time_s - time) / CHART_S);
  pen.strokeStyle = colour("--line");
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (const level of [-range, 0, range]) {
    pen.moveTo(0, y(level));
    pen.lineTo(right, y(level));
  }
  pen.stroke();
  pen.font = `15px ${getComputedStyle(document.body).fontFamily}`;
  pen.fillStyle = colour("--soft");
  pen.textBaseline = "middle";
  pen.fillText(`${angle(range, 0)} left`, right + 12, y(-range));
  pen.fillText(angle(0, 0), right + 12, middle);
  pen.fillText(`${angle(range, 0)} right`, right + 12, y(range));
  pen.strokeStyle = pen.fillStyle = colour("--accent");
  drawBand(pen, x, (steering) => y(Math.min(Math.max(steering, -range), range)));
  pen.lineWidth = 3;
  pen.lineJoin = pen.lineCap = "round";
  pen.beginPath();
  let drawn = false;
  for (const [time, steering] of trace) {
    if (steering !== null) pen[drawn ? "lineTo" : "moveTo"](x(time), y(steering));
    drawn = steering !== null;
  }
  pen.stroke();
  if (drawn) {
    pen.beginPath();
    pen.arc(right, y(trace[trace.length - 1][1]), 5, 0, 7);
    pen.fill();
  }
}

function drawBand(pen, x, y) {
  const sides = []; // [time_s, upper end, lower end]
  pen.globalAlpha = 0.3;
  for (const [time, steering, band] of [...trace, [0, null, 0]]) {
    if (steering !== null && band > 0) {
      sides.push([time, steering - band, steering + band]);
    } else if (sides.length) {
      pen.beginPath();
      for (const [at, upper] of sides) pen.lineTo(x(at), y(upper));
      for (const [at, , lower] of sides.reverse()) pen.lineTo(x(at), y(lower));
      pen.fill();
      sides.length = 0;
    }
  }
  pen.globalAlpha = 1;
}

let messageEnds = 0;
function notify(line, bad = false) {
  text("message-text", line);
  $("message").className = bad ? "bad" : "";
  $("message").hidden = false;
  clearTimeout(messageEnds);
  messageEnds = setTimeout(() => ($("message").hidden = true), bad ? 15000 : 4000);
}

// --- polling ---

async function repeat(periodMs, task) {
  for (;;) {
    const began = performance.now();
    try {
      await task();
    } catch {
      await pause(500); // the next poll of the state shows the error
    }
    const rest = document.hidden ? HIDDEN_MS : periodMs() - (performance.now() - began);
    await pause(Math.max(rest, 10));
  }
}

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function pollState() {
  try {
    show(await (await get("state.json")).json());
  } catch (error) {
    $("status").className = "bad";
    text("status-text", "The driver does not answer");
    throw error;
  }
}

async function pollFrame() {
  if (document.hidden || !state?.has_frame || state.telemetry === shownFrame) return;
  const n = state.telemetry;
  await load($("frame"), await getBlob(`frame.jpg?n=${n}`));
  shownFrame = n;
  $("no-frame").hidden = true;
}

async function pollSaliency() {
  if (!looking || document.hidden || !state?.has_frame) return;
  let blob;
  try {
    blob = await getBlob(`saliency.jpg?n=${state.telemetry}`);
  } catch (error) {
    if (looking) notify(error.message, true);
    look(false);
    return;
  }
  await load($("saliency"), blob);
  $("saliency").hidden = !looking;
  $("camera").classList.toggle("looking", looking);
}

// An image whose address cannot be fetched would replace the last one by a broken icon.
const getBlob = async (path) => (await get(path)).blob();

async function load(image, blob) {
  const url = URL.createObjectURL(blob);
  await new Promise((done, fail) => {
    image.onload = done;
    image.onerror = fail;
    image.src = url;
  });
  URL.revokeObjectURL(url);
  image.hidden = false;
}

// --- buttons ---

function look(on) {
  looking = on;
  press("look", on);
  if (!on) {
    $("saliency").hidden = true;
    $("camera").classList.remove("looking");
  }
}

function setSpeed(mph) {
  send({ set_mph: Math.min(Math.max(mph, 0), 100) });
}

async function switchTo(path) {
  $("switch").close();
  if (await send({ switch: path })) notify(`Driving with ${shortName(path)}`);
}

async function openSwitch() {
  $("path").value = "";
  $("list").replaceChildren();
  $("switch").showModal();
  const paths = await (await get("checkpoints.json")).json();
  for (const path of paths) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = shortName(path);
    button.title = path;
    button.onclick = () => switchTo(path);
    $("list").append(document.createElement("li"));
    $("list").lastChild.append(button);
  }
}

$("pause").onclick = () => send({ pause: !state.paused });
$("record").onclick = () => send({ record: !state.recording });
$("slower").onclick = () => setSpeed(Math.ceil(state.set_mph) - 1);
$("faster").onclick = () => setSpeed(Math.floor(state.set_mph) + 1);
$("set-mph").onchange = () => $("set-mph").value !== "" && setSpeed(Number($("set-mph").value));
$("look").onclick = () => look(!looking);
$("checkpoint").onclick = openSwitch;
$("close").onclick = () => $("switch").close();
$("dismiss").onclick = () => ($("message").hidden = true);
$("switch-form").onsubmit = (event) => {
  event.preventDefault();
  if ($("path").value.trim()) switchTo($("path").value.trim());
};

const pollMs = () => state?.poll_ms ?? POLL_MS;
repeat(pollMs, pollState);
repeat(pollMs, pollFrame);
repeat(() => Math.max(SALIENCY_MS, pollMs()), pollSaliency);
