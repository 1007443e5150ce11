"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const rows = [...document.querySelectorAll("#ranking tbody tr")];
const curveLabels = { "val/mse": "validation MSE", "train/loss": "training loss", "drive/autonomy": "autonomy by epoch", "drive/cte_mean": "cross-track error by epoch (m)" };
const tip = document.getElementById("tip");
const brushes = new Map(); // by axis number: [top, bottom] in 0..1 from the top
const last = Math.max(1, data.entries.length - 1);
const shade = (place) => `color-mix(in oklab, var(--worst) ${(100 * Math.sqrt(place / last)).toFixed(1)}%, var(--best))`;
rows.forEach((row) => row.style.setProperty("--shade", shade(+row.dataset.entry)));
// A long folder wraps; short names take no more room than they need.
const runLength = Math.max(0, ...rows.map((row) => row.cells[1].textContent.trim().length));
document.body.style.setProperty("--run-width", `${Math.min(22, runLength)}ch`);

const draw = (parent, name, attributes = {}, text = "") => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.textContent = text;
  parent.append(node);
  return node;
};
const short = (value, share, digits = 3) => (share ? `${+(100 * value).toFixed(1)} %` : `${+value.toPrecision(digits)}`);

// An axis maps an entry to 0 (top) .. 1 (bottom), or null where it has no value.
function scale(axis) {
  const raw = data.entries.map((entry) => entry.values[axis.key]).filter((value) => value != null);
  const numbers = raw.map(Number);
  if (axis.kind === "setting" && (numbers.some(Number.isNaN) || new Set(raw).size < 2)) {
    const names = [...new Set(raw)].sort();
    const at = (value) => (names.length > 1 ? names.indexOf(value) / (names.length - 1) : 0.5);
    return { at, ticks: names.map((name) => [at(name), name]) };
  }
  let [low, high] = [Math.min(...numbers), Math.max(...numbers)];
  if (axis.share) [low, high] = [Math.min(low, 0.9), 1];
  const log = low > 0 && high / low > 8 && !axis.share;
  const bend = log ? Math.log : (value) => value;
  const place = (value) => (high > low ? (bend(+value) - bend(low)) / (bend(high) - bend(low)) : 0.5);
  const at = (value) => (axis.less ? place(value) : 1 - place(value));
  const steps = axis.kind === "setting" && new Set(numbers).size < 7 ? [...new Set(numbers)]
    : [0, 0.25, 0.5, 0.75, 1].map((part) => (log ? low * (high / low) ** part : low + part * (high - low)));
  // As many digits as tell the ticks of a narrow range apart.
  const digits = Math.min(15, Math.max(3, Math.ceil(2 + Math.log10(Math.max(-low, high) / (high - low)))));
  const ticks = high > low ? steps.map((value) => [at(value), short(value, axis.share, digits)]) : [[0.5, short(low, axis.share)]];
  return { at, ticks };
}

