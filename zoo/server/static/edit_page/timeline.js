// Draws the timeline: the shown rows in detail, and all rows below. Each pixel column shows the
// least and the greatest value of its rows, so that no single row is lost however many there are.

const LANE = 0.72; // share of the height for the steering; the speed has the rest
const TOP = 14; // pixels for the labels of parts
const GRAB = 6; // pixels that a pointer moves before it selects
const FEWEST = 30; // rows that are shown at least

export class Timeline {
  // data: {rows, steering, speed, predicted, breaks}; edits: {dropped, mirrored, splits}
  constructor(detail, overview, onRow, onSelect) {
    Object.assign(this, { detail, overview, onRow, onSelect });
    this.data = null;
    this.edits = { dropped: [], mirrored: [], splits: [] };
    this.row = 0;
    this.selection = null; // [first, end]
    this.view = [0, 1];
    this.waiting = false;
    this.layers = {}; // what stays while rows are played, by canvas: [key, canvas]
    this.listen();
  }

  show(data) {
    this.data = data;
    this.view = [0, Math.max(Math.min(data.rows, 3000), 1)];
    this.redrawAll();
  }

  redrawAll() {
    this.layers = {};
    this.draw();
  }

  draw() {
    if (this.waiting || !this.data) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.drawDetail();
      this.drawOverview();
    });
  }

  zoom(factor, at = this.row) {
    const [first, end] = this.view;
    const width = Math.min(Math.max((end - first) * factor, FEWEST), this.data.rows);
    const share = Math.min(Math.max((at - first) / (end - first), 0), 1);
    this.look(at - share * width, width);
  }

  look(first, width) {
    const begin = Math.min(Math.max(first, 0), Math.max(this.data.rows - width, 0));
    this.view = [begin, begin + width];
    this.draw();
  }

  reveal(row) {
    const [first, end] = this.view;
    if (row < first || row >= end) this.look(row - (end - first) / 2, end - first);
  }

  // --- pointer ---

  listen() {
    const rowAt = (event, [first, end], canvas) => {
      const box = canvas.getBoundingClientRect();
      const row = first + ((event.clientX - box.left) / box.width) * (end - first);
      return Math.min(Math.max(Math.floor(row), 0), this.data.rows - 1);
    };
    let pressed = null; // [row, clientX]
    this.detail.onpointerdown = (event) => {
      if (!this.data || event.button) return;
      this.detail.setPointerCapture(event.pointerId);
      pressed = [rowAt(event, this.view, this.detail), event.clientX, false];
    };
    this.detail.onpointermove = (event) => {
      if (!pressed) return;
      pressed[2] ||= Math.abs(event.clientX - pressed[1]) > GRAB;
      if (!pressed[2]) return;
      const row = rowAt(event, this.view, this.detail);
      this.onSelect([Math.min(row, pressed[0]), Math.max(row, pressed[0]) + 1]);
      this.onRow(row);
    };
    this.detail.onpointerup = (event) => {
      if (pressed && !pressed[2]) {
        this.onSelect(null);
        this.onRow(rowAt(event, this.view, this.detail));
      }
      pressed = null;
    };
    this.detail.onpointercancel = () => (pressed = null);
    this.detail.onwheel = (event) => {
      if (!this.data) return;
      const [first, end] = this.view;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey) {
        event.preventDefault();
        const moved = event.deltaX || event.deltaY;
        this.look(first + (moved / this.detail.clientWidth) * (end - first), end - first);
      } else if (event.deltaY) {
        event.preventDefault();
        this.zoom(event.deltaY > 0 ? 1.25 : 0.8, rowAt(event, this.view, this.detail));
      }
    };
    const move = (event) => {
      const width = this.view[1] - this.view[0];
      this.look(rowAt(event, [0, this.data.rows], this.overview) - width / 2, width);
    };
    this.overview.onpointerdown = (event) => {
      if (!this.data) return;
      this.overview.setPointerCapture(event.pointerId);
      move(event);
      this.overview.onpointermove = move;
    };
    this.overview.onpointerup = (event) => {
      if (this.overview.onpointermove) this.onRow(rowAt(event, [0, this.data.rows], this.overview));
      this.overview.onpointermove = null;
    };
    this.overview.onpointercancel = () => (this.overview.onpointermove = null);
  }

  // --- drawing ---

  drawDetail() {
    const { pen, width, height } = prepare(this.detail);
    const [first, end] = this.view;
    const x = (row) => ((row - first) / (end - first)) * width;
    this.drawLayer(this.detail, pen, String(this.view), (own) => this.drawCurves(own, x, width, height));
    if (this.selection) {
      // A frame with little colour: filled, it would turn the colours of the edits into others.
      const [left, right] = this.selection.map(x);
      const width = Math.max(right - left, 1);
      pen.fillStyle = colour("--text", 0.06);
      pen.fillRect(left, 0, width, height);
      pen.strokeStyle = colour("--accent");
      pen.lineWidth = 2;
      pen.strokeRect(left, 1, width, height - 2);
      pen.lineWidth = 1;
    }
    pen.strokeStyle = colour("--text");
    const now = x(this.row + 0.5);
    line(pen, [[now, 0], [now, height]]);
  }

  drawCurves(pen, x, width, height) {
    const { rows, steering, speed, predicted, breaks } = this.data;
    const [first, end] = this.view;
    const lane = TOP + (height - TOP) * LANE;
    const middle = (TOP + lane) / 2;
    const range = niceRange(Math.max(...[steering, predicted ?? []].map((values) => greatest(values, first, end))));
    const clipped = (value) => Math.max(Math.min(value, range), -range);
    const steeringY = (value) => middle - (clipped(value) / range) * (lane - TOP - 10) / 2; // + is up
    const fastest = Math.max(Math.ceil(greatest(speed, 0, rows) / 10) * 10, 10);
    const speedY = (value) => height - 4 - (value / fastest) * (height - lane - 26); // below its label
    this.shadeEdits(pen, x, height);
    pen.strokeStyle = colour("--line");
    line(pen, [[0, steeringY(0)], [width, steeringY(0)]]);
    line(pen, [[0, lane + 4], [width, lane + 4]]);
    pen.setLineDash([2, 4]);
    for (const row of breaks) if (row > first && row < end) line(pen, [[x(row), 0], [x(row), height]]);
    pen.setLineDash([]);
    pen.lineWidth = 1.5;
    for (const [values, name, y] of [[speed, "--speed", speedY], [steering, "--accent", steeringY], [predicted, "--predicted", steeringY]]) {
      pen.strokeStyle = colour(name);
      if (values) curve(pen, values, this.view, x, y, width);
    }
    this.drawSplits(pen, x, height);
    const scale = speed.every(Number.isNaN) ? "speed unknown" : `${fastest} mph`;
    const labels = [[`+${range} right`, steeringY(range) + 10], [`−${range} left`, steeringY(-range) - 2], [scale, lane + 17]];
    pen.fillStyle = colour("--soft");
    pen.strokeStyle = colour("--panel"); // an outline, on which a curve does not hide a label
    pen.lineWidth = 4;
    pen.font = font();
    for (const [text, y] of labels) for (const draw of ["strokeText", "fillText"]) pen[draw](text, 8, y);
    pen.textAlign = "right";
    pen.fillText(`rows ${Math.floor(first) + 1} to ${Math.min(Math.ceil(end), rows)}`, width - 8, lane + 17);
  }

  drawOverview() {
    const { pen, width, height } = prepare(this.overview);
    const { rows, steering } = this.data;
    const x = (row) => (row / rows) * width;
    this.drawLayer(this.overview, pen, "", (own) => {
      const range = niceRange(greatest(steering, 0, rows));
      const y = (value) => height / 2 - (value / range) * (height / 2 - 3);
      this.shadeEdits(own, x, height);
      own.strokeStyle = colour("--accent");
      curve(own, steering, [0, rows], x, y, width);
      this.drawSplits(own, x, height, false);
    });
    const [left, right] = this.view.map(x);
    pen.fillStyle = colour("--text", 0.08);
    pen.strokeStyle = colour("--text");
    pen.fillRect(left, 0, right - left, height);
    pen.strokeRect(left + 0.5, 0.5, Math.max(right - left - 1, 2), height - 1);
    line(pen, [[x(this.row), 0], [x(this.row), height]]);
  }

  // Draws a layer, with `paint` only if the key or the size has changed since the last time.
  drawLayer(canvas, pen, key, paint) {
    if (!canvas.width || !canvas.height) return; // before the first layout
    const whole = `${key} ${canvas.width} ${canvas.height}`;
    const found = this.layers[canvas.id];
    if (found?.[0] !== whole) {
      const layer = document.createElement("canvas");
      [layer.width, layer.height] = [canvas.width, canvas.height];
      const own = layer.getContext("2d");
      own.setTransform(pen.getTransform());
      paint(own);
      this.layers[canvas.id] = [whole, layer];
    }
    pen.save();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.layers[canvas.id][1], 0, 0);
    pen.restore();
  }

  shadeEdits(pen, x, height) {
    for (const [stretches, name] of [[this.edits.mirrored, "--mirrored"], [this.edits.dropped, "--bad"]]) {
      pen.fillStyle = colour(name, 0.28);
      for (const [first, end] of stretches) pen.fillRect(x(first), 0, Math.max(x(end) - x(first), 1), height);
      pen.fillStyle = colour(name);
      for (const [first, end] of stretches) pen.fillRect(x(first), height - 4, Math.max(x(end) - x(first), 1), 4);
    }
  }

  drawSplits(pen, x, height, labelled = true) {
    pen.strokeStyle = pen.fillStyle = colour("--text");
    pen.font = font(600);
    pen.lineWidth = 2;
    this.edits.splits.forEach((row, number) => {
      line(pen, [[x(row), 0], [x(row), height]]);
      if (labelled) pen.fillText(`part ${number + 2}`, x(row) + 5, 12);
    });
    pen.lineWidth = 1;
  }
}

