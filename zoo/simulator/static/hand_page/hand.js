// Drives by hand: shows the latest frame, and sends what the hands do. A frame is requested once the
// last one is shown, so that it is always the latest; hands wait for the last ones to arrive.

import { post } from "./command.js";

const KEYS = {
  ArrowLeft: "arrow_left", ArrowRight: "arrow_right", ArrowUp: "arrow_up", ArrowDown: "arrow_down",
  KeyA: "a", KeyD: "d", KeyW: "w", KeyS: "s",
};
const PRESSES = { KeyR: "r", Space: "space", Backspace: "backspace", Escape: "escape" };
const MOUSE = "mouse1";
const MOVED = 0.01; // smaller changes of a gamepad's axes are not sent
const RETRY_MS = 500;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));
export const shown = (value, digits = 0) =>
  value === null || value === undefined ? "–"
  : value.toLocaleString(undefined, { minimumFractionDigits: digits, maximumFractionDigits: digits });

/** Draw each latest frame on a canvas, and call `show` with its state, until `ended()`; `keys` go into the address. */
export async function follow(path, canvas, show, ended = () => false, keys = {}) {
  for (let number = 0; !ended(); ) {
    if (document.hidden || canvas.closest("[hidden]")) {
      await pause(RETRY_MS);
      continue;
    }
    try {
      const query = new URLSearchParams(location.search);
      for (const [key, value] of Object.entries({ ...keys, after: number })) query.set(key, value);
      const response = await fetch(`${path}?${query}`, { cache: "no-store" });
      if (!response.ok) throw new Error((await response.json()).error);
      const body = await response.arrayBuffer();
      if (!body.byteLength) continue;
      const begin = 4 + new DataView(body).getUint32(0, true);
      const state = JSON.parse(new TextDecoder().decode(new Uint8Array(body, 4, begin - 4)));
      if (state.number === number) continue;
      number = state.number;
      const image = await createImageBitmap(new Blob([new Uint8Array(body, begin)]));
      if (canvas.width !== image.width) [canvas.width, canvas.height] = [image.width, image.height];
      canvas.getContext("2d").drawImage(image, 0, 0);
      image.close();
      show(state);
    } catch (error) {
      show(null, error);
      await pause(RETRY_MS);
    }
  }
}

export class HandView {
  /** @param {HTMLElement} root element that becomes the view */
  constructor(root) {
    root.innerHTML = `
      <div class="stage" tabindex="0" role="application" aria-label="View from the car; arrow keys or W A S D drive">
        <canvas width="320" height="160"></canvas>
        <p class="notice" role="status"></p><p class="mph"><b data-fact="speed">–</b> mph</p><p class="rec" hidden>REC</p>
        <div class="bar" aria-hidden="true"><i></i></div>
      </div>
      <div class="pedals" aria-label="Keys to hold"><button data-hold="a">◀ Left</button><button data-hold="s">Brake</button><button data-hold="w">Gas</button><button data-hold="d">Right ▶</button></div>
      <div class="controls">
        <button data-press="r" class="primary" aria-pressed="false" title="R">Record</button>
        <button data-press="backspace" title="Backspace">Put back</button>
        <button data-press="space" aria-pressed="false" title="Space">Cruise</button>
        <button data-press="escape" title="Esc">End</button>
      </div>
      <dl class="facts">
        <div><dt>Lap</dt><dd data-fact="lap">–</dd></div><div><dt>Lap time</dt><dd data-fact="time">–</dd></div>
        <div><dt>Last lap</dt><dd data-fact="last">–</dd></div><div><dt>Rows</dt><dd data-fact="rows">–</dd></div>
        <div><dt>Steering</dt><dd data-fact="steering">–</dd></div><div><dt>Throttle</dt><dd data-fact="throttle">–</dd></div>
      </dl>
      <p class="soft keys">Arrows or W A S D drive; the left mouse button, held and moved sideways, or a gamepad steers. <span class="rows">R records, Backspace puts the car back on the road, Space holds the throttle.</span> Esc ends.</p>
      <p class="soft" data-fact="folder"></p>`;
    this.root = root;
    this.stage = root.querySelector(".stage");
    this.held = new Set();
    this.hands = { held: [], pointer: 0.5, stick: 0, pedals: 0 };
    this.sending = this.dirty = this.ended = false;
    addEventListener("keydown", (event) => this.key(event, true));
    addEventListener("keyup", (event) => this.key(event, false));
    addEventListener("blur", () => this.release());
    const nothing = new Blob([JSON.stringify({ hands: {} })], { type: "application/json" });
    addEventListener("pagehide", () => this.held.size && navigator.sendBeacon(`command${location.search}`, nothing));
    this.stage.onpointerdown = (event) => {
      this.stage.setPointerCapture(event.pointerId);
      this.point(event);
      this.hold(MOUSE, true);
    };
    this.stage.onpointermove = (event) => this.held.has(MOUSE) && this.point(event);
    this.stage.onpointerup = this.stage.onpointercancel = () => this.hold(MOUSE, false);
    for (const button of root.querySelectorAll("[data-hold]")) {
      button.onpointerdown = () => this.hold(button.dataset.hold, true);
      button.onpointerup = button.onpointerleave = button.onpointercancel = () => this.hold(button.dataset.hold, false);
    }
    for (const button of root.querySelectorAll("[data-press]")) button.onclick = () => this.press(button.dataset.press);
    follow("frame", root.querySelector("canvas"), (state, error) => this.show(state, error));
    this.begin();
  }

