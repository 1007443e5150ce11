// Shows a recording and sends edits. The server keeps the edits, so that a reload loses none.

import { post } from "./command.js";
import { Timeline } from "./timeline.js";

const POLL_MS = 700; // while frames are analysed or a recording is written
const NOTABLE_EVERY_MS = 3000;
const STEP = 10; // rows of Shift and an arrow key
const KINDS = {
  bends: ["Bends", (value) => signed(value, 2)],
  jumps: ["Steering jumps", (value) => signed(value, 2)],
  frames: ["Odd frames", (value) => (value === null ? "bad" : `${value.toFixed(1)}×`)],
  standstills: ["Standstills", (value) => `${value} rows`],
  errors: ["Largest errors", (value) => signed(value, 2)],
};
const CAMERAS = ["center", "left", "right"];

const $ = (id) => document.getElementById(id);
const dash = "–";
const timeline = new Timeline($("detail"), $("overview"), go, select);
let about = null;
let data = null;
let edits = null;
let row = 0;
let selection = null;
let notable = {};
let kind = "bends";
let playing = false;

async function get(path) {
  const response = await fetch(path, { cache: "no-store" });
  if (!response.ok) throw new Error((await response.json()).error);
  return response;
}

// Commands wait for each other: each says which edits this page shows, and the server refuses it
// if another page has changed them.
let sending = Promise.resolve();
const send = (command) => (sending = sending.then(() => sendNow(command)));

async function sendNow(command) {
  try {
    show(await post(command, `?shown=${edits.session}.${edits.changes}`));
    return true;
  } catch (error) {
    if (error.status === 409) show(await (await get("state.json")).json());
    notify(error instanceof TypeError ? "The page's server does not answer" : error.message);
    return false;
  }
}

// --- display ---

function signed(value, digits) {
  const text = Math.abs(value).toFixed(digits);
  return (value < 0 ? "−" : value > 0 ? "+" : "") + text;
}

const count = (number) => number.toLocaleString("en");
const inside = (stretches, at) => stretches.some(([first, end]) => first <= at && at < end);

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

function show(state) {
  if (edits !== null && state.session !== edits.session) location.reload(); // another recording's
  const ended = edits !== null && state.finished > edits.finished;
  edits = state;
  timeline.edits = state;
  showMirrored(state.mirrored);
  const kept = state.parts.reduce((sum, one) => sum + one, 0);
  const parts = state.parts.length > 1 ? ` · ${state.parts.length} parts` : "";
  text("kept", kept === about.rows ? `${count(kept)} rows${parts}` : `${count(kept)} of ${count(about.rows)} rows${parts}`);
  $("kept").className = "";
  $("undo").disabled = state.undo === 0;
  $("redo").disabled = state.redo === 0;
  $("write").disabled = kept === 0;
  showWriting(kept);
  if (ended) showWritten(state);
  showRow();
}

// The timeline shows the steering as it will be written.
let drawn = "";
function showMirrored(stretches) {
  const key = JSON.stringify([stretches, edits.dropped, edits.splits, data.known]);
  if (key === drawn) return;
  drawn = key;
  for (const name of ["steering", "predicted"]) {
    if (!data[name]) continue;
    timeline.data[name].set(data[name]);
    for (const [first, end] of stretches) {
      for (let at = first; at < end; at += 1) timeline.data[name][at] *= -1;
    }
  }
  timeline.redrawAll();
}

function showRow() {
  const mirrored = inside(edits.mirrored, row);
  const steering = timeline.data.steering[row];
  const predicted = data.predicted ? timeline.data.predicted[row] : NaN;
  if (document.activeElement !== $("row")) $("row").value = row + 1;
  text("time", about.times ? clock(data.time[row]) : dash);
  text("steering", signed(steering, 3));
  text("predicted", Number.isNaN(predicted) ? dash : signed(predicted, 3));
  text("speed", Number.isNaN(data.speed[row]) ? dash : data.speed[row].toFixed(1));
  $("recorded-mark").style.left = `${50 + 50 * steering}%`;
  $("predicted-mark").style.left = `${50 + 50 * predicted}%`;
  $("predicted-mark").hidden = Number.isNaN(predicted);
  $("cameras").classList.toggle("mirrored", mirrored);
  $("cameras").classList.toggle("dropped", inside(edits.dropped, row));
  showSelection();
}