function prepare(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const sizes = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== sizes[0] || canvas.height !== sizes[1]) [canvas.width, canvas.height] = sizes;
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineWidth = 1;
  return { pen, width, height };
}

function colour(name, opacity = 1) {
  const found = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return opacity === 1 ? found : `${found}${Math.round(255 * opacity).toString(16).padStart(2, "0")}`;
}

const font = (weight = 400) => `${weight} 12px ${getComputedStyle(document.body).fontFamily}`;

function line(pen, points) {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  pen.stroke();
}

// Draws the rows of a view: each of them where there are few, else two values per pixel column.
export function curve(pen, values, [first, end], x, y, width) {
  const begin = Math.max(Math.floor(first), 0);
  const stop = Math.min(Math.ceil(end), values.length);
  const perColumn = (end - first) / width;
  pen.beginPath();
  if (perColumn <= 2) {
    drawRows(pen, values, begin, stop, x, y);
  } else {
    let drawn = false;
    for (const [row, low, high] of columns(values, begin, stop, perColumn)) {
      if (low > high) {
        drawn = false; // unknown values
        continue;
      }
      pen[drawn ? "lineTo" : "moveTo"](x(row), y(low));
      pen.lineTo(x(row), y(high));
      drawn = true;
    }
  }
  pen.stroke();
}