  /** Take the keyboard for another drive. */
  begin() {
    this.ended = false;
    this.release();
    this.stage.focus({ preventScroll: true });
    this.root.scrollIntoView({ block: "start" });
  }

  /** Whether keys are for the car: the view is shown, and no field or button takes them. */
  takes(event) {
    const typed = event.target.closest?.("input, select, textarea, a, summary");
    const pushed = event.target.closest?.("button") && ["Space", "Enter"].includes(event.code);
    return !this.root.closest("[hidden]") && !typed && !pushed && !event.ctrlKey && !event.metaKey && !event.altKey;
  }

  key(event, down) {
    if (!down) this.hold(KEYS[event.code], false); // also with Ctrl, or once the view is hidden
    if (!this.takes(event)) return;
    if (event.code in KEYS) this.hold(KEYS[event.code], down);
    else if (event.code in PRESSES) down && !event.repeat && this.press(PRESSES[event.code]);
    else return;
    event.preventDefault();
  }

  hold(key, down) {
    if (this.held.has(key) === down) return;
    this.held[down ? "add" : "delete"](key);
    this.send();
  }

  release() {
    if (!this.held.size) return; // a page in another browser may drive
    this.held.clear();
    this.send();
  }

  point(event) {
    const box = this.stage.getBoundingClientRect();
    this.hands.pointer = Math.min(Math.max((event.clientX - box.x) / box.width, -9), 9);
    this.send();
  }

  readGamepads() {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter(Boolean);
    const largest = (values) => values.reduce((most, value) => (Math.abs(value) > Math.abs(most) ? value : most), 0);
    const stick = largest(pads.map((pad) => pad.axes[0] ?? 0));
    const pedals = largest(pads.map((pad) => (pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0)));
    if (Math.abs(stick - this.hands.stick) < MOVED && Math.abs(pedals - this.hands.pedals) < MOVED) return;
    Object.assign(this.hands, { stick, pedals });
    this.send();
  }

  async send() {
    this.dirty = true;
    if (this.sending) return;
    this.sending = true;
    while (this.dirty) {
      this.dirty = false;
      await post({ hands: { ...this.hands, held: [...this.held] } }).catch((error) => this.show(null, error));
    }
    this.sending = false;
  }

  press(name) {
    this.ended ||= name === "escape";
    post({ press: name }).catch((error) => this.show(null, error));
  }

  fact(name, text) {
    this.root.querySelector(`[data-fact="${name}"]`).textContent = text;
  }

  show(state, error) {
    const notice = this.root.querySelector(".notice");
    if (state === null) {
      notice.textContent = this.ended ? "The drive has ended" : error instanceof TypeError ? "drivezoo does not answer" : error.message;
      return;
    }
    // A drive that nobody steers, or records, has no such keys: the state lacks their values.
    const shows = (parts, value) => this.root.querySelectorAll(parts).forEach((part) => (part.hidden = value === undefined));
    shows(".pedals, .mph, .bar, .keys", state.speed_mph);
    shows('.facts, .rows, [data-press]:not([data-press="escape"])', state.recording);
    if (notice.textContent !== state.notice) notice.textContent = state.notice ?? "";
    this.fact("speed", shown(state.speed_mph));
    this.fact("lap", shown(state.lap));
    this.fact("time", state.lap_s === undefined ? "–" : `${shown(state.lap_s, 1)} s`);
    this.fact("last", state.last_lap_s == null ? "–" : `${shown(state.last_lap_s, 1)} s`);
    this.fact("rows", shown(state.rows));
    this.fact("steering", shown(state.steering, 2));
    this.fact("throttle", shown(state.throttle, 2));
    this.fact("folder", state.rows ? `Recorded in ${state.folder}` : "");
    this.root.querySelector(".bar i").style.transform = `scaleX(${state.steering ?? 0})`;
    this.root.querySelector(".rec").hidden = !state.recording;
    this.root.querySelector('[data-press="r"]').setAttribute("aria-pressed", String(Boolean(state.recording)));
    this.root.querySelector('[data-press="r"]').textContent = state.recording ? "Stop recording" : "Record";
    this.root.querySelector('[data-press="space"]').setAttribute("aria-pressed", String(Boolean(state.cruising)));
    this.readGamepads();
    this.root.dispatchEvent(new CustomEvent("frame", { detail: state }));
  }
}

const alone = document.querySelector("body.hand [data-hand]");
if (alone) new HandView(alone);