function light(entry, event) {
  document.body.classList.toggle("some-lit", entry != null);
  for (const node of document.querySelectorAll("[data-entry]"))
    node.classList.toggle("lit", +node.dataset.entry === entry);
  tip.hidden = entry == null || !event;
  if (tip.hidden) return;
  tip.textContent = data.entries[entry].name;
  tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8)}px`;
  tip.style.top = `${Math.min(event.clientY + 16, innerHeight - tip.offsetHeight - 8)}px`;
}
function lightable(node, entry) {
  node.dataset.entry = entry;
  node.addEventListener("mousemove", (event) => light(entry, node.tagName === "TR" ? null : event));
  node.addEventListener("mouseleave", () => light(null));
}

function drawParallel() {
  const svg = document.getElementById("parallel");
  if (!data.entries.length || data.axes.length < 2) return document.getElementById("parallel-panel").remove();
  const width = Math.max(svg.parentNode.clientWidth, 150 * data.axes.length), height = 410;
  const [left, right, top, bottom] = [60, 140, 66, 14];
  // Labels are cut to the distance of two axes, and left out where they would overlap.
  const gap = (width - left - right) / (data.axes.length - 1), letter = 8, line = 15;
  const cut = (text, fits) => text.length > fits ? `${text.slice(0, fits - 1)}…` : text;
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.style.width = `${width}px`;
  const scales = data.axes.map(scale);
  const x = (axis) => left + (axis * (width - left - right)) / (data.axes.length - 1);
  const y = (part) => top + part * (height - top - bottom);
  const order = data.entries.map((_, place) => place).reverse(); // draws the best last, on top
  for (const place of order) {
    const points = data.axes.map((axis, number) => [number, data.entries[place].values[axis.key]])
      .filter(([, value]) => value != null)
      .map(([number, value]) => `${x(number).toFixed(1)},${y(scales[number].at(value)).toFixed(1)}`).join(" ");
    const line = draw(svg, "polyline", { points, class: place ? "entry" : "entry best" });
    line.style.stroke = shade(place);
    line.dataset.entry = place;
    lightable(draw(svg, "polyline", { points, class: "reach" }), place);
  }
  data.axes.forEach((axis, number) => {
    draw(svg, "line", { class: "axis", x1: x(number), x2: x(number), y1: y(0), y2: y(1) });
    const space = number < data.axes.length - 1 ? gap : right;
    const fits = Math.max(4, Math.floor(space / letter) - 1);
    // The figure's name, and the track below it.
    const [name, ...rest] = axis.heading.split(", ");
    [name, rest.join(", ")].forEach((text, place) => {
      if (!text) return;
      const at = { class: "heading", x: x(number) - 6, y: 22 + 16 * place };
      draw(draw(svg, "text", at, cut(text, fits)), "title", {}, axis.heading);
    });
    let above = -Infinity;
    for (const [part, label] of scales[number].ticks.sort(([a], [b]) => a - b)) {
      draw(svg, "line", { class: "axis", x1: x(number), x2: x(number) + 5, y1: y(part), y2: y(part) });
      if (y(part) - above < line) continue;
      above = y(part);
      // Above its tick: a line through the tick would strike it through.
      const text = draw(svg, "text", { x: x(number) + 8, y: y(part) - 5 }, cut(label, fits - 2));
      draw(text, "title", {}, label);
    }
    const brush = draw(svg, "rect", { class: "brush", x: x(number) - 9, width: 18, y: 0, height: 0 });
    const hand = draw(svg, "rect", { class: "hand", x: x(number) - 9, width: 18, y: y(0) - 6, height: y(1) - y(0) + 12 });
    let from = null;
    const part = (event) => {
      const box = svg.getBoundingClientRect();
      const at = ((event.clientY - box.top) / box.height) * height;
      return Math.min(1, Math.max(0, (at - top) / (height - top - bottom)));
    };
    hand.addEventListener("pointerdown", (event) => {
      from = part(event);
      hand.setPointerCapture(event.pointerId);
    });
    const show = (event) => {
      if (from == null) return;
      const range = [from, part(event)].sort((a, b) => a - b);
      const picked = range[1] - range[0] > 0.02;
      if (picked) brushes.set(number, range);
      else brushes.delete(number);
      brush.setAttribute("y", y(range[0]));
      brush.setAttribute("height", picked ? y(range[1]) - y(range[0]) : 0);
      pick(scales);
    };
    hand.addEventListener("pointermove", show);
    hand.addEventListener("pointerup", (event) => { show(event); from = null; });
  });
}

function pick(scales) {
  const out = data.entries.map((entry) => [...brushes].some(([number, [low, high]]) => {
    const value = entry.values[data.axes[number].key];
    if (value == null) return true;
    const at = scales[number].at(value);
    return at < low - 0.005 || at > high + 0.005;
  }));
  for (const node of document.querySelectorAll("[data-entry]"))
    node.classList.toggle("out", out[+node.dataset.entry]);
}

function drawCurves(name) {
  const svg = document.getElementById("curves");
  const width = Math.max(svg.parentNode.clientWidth - 44, 200), height = 380; // 0 before the first layout
  const [left, right, top, bottom] = [64, 12, 30, 44];
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const all = data.entries.flatMap((entry, place) => entry.runs.map((run) => ({ place, curve: run.curves[name] || [] })));
  const points = all.flatMap((one) => one.curve);
  const share = name.endsWith("autonomy");
  const values = points.map((point) => point[1]).sort((a, b) => a - b);
  // A run that diverged must not flatten the other curves.
  const high = share ? 1 : Math.min(values[values.length - 1], 4 * values[Math.floor(0.9 * (values.length - 1))]);
  const low = share ? Math.min(0.9, values[0]) : values[0];
  const log = !share && low > 0 && high / low > 4;
  const bend = log ? Math.log : (value) => value;
  const epochs = Math.max(...points.map((point) => +point[0]), 2);
  const x = (epoch) => left + ((epoch - 1) / (epochs - 1)) * (width - left - right);
  const y = (value) => top + (1 - (bend(Math.min(value, high)) - bend(low)) / (bend(high) - bend(low) || 1)) * (height - top - bottom);
  for (let step = 0; step <= 4; step++) {
    const value = log ? low * (high / low) ** (step / 4) : low + ((high - low) * step) / 4;
    draw(svg, "line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) });
    draw(svg, "text", { x: left - 8, y: y(value) + 5, "text-anchor": "end" }, short(value, share));
  }
  const every = Math.max(1, Math.ceil(epochs / 15));
  for (let epoch = 1; epoch <= epochs; epoch += every)
    draw(svg, "text", { x: x(epoch), y: height - bottom + 20, "text-anchor": "middle" }, epoch);
  draw(svg, "text", { class: "heading", x: (left + width) / 2, y: height - 4, "text-anchor": "middle" }, "epoch");
  draw(svg, "text", { class: "heading", x: 0, y: 8 }, `${curveLabels[name]}${log ? ", log scale" : ""}`);
  for (const { place, curve } of [...all].reverse()) {
    if (!curve.length) continue;
    const path = curve.map(([epoch, value]) => `${x(epoch).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
    const line = draw(svg, "polyline", { points: path, class: place ? "entry" : "entry best" });
    line.style.stroke = shade(place);
    line.dataset.entry = place;
    if (curve.length === 1) {
      const dot = draw(svg, "circle", { cx: x(curve[0][0]), cy: y(curve[0][1]), r: 4 });
      dot.style.fill = shade(place);
    }
    lightable(draw(svg, "polyline", { points: path, class: "reach" }), place);
  }
}