function drawRows(pen, values, begin, stop, x, y) {
  let drawn = false;
  for (let row = begin; row < stop; row += 1) {
    const known = !Number.isNaN(values[row]);
    if (known) pen[drawn ? "lineTo" : "moveTo"](x(row + 0.5), y(values[row]));
    drawn = known;
  }
}

// Returns [row, least, greatest] of each pixel column; least is above greatest without a value.
export function columns(values, begin, stop, perColumn) {
  const found = [];
  for (let start = begin; start < stop; start += perColumn) {
    let [low, high] = [Infinity, -Infinity];
    const last = Math.min(Math.ceil(start + perColumn), stop);
    for (let row = Math.floor(start); row < last; row += 1) {
      if (values[row] < low) low = values[row];
      if (values[row] > high) high = values[row];
    }
    found.push([start, low, high]);
  }
  return found;
}

function greatest(values, first, end) {
  let most = 0;
  const stop = Math.min(Math.ceil(end), values.length);
  for (let row = Math.max(Math.floor(first), 0); row < stop; row += 1) {
    const size = Math.abs(values[row]);
    if (size > most) most = size;
  }
  return most;
}

function niceRange(most) {
  return [0.1, 0.2, 0.4, 0.6, 0.8, 1].find((one) => most <= one) ?? 1;
}