function showSelection() {
  const on = selection !== null;
  const [first, end] = selection ?? [row, row + 1];
  text("selected", on ? `rows ${count(first + 1)} to ${count(end)} (${count(end - first)})` : "Drag over the timeline to select rows");
  $("selected").className = on ? "on" : "";
  for (const button of document.querySelectorAll("[data-edit]")) button.disabled = !on;
  $("merge").disabled = !(on && edits.splits.some((one) => first <= one && one < end));
  $("split").disabled = row === 0 || edits.splits.includes(row);
}

function clock(seconds) {
  if (Number.isNaN(seconds)) return dash;
  const tenths = Math.round(Math.abs(seconds) * 10);
  const minutes = Math.floor(tenths / 600);
  return `${seconds < 0 ? "−" : ""}${minutes}:${(tenths / 10 - 60 * minutes).toFixed(1).padStart(4, "0")}`;
}

function showWriting(kept) {
  const busy = edits.writing !== null;
  text("confirm-text", `${count(kept)} rows${edits.parts.length > 1 ? ` in ${edits.parts.length} folders` : ""}`);
  if (!$("written").hidden && !busy) return;
  text("out", edits.out);
  $("progress").hidden = !busy;
  $("progress").value = edits.writing ?? 0;
  $("confirm-write").disabled = busy;
  if (busy) poll();
}

let messageEnds = 0;
function notify(line) {
  text("message-text", line);
  $("message").hidden = false;
  clearTimeout(messageEnds);
  messageEnds = setTimeout(() => ($("message").hidden = true), 12000);
}

// --- rows and images ---

function go(to) {
  row = Math.min(Math.max(Math.round(to), 0), about.rows - 1);
  timeline.row = row;
  timeline.reveal(row);
  timeline.draw();
  showRow();
  loadImages();
  markCurrent();
}

function select(stretch) {
  selection = stretch;
  timeline.selection = stretch;
  timeline.draw();
  if (edits) showSelection();
}

let loading = false;
async function loadImages() {
  if (loading) return; // the latest row is loaded next
  loading = true;
  let shown = -1;
  while (shown !== row) {
    shown = row;
    const swapped = inside(edits.mirrored, row) ? [0, 2, 1] : [0, 1, 2];
    await Promise.all(CAMERAS.map((name, place) => about.cameras[place] && loadImage(name, shown, swapped[place])));
    if (!playing && shown === row) await describe(shown);
  }
  loading = false;
}

function loadImage(name, at, camera) {
  const image = $(name).querySelector("img");
  return new Promise((done) => {
    image.onload = () => done((image.hidden = false));
    image.onerror = async () => {
      image.hidden = true;
      const { status } = await fetch(image.src).catch(() => ({}));
      $(name).querySelector("p").textContent =
        status === 404 ? "This camera has no image in this row"
        : status === undefined ? "The page's server does not answer"
        : "This image cannot be read; drop the row";
      done();
    };
    image.src = `image?row=${at}&camera=${camera}`;
  });
}

async function describe(at) {
  try {
    const found = await (await get(`row.json?row=${at}`)).json();
    if (at !== row) return;
    text("pedal-name", found.brake > 0 ? "Brake" : "Throttle");
    text("pedal", (found.brake > 0 ? found.brake : found.throttle).toFixed(2));
    text("place", `\u200e${found.place}`);
    $("place").title = `${found.place}, ${found.image}`;
  } catch {
    text("place", dash);
  }
}

// --- playback ---

