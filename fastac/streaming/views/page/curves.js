// Curves over the last seconds, and the strip of flags.

export const SECONDS = 10;

/** A colour of the style sheet. */
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A canvas cleared, as large as it is shown; sizes in CSS pixels. */
export function fit(canvas, most = 2) {
  const scale = Math.min(window.devicePixelRatio || 1, most);
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height, scale };
}

/** Numbers by time; those older than SECONDS are forgotten. */
export class History {
  constructor() {
    this.rows = [];
  }

  /** Rows [time in s, ...]. */
  add(rows) {
    if (rows.length && this.rows.length && rows[0][0] < this.rows[this.rows.length - 1][0]) this.rows = [];
    this.rows.push(...rows);
    const oldest = this.now - SECONDS;
    let gone = 0;
    while (gone < this.rows.length && this.rows[gone][0] < oldest) gone++;
    this.rows.splice(0, gone);
  }

  get now() {
    return this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
  }
}

/** Steps of 1, 2 or 5 times a power of ten, about `count` of them from low to high. */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

const LEFT = 40, BOTTOM = 20, TOP = 6, RIGHT = 8;

/** Lines of `history`: `values(row)` gives a number or null for each colour. */
export function curves(canvas, history, values, colours, least) {
  const { context, width, height } = fit(canvas);
  const right = width - RIGHT, bottom = height - BOTTOM;
  let low = 0, high = least;
  for (const row of history.rows) {
    for (const value of values(row)) {
      if (value === null) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  const room = 0.05 * (high - low);
  [low, high] = [low < 0 ? low - room : low, high + room];
  const x = (t) => LEFT + (1 + (t - history.now) / SECONDS) * (right - LEFT);
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - TOP);

  context.font = "11px system-ui, sans-serif";
  context.fillStyle = css("--muted");
  context.lineWidth = 1;
  const { found, digits } = ticks(low, high, 4);
  context.textAlign = "right";
  for (const value of found) {
    context.strokeStyle = css(Math.abs(value) < 1e-12 ? "--axis" : "--grid");
    context.beginPath();
    context.moveTo(LEFT, y(value));
    context.lineTo(right, y(value));
    context.stroke();
    context.fillText(value.toFixed(digits), LEFT - 6, y(value) + 4);
  }
  context.textAlign = "center";
  for (let back = SECONDS; back >= 0; back -= 2) {
    const at = x(history.now - back);
    context.fillText(back ? `−${back} s` : "now", Math.min(at, right - 10), height - 5);
  }
  context.textAlign = "left";

  context.save();
  context.beginPath();
  context.rect(LEFT, 0, right - LEFT, height);
  context.clip();
  context.lineWidth = 1.8;
  context.lineJoin = "round";
  colours.forEach((colour, k) => {
    context.strokeStyle = css(colour);
    context.beginPath();
    let drawn = false;
    for (const row of history.rows) {
      const value = values(row)[k];
      if (value === null) drawn = false;
      else if (drawn) context.lineTo(x(row[0]), y(value));
      else {
        context.moveTo(x(row[0]), y(value));
        drawn = true;
      }
    }
    context.stroke();
  });
  context.restore();
}

/** A band whose colour says each frame's gravest flag; `flag(row)` gives the name of its colour, or null. */
export function strip(canvas, history, flag) {
  const { context, width, height } = fit(canvas);
  const right = width - RIGHT;
  const x = (t) => LEFT + (1 + (t - history.now) / SECONDS) * (right - LEFT);
  context.fillStyle = css("--grid");
  context.fillRect(LEFT, 4, right - LEFT, height - 8);
  const rows = history.rows;
  for (let k = 0; k < rows.length; ) {
    const name = flag(rows[k]);
    let end = k + 1;
    while (end < rows.length && flag(rows[end]) === name) end++;
    const from = x(rows[k][0]), to = end < rows.length ? x(rows[end][0]) : right;
    context.fillStyle = css(`--${name ?? "ok"}`);
    context.globalAlpha = name ? 1 : 0.55;
    context.fillRect(from, 4, Math.max(to - from, 1.5), height - 8);
    k = end;
  }
  context.globalAlpha = 1;
}
