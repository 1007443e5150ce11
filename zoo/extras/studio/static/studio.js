// The studio's rooms. Each form is a step; the server checks its fields and returns its command line.

import { post } from "./command.js";
import { HandView, follow, shown } from "./hand.js";

const POLL_MS = 700;
const $ = (selector, root = document) => root.querySelector(selector);
const all = (selector, root = document) => [...root.querySelectorAll(selector)];
const rooms = all("main > section");
const forms = Object.fromEntries(all("form").map((form) => [form.dataset.step, form]));
const address = (path) => `${path}${location.search}`;
let choices = null;
let hand = null;
let state = {};

function notify(error) {
  $("#message").textContent = error instanceof TypeError ? "The studio does not answer" : error.message;
  $("#message").hidden = false;
  clearTimeout(notify.ends);
  notify.ends = setTimeout(() => ($("#message").hidden = true), 10000);
}
addEventListener("click", () => ($("#message").hidden = true)); // it was about the step before

async function read(path) {
  const response = await fetch(address(path), { cache: "no-store" });
  const answer = await response.json();
  if (!response.ok) throw new Error(answer.error);
  return answer;
}

const text = (element, value) => element.textContent !== value && (element.textContent = value);

// --- rooms ---

function showRoom() {
  const name = rooms.some((room) => `#${room.id}` === location.hash) ? location.hash.slice(1) : "drive";
  for (const room of rooms) room.hidden = room.id !== name;
  for (const link of all("nav a")) {
    if (link.hash === `#${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  loadChoices().catch(notify);
}

function go(room, folder) {
  if (folder) {
    for (const step of ["check", "train"]) forms[step].elements.folder.value = folder;
    for (const step of ["check", "train"]) showLine(forms[step]);
  }
  location.hash = room;
}

// --- forms ---

function fill(select, groups, first, none) {
  const before = select.value;
  select.replaceChildren(...(none === undefined ? [] : [new Option(none, "")]));
  for (const [name, values] of Object.entries(groups)) {
    const options = values.map((value) => new Option(value, value));
    if (!name) select.append(...options);
    else if (options.length) {
      const group = document.createElement("optgroup");
      group.label = name;
      group.append(...options);
      select.append(group);
    }
  }
  for (const value of [first, before]) if (all("option", select).some((option) => option.value === value)) select.value = value;
}

async function loadChoices() {
  choices = await read("choices.json");
  for (const select of all("[data-choices]")) fill(select, { "": choices[select.dataset.choices] }, select.dataset.first);
  for (const select of all("[data-networks]")) fill(select, choices.networks, undefined, select.dataset.networks || undefined);
  $("#folders").replaceChildren(...choices.recordings.map((folder) => new Option(folder, folder)));
  $("#list").replaceChildren(...choices.recordings.map((folder) => {
    const entry = document.createElement("li");
    const button = entry.appendChild(document.createElement("button"));
    button.type = "button";
    button.textContent = folder;
    button.onclick = () => {
      go("recordings", folder);
      start(forms.check);
    };
    return entry;
  }));
  $("#none").hidden = choices.recordings.length > 0;
  if (!$("#augmentations").children.length) {
    for (const name of choices.augmentations) {
      const label = document.createElement("label");
      label.className = "check";
      const box = Object.assign(document.createElement("input"), { type: "checkbox", name: "augment", value: name, disabled: true });
      label.append(box, ` ${name}`);
      $("#augmentations").append(label);
    }
  }
  for (const form of Object.values(forms)) showLine(form);
}

function fields(form, step = form.dataset.step) {
  const command = { step };
  for (const { name, type, value, checked } of form.elements) {
    if (!name || name === "own" || name === "augment") continue;
    if (type === "checkbox") command[name] = checked;
    else if (type === "number") command[name] = Number(value) || 1;
    else if (value.trim()) command[name] = value.trim();
  }
  if (form.elements.own && !form.elements.own.checked) command.augment = all("[name=augment]:checked", form).map((box) => box.value);
  return command;
}

async function showLine(form) {
  const line = $(".line pre", form);
  try {
    text(line, form.checkValidity() ? (await post({ line: fields(form) })).join("\n") : "");
  } catch {
    text(line, ""); // a half-typed folder; starting the step shows what is wrong
  }
}

async function start(form, step) {
  try {
    show(await post({ start: fields(form, step) }));
    return true;
  } catch (error) {
    notify(error);
    return false;
  }
}

for (const form of Object.values(forms)) {
  form.oninput = () => showLine(form);
  form.onsubmit = (event) => {
    event.preventDefault();
    if (form === forms.train) $("#pictures").hidden = true; // the training takes its place
    start(form);
  };
  const copy = $(".line button", form);
  copy.onclick = async () => {
    await navigator.clipboard?.writeText($(".line pre", form).textContent).then(() => text(copy, "Copied"), () => {});
    setTimeout(() => text(copy, "Copy"), 1500);
  };
}
for (const button of all("[data-stop]")) button.onclick = () => post({ stop: button.dataset.stop }).then(show, notify);
for (const button of all("[data-go]")) {
  button.onclick = () => {
    const room = button.dataset.go;
    const folder = button.closest("#driven") ? state.drive.folder : forms.check.elements.folder.value;
    go(room, folder);
    if (room === "recordings") start(forms.check);
  };
}
$("#edit").onclick = () => forms.check.reportValidity() && start(forms.check, "edit");
$("#preview").onclick = () => preview();
$("#resume").onclick = () => post({ start: { step: "train", resume: state.training.run } }).then(show, notify);
$("#watch-it").onclick = async () => {
  const run = state.training.run;
  location.hash = "watch";
  await loadChoices();
  forms.watch.elements.first.value = run;
  showLine(forms.watch);
};
forms.train.elements.own.onchange = () => {
  for (const box of all("[name=augment]")) box.disabled = forms.train.elements.own.checked;
};
$("#augmentations").onchange = preview;

let previewed = "";
async function preview() {
  const asked = fields(forms.train, "preview");
  const { seeds, quick, ...wanted } = asked;
  $("#pictures").hidden = false;
  previewed = "";
  await post({ start: wanted }).then(show, notify);
}

$("#upload").onchange = async () => {
  const [file] = $("#upload").files;
  if (!file) return;
  const query = new URLSearchParams(location.search);
  query.set("name", file.name);
  text($("#uploading"), `Reading ${file.name}`);
  try {
    const response = await fetch(`upload?${query}`, { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file });
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.error);
    await loadChoices();
    forms.watch.elements.first.value = answer.network;
    showLine(forms.watch);
  } catch (error) {
    notify(error);
  }
  $("#upload").value = "";
  text($("#uploading"), "");
};

// --- what runs ---

function show(next) {
  state = next;
  showDrive();
  for (const panel of all("[data-child]")) {
    const child = state[panel.dataset.child];
    panel.hidden = !child;
    if (child) showLines($("pre.lines", panel), child.lines, child.status === null);
  }
  showEditor();
  showPreview();
  showTraining();
  showWatched();
  $("#ranking").hidden = state.rank?.status !== 0;
  $("#ranking").href = address("ranking");
}

function showLines(element, lines, runs) {
  const value = lines.join("\n") || (runs ? "…" : "");
  if (element.textContent === value) return;
  element.textContent = value;
  if (runs) element.scrollTop = element.scrollHeight;
}

function showDrive() {
  const { running, lines, line, folder } = state.drive;
  if (running && hand === null) hand = new HandView($("#hand"));
  if (running && $("#hand").hidden) {
    $("#hand").hidden = false;
    hand.begin();
  }
  $("#hand").hidden = !running;
  $("button.primary", forms.drive).disabled = running;
  $("#driven").hidden = running || !lines;
  if (lines) showLines($("#driven pre"), [line, "", ...lines], false);
  $("#driven .controls").hidden = !folder;
}

function showEditor() {
  const child = state.edit;
  const found = child?.lines.join("\n").match(/http:\/\/127\.0\.0\.1:\d+/);
  const panel = $("#editor");
  panel.hidden = !child;
  if (!child) return;
  if (found && child.status === null) {
    if ($("a", panel)?.href.startsWith(found[0])) return;
    const link = Object.assign(document.createElement("a"), { href: found[0], target: "_blank", textContent: "Open the editor" });
    panel.replaceChildren(link, ` (on the studio's machine: ${child.line})`);
  } else text(panel, child.status === null ? "The editor starts" : child.lines.at(-1) ?? "The editor has ended");
}

function showPreview() {
  const child = state.preview;
  if (!child) return;
  const failed = child.status !== null && child.status !== 0;
  text($("#pictures p"), child.status === null ? `Drawing: ${child.line}` : failed ? child.lines.at(-1) ?? "It failed" : child.line);
  if (child.status === 0 && previewed !== child.line) {
    previewed = child.line;
    $("#pictures img").src = `${address("preview.png")}${location.search ? "&" : "?"}at=${Date.now()}`;
    $("#pictures img").hidden = false;
    $("#pictures").hidden = false;
  }
}

function showTraining() {
  const { train: child, training } = state;
  if (!child) return;
  const runs = child.status === null;
  $("[data-stop=train]").disabled = !runs;
  $("button.primary", forms.train).disabled = runs;
  $("#resume").hidden = runs || !training.run || child.status === 0;
  text($("#training-status"), runs ? `Training: ${child.line}` : `${child.status === 0 ? "Trained" : "Ended"}: ${child.line}`);
  const panel = $('[data-child="train"]');
  $("progress", panel).value = training.epochs ? training.epoch / training.epochs : 0;
  const fact = (name, value) => text($(`[data-fact="${name}"]`, panel), value);
  fact("epoch", training.epochs ? `${shown(training.epoch)} of ${shown(training.epochs)}` : "–");
  fact("loss", shown(training.loss, 4));
  fact("rate", shown(training.rate));
  fact("left", !runs || training.left_s == null ? "–" : training.left_s > 90 ? `${shown(training.left_s / 60)} min` : `${shown(training.left_s)} s`);
  const { verdict } = training;
  const box = $("#verdict");
  box.hidden = !verdict;
  if (verdict && box.dataset.run !== training.run) {
    box.className = `panel verdict stack ${verdict.level}`;
    const lines = [verdict.headline, ...(verdict.tracks ?? []), verdict.certainty, ...(verdict.causes ?? [])].filter(Boolean);
    box.replaceChildren(...lines.map((line, at) => Object.assign(document.createElement(at ? "p" : "h2"), { textContent: line })));
  }
  box.dataset.run = verdict ? training.run : "";
  const film = $("#film");
  film.hidden = runs || !training.film;
  if (!film.hidden && film.dataset.run !== training.run) {
    film.dataset.run = training.run;
    film.src = `${address("film.mp4")}${location.search ? "&" : "?"}run=${encodeURIComponent(training.run)}`;
  }
  $("#report").hidden = runs || !training.report;
  $("#report").href = address("report");
  $("#watch-it").hidden = runs || !training.drives;
}

const sides = []; // of the networks that drive
function showWatched() {
  const { watch } = state;
  while (sides.length < watch.length) sides.push(makeSide(sides.length));
  $("#difference").hidden = watch.length < 2;
  $("[data-stop=watch]").disabled = !watch.some((network) => network.running);
  watch.forEach((network, at) => {
    const { panel } = sides[at];
    text($("h2", panel), network.name);
    text($(".failure", panel), network.failure);
    text($(".state", panel), network.failure ? "" : !network.running ? "Ended" : network.loading ? "Loading" : "");
  });
  sides.forEach(({ panel }, at) => (panel.hidden = at >= watch.length));
}

function makeSide(at) {
  const panel = document.createElement("article");
  panel.className = "panel stack";
  panel.innerHTML = `<h2></h2><p class="failure" role="alert"></p><p class="soft state" role="status"></p><canvas width="320" height="160" role="img" aria-label="What the network sees"></canvas>
    <div class="wheel" aria-hidden="true"><i></i></div>
    <dl class="facts"><div><dt>Interventions</dt><dd data-fact="interventions">–</dd></div><div><dt>Autonomy</dt><dd data-fact="autonomy">–</dd></div>
    <div><dt>From the middle</dt><dd data-fact="cross">–</dd></div><div><dt>Wheel</dt><dd data-fact="steering">–</dd></div><div hidden><dt>Recorded wheel</dt><dd data-fact="recorded">–</dd></div>
    <div><dt>Speed</dt><dd data-fact="speed">–</dd></div><div><dt>Time</dt><dd data-fact="time">–</dd></div></dl>`;
  $("#sides").append(panel);
  const side = { panel, last: null };
  const fact = (name, value) => text($(`[data-fact="${name}"]`, panel), value);
  follow("watch", $("canvas", panel), (frame) => {
    if (frame === null) return;
    side.last = frame;
    const cross = frame.cross_track_m;
    fact("interventions", shown(frame.interventions));
    fact("autonomy", frame.autonomy === null ? "–" : `${shown(100 * frame.autonomy, 1)} %`);
    fact("cross", cross === null ? "–" : `${shown(Math.abs(cross), 2)} m ${cross > 0 ? "right" : "left"}`);
    fact("steering", shown(frame.steering, 2));
    $('[data-fact="recorded"]', panel).parentElement.hidden = frame.expert_steering === null;
    fact("recorded", shown(frame.expert_steering, 2));
    fact("speed", `${shown(frame.speed_mph, 1)} mph`);
    fact("time", `${shown(frame.time_s, 1)} s`);
    $(".wheel i", panel).style.transform = `scaleX(${frame.steering})`;
    if (sides.length > 1 && sides[0].last && sides[1].last) text($("#difference b"), shown(sides[0].last.steering - sides[1].last.steering, 2));
  }, () => false, { side: at });
  return side;
}

addEventListener("hashchange", showRoom);
showRoom();
for (;;) {
  if (!document.hidden) await read("state.json").then(show, notify);
  await new Promise((done) => setTimeout(done, POLL_MS));
}