function play(on) {
  playing = on && about.rows > 1;
  text("play", playing ? "Pause" : "Play");
  $("play").setAttribute("aria-pressed", String(playing));
  if (!playing) return loadImages();
  let last = performance.now();
  let owed = 0; // rows
  const step = (now) => {
    if (!playing) return;
    owed += ((now - last) / 1000) * about.rows_per_second * Number($("rate").value);
    last = now;
    let to = row;
    for (; owed >= 1 && to < about.rows - 1; owed -= 1) to = nextKept(to);
    if (to !== row) go(to);
    if (row >= about.rows - 1) play(false);
    else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function nextKept(from) {
  const to = from + 1;
  const dropped = edits.dropped.find(([first, end]) => first <= to && to < end);
  return Math.min(dropped ? dropped[1] : to, about.rows - 1);
}

// --- rows worth a look ---

function showKinds() {
  $("kinds").replaceChildren(
    ...Object.keys(notable).map((name) => {
      const button = document.createElement("button");
      button.role = "tab";
      button.textContent = KINDS[name][0];
      button.dataset.kind = name;
      button.setAttribute("aria-selected", String(name === kind));
      button.onclick = () => {
        kind = name;
        showKinds();
        showNotable();
      };
      return button;
    }),
  );
}

let listed = "";
function showNotable() {
  const found = notable[kind] ?? [];
  const key = JSON.stringify([kind, found]);
  if (key === listed) return;
  listed = key;
  const items = found.map(([at, value], number) => {
    const button = document.createElement("button");
    const image = new Image();
    image.loading = "lazy";
    image.alt = "";
    image.src = `image?row=${at}&camera=0`;
    const caption = document.createElement("span");
    const words = document.createElement("small");
    words.textContent = KINDS[kind][1](value);
    caption.append(count(at + 1), words);
    button.append(image, caption);
    button.dataset.row = at;
    button.title = `Row ${count(at + 1)}`;
    button.setAttribute("aria-label", `${number + 1}. row ${at + 1}, ${words.textContent}`);
    button.onclick = () => jump(at);
    const item = document.createElement("li");
    item.append(button);
    return item;
  });
  const none = document.createElement("p");
  none.textContent = "None found";
  $("rows").replaceChildren(...(items.length ? items : [none]));
  markCurrent();
}

function jump(at) {
  play(false);
  const [first, end] = timeline.view;
  timeline.look(at - (end - first) / 2, end - first);
  go(at);
}

function jumpBy(step) {
  const found = (notable[kind] ?? []).map(([at]) => at);
  const now = found.indexOf(row);
  const next = found[now < 0 ? 0 : now + step];
  if (next !== undefined) jump(next);
}

function markCurrent() {
  for (const button of $("rows").querySelectorAll("button")) {
    button.setAttribute("aria-current", String(Number(button.dataset.row) === row));
  }
}

// --- server ---

let polling = false;
let notableAt = -Infinity;
async function poll() {
  if (polling) return;
  polling = true;
  try {
    for (;;) {
      const state = await (await get("state.json")).json();
      const done = state.analysed === about.rows;
      if (data.predicted && data.known < state.analysed) await readPredicted();
      show(state);
      text("analysed", done ? "" : `${Math.floor((100 * state.analysed) / about.rows)} % of the frames analysed`);
      if (done || performance.now() - notableAt > NOTABLE_EVERY_MS) {
        notable = await (await get("notable.json")).json();
        notableAt = performance.now();
        if (!$("kinds").childElementCount) showKinds();
        showNotable();
      }
      if (done && state.writing === null) break;
      await new Promise((next) => setTimeout(next, POLL_MS));
    }
  } catch {
    text("kept", "The page's server does not answer");
    $("kept").className = "bad";
  }
  polling = false;
}

// Rows are analysed from the shown one on, so their numbers come with the values.
async function readPredicted() {
  const answer = await (await get(`predicted.bin?known=${data.known}`)).arrayBuffer();
  const values = new Float32Array(answer);
  const rows = values.length / 2;
  for (let one = 0; one < rows; one += 1) data.predicted[values[one]] = values[rows + one];
  data.known += rows; // show() draws it
}

function showWritten(state) {
  const { written, failure } = state;
  if (failure) {
    $("confirm").close();
    notify(failure);
    return;
  }
  const left = written.left_out_count ? ` Left out ${count(written.left_out_count)} rows with a bad image, the first: ${written.left_out[0]}.` : "";
  text("written", `Written: ${count(written.rows.reduce((sum, one) => sum + one, 0))} rows.${left}`);
  text("out", written.folders.join(", "));
  $("written").hidden = false;
  $("progress").hidden = true;
  $("confirm-write").hidden = true;
  text("cancel", "Close");
}

async function start() {
  const [described, columns, state] = await Promise.all([get("recording.json"), get("columns.bin"), get("state.json")]);
  about = await described.json();
  const values = new Float32Array(await columns.arrayBuffer());
  const column = (number) => values.subarray(number * about.rows, (number + 1) * about.rows);
  data = { rows: about.rows, steering: column(0), speed: column(1), time: column(2), breaks: about.breaks };
  data.known = 0;
  if (about.checkpoint) data.predicted = new Float32Array(about.rows).fill(NaN);
  for (const id of ["predicted-fact", "predicted-legend"]) $(id).hidden = !about.checkpoint;
  $("predicted-fact").title = about.checkpoint;
  text("name", about.names.join(" + "));
  $("name").title = about.names.join("\n");
  $("row").max = about.rows;
  about.cameras.forEach((has, place) => ($(CAMERAS[place]).hidden = !has));
  $("cameras").classList.toggle("one", !about.cameras[1] && !about.cameras[2]);
  timeline.show({ ...data, steering: data.steering.slice(), predicted: data.predicted?.slice() });
  show(await state.json());
  go((Number(location.hash.slice(1)) || 1) - 1); // the address may end with #ROW
  if (about.bad_images) notify(`${count(about.bad_images)} rows without an image are not shown`);
  document.documentElement.dataset.ready = performance.now().toFixed(0);
  poll();
}

// --- buttons and keys ---

const split = () => send({ split: row });
const edit = (name) => selection && send({ [name]: selection });

for (const button of document.querySelectorAll("[data-edit]")) button.onclick = () => edit(button.dataset.edit);
$("split").onclick = split;
$("undo").onclick = () => send({ undo: true });
$("redo").onclick = () => send({ redo: true });
$("play").onclick = () => play(!playing);
$("back").onclick = () => go(row - 1);
$("forth").onclick = () => go(row + 1);
$("row").onchange = () => {
  if ($("row").value !== "") jump(Number($("row").value) - 1);
  $("row").value = row + 1; // the field may hold a fraction, or nothing
};
const markFirst = () => select([row, Math.max(selection?.[1] ?? 0, row + 1)]);
const markLast = () => select([Math.min(selection?.[0] ?? row, row), row + 1]);
$("mark-first").onclick = markFirst;
$("mark-last").onclick = markLast;
$("zoom-in").onclick = () => timeline.zoom(0.5);
$("zoom-out").onclick = () => timeline.zoom(2);
$("zoom-all").onclick = () => timeline.look(0, about.rows);
$("dismiss").onclick = () => ($("message").hidden = true);
$("write").onclick = () => {
  $("written").hidden = true;
  $("confirm-write").hidden = false;
  text("cancel", "Cancel");
  text("out", edits.out);
  $("confirm").showModal();
};
$("cancel").onclick = () => $("confirm").close();
$("confirm-write").onclick = async () => {
  if (!(await send({ write: true }))) $("confirm").close();
};

const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: (event) => go(row - (event.shiftKey ? STEP : 1)),
  ArrowRight: (event) => go(row + (event.shiftKey ? STEP : 1)),
  Home: () => go(0),
  End: () => go(about.rows - 1),
  "[": markFirst,
  "]": markLast,
  Escape: () => select(null),
  d: () => edit("drop"),
  t: () => edit("trim"),
  m: () => edit("mirror"),
  r: () => edit("restore"),
  j: () => edit("merge"),
  s: split,
  n: () => jumpBy(1),
  p: () => jumpBy(-1),
  "+": () => timeline.zoom(0.5),
  "-": () => timeline.zoom(2),
  0: () => timeline.look(0, about.rows),
};
document.onkeydown = (event) => {
  if (!about || $("confirm").open || event.target.matches("input, select")) return;
  const letter = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((event.ctrlKey || event.metaKey) && letter === "z") {
    event.preventDefault();
    send(event.shiftKey ? { redo: true } : { undo: true });
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey || !KEYS[letter]) return;
  if (letter === " " && event.target.matches("button")) event.target.blur();
  event.preventDefault();
  KEYS[letter](event);
};
document.onvisibilitychange = () => about && !document.hidden && poll(); // another page may have edited
window.onresize = () => timeline.redrawAll();
matchMedia("(prefers-color-scheme: light)").onchange = () => timeline.redrawAll();
start().catch((error) => notify(error.message));