function chooseCurves() {
  const group = document.getElementById("choose");
  if (!data.curves.length) return document.getElementById("curves-panel").remove();
  let chosen = data.curves[0];
  const choose = (name) => {
    chosen = name;
    for (const button of group.children) button.setAttribute("aria-pressed", button.dataset.name === name);
    drawCurves(name);
  };
  for (const name of data.curves) {
    const button = document.createElement("button");
    button.textContent = curveLabels[name];
    button.dataset.name = name;
    button.addEventListener("click", () => choose(name));
    group.append(button);
  }
  choose(chosen);
  addEventListener("resize", () => drawCurves(chosen));
}

function sortable() {
  const heads = [...document.querySelectorAll("#ranking th")];
  for (const head of heads) {
    head.tabIndex = 0;
    head.addEventListener("keydown", (event) => {
      if (event.key === "Enter") head.click();
    });
  }
  heads.forEach((head, column) => head.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    heads.forEach((one) => one.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const value = (row) => {
      const cell = row.cells[column];
      return cell.dataset.value ?? cell.textContent;
    };
    const missing = (text) => text === "-";
    rows.sort((one, other) => {
      const [a, b] = [value(one), value(other)];
      if (missing(a) || missing(b)) return missing(a) - missing(b); // rows without a value stay at the bottom
      return a.localeCompare(b, undefined, { numeric: true }) * (down ? -1 : 1) || 0;
    });
    const numbers = rows.every((row) => missing(value(row)) || !Number.isNaN(+value(row)));
    if (numbers) rows.sort((one, other) => {
      const [a, b] = [value(one), value(other)];
      if (missing(a) || missing(b)) return missing(a) - missing(b);
      return (a - b) * (down ? -1 : 1);
    });
    document.querySelector("#ranking tbody").append(...rows);
  }));
}

rows.forEach((row) => lightable(row, +row.dataset.entry));
drawParallel();
chooseCurves();
sortable();
addEventListener("resize", () => { brushes.clear(); pick([]); drawParallel(); });
