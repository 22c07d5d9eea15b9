// The skin as a surface that can be turned: triangles with a depth buffer, in a canvas without WebGL.
//
// x is the image's column and y its row, drawn towards the viewer, so that from above it looks as the image does.

import { css, fit } from "./curves.js";
import { arrow } from "./pictures.js";

const START = { turn: -0.45, tilt: 0.72, zoom: 1 };
const LIGHT = [-0.45, -0.55, 0.7];

export class Surface {
  constructor(canvas) {
    this.canvas = canvas;
    this.exaggeration = 1;
    this.changed = () => {};
    this.reset();
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.turn -= 0.01 * event.movementX;
      this.tilt = Math.min(Math.PI / 2, Math.max(0.05, this.tilt + 0.01 * event.movementY));
      this.changed();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom = Math.min(8, Math.max(0.4, this.zoom * Math.exp(-0.001 * event.deltaY)));
      this.changed();
    }, { passive: false });
  }

  reset() {
    Object.assign(this, START);
  }

  /** The grid's places in mm, the height at rest (rows × columns), and the table of colours. */
  place(x, y, rest, colours) {
    Object.assign(this, { x, y, rest, colours });
    const count = x.length * y.length;
    for (const name of ["across", "down", "near", "red", "green", "blue"]) this[name] = new Float32Array(count);
    this.low = Math.min(...rest);
    this.high = Math.max(...rest);
    this.size = Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]);
  }

  /** How points in mm come to the canvas: column, row, and nearness. */
  projection(width, height) {
    const [s, c, st, ct] = [Math.sin(this.turn), Math.cos(this.turn), Math.sin(this.tilt), Math.cos(this.tilt)];
    const tall = this.size * st + 1.3 * (this.high - this.low) * ct;
    const scale = 0.98 * this.zoom * Math.min(width / this.size, height / tall);
    const middle = (this.low + this.high) / 2;
    return (x, y, z) => {
      const away = x * s + y * c;
      return [
        width / 2 + scale * (x * c - y * s),
        height / 2 + scale * (away * st - (z - middle) * ct),
        away * ct + z * st,
      ];
    };
  }

  /** Draw the height (rows × columns, mm; null: at rest) coloured by its press, and the arrow. */
  draw(depth, fullPress, force, label) {
    const { context, width, height } = fit(this.canvas, 1.5);
    if (!this.x || width < 2) return;
    const project = this.projection(this.canvas.width, this.canvas.height);
    this.vertices(depth ?? this.rest, fullPress, project);
    context.putImageData(this.raster(this.canvas.width, this.canvas.height), 0, 0);
    const scaled = this.projection(width, height);
    this.axes(context, scaled, width, height);
    if (force) {
      const tip = force.tip_mm, vector = force.vector_mm;
      const z = tip[2] - (this.exaggeration - 1) * this.pressAt(depth, tip);
      const [x1, y1] = scaled(tip[0], tip[1], z);
      const [x0, y0] = scaled(tip[0] - vector[0], tip[1] - vector[1], z - vector[2]);
      arrow(context, x0, y0, x1, y1, css("--arrow"));
      context.font = "600 13px system-ui, sans-serif";
      context.fillStyle = css("--ink");
      context.textAlign = x0 > width - 80 ? "right" : "left";
      const place = [x0 + (x0 > width - 80 ? -8 : 8), Math.max(14, y0 - 4)];
      context.strokeStyle = css("--card");
      context.lineWidth = 4;
      context.lineJoin = "round";
      context.strokeText(label, ...place);
      context.fillText(label, ...place);
      context.textAlign = "left";
    }
  }

  pressAt(depth, [x, y]) {
    if (!depth) return 0;
    const nearest = (axis, at) => axis.reduce((best, n, k) => (Math.abs(n - at) < Math.abs(axis[best] - at) ? k : best), 0);
    const k = nearest(this.y, y) * this.x.length + nearest(this.x, x);
    return this.rest[k] - depth[k];
  }

  vertices(depth, fullPress, project) {
    const columns = this.x.length, rows = this.y.length, more = this.exaggeration - 1;
    const step = this.x[1] - this.x[0];
    const z = (k) => depth[k] - more * (this.rest[k] - depth[k]);
    const long = Math.hypot(...LIGHT);
    for (let v = 0; v < rows; v++) {
      for (let u = 0; u < columns; u++) {
        const k = v * columns + u;
        [this.across[k], this.down[k], this.near[k]] = project(this.x[u], this.y[v], z(k));
        const left = u ? k - 1 : k, right = u < columns - 1 ? k + 1 : k;
        const above = v ? k - columns : k, below = v < rows - 1 ? k + columns : k;
        const p = (z(right) - z(left)) / (step * (right - left));
        const q = (z(below) - z(above)) / (step * ((below - above) / columns));
        const size = Math.hypot(p, q, 1) * long;
        const lit = Math.max(0, (-p * LIGHT[0] - q * LIGHT[1] + LIGHT[2]) / size);
        const shade = 0.36 + 0.62 * lit, gloss = 30 * lit ** 14;
        const at = 3 * Math.round(255 * Math.min(1, Math.max(0, (this.rest[k] - depth[k]) / fullPress)));
        this.red[k] = shade * this.colours[at] + gloss;
        this.green[k] = shade * this.colours[at + 1] + gloss;
        this.blue[k] = shade * this.colours[at + 2] + gloss;
      }
    }
  }

  /** All triangles into an image, the nearest of each pixel. */
  raster(width, height) {
    if (this.image?.width !== width || this.image?.height !== height) {
      this.image = new ImageData(width, height);
      this.buffer = new Float32Array(width * height);
    }
    this.image.data.fill(0);
    this.buffer.fill(-Infinity);
    const columns = this.x.length, rows = this.y.length;
    for (let v = 0; v + 1 < rows; v++) {
      for (let u = 0; u + 1 < columns; u++) {
        const k = v * columns + u;
        this.triangle(k, k + 1, k + columns + 1, width, height);
        this.triangle(k, k + columns + 1, k + columns, width, height);
      }
    }
    return this.image;
  }

  triangle(a, b, c, width, height) {
    const { across, down, near, red, green, blue, buffer } = this, out = this.image.data;
    const ax = across[a], ay = down[a], bx = across[b] - ax, by = down[b] - ay, cx = across[c] - ax, cy = down[c] - ay;
    const area = bx * cy - by * cx;
    if (Math.abs(area) < 1e-6) return;
    const left = Math.max(0, Math.ceil(ax + Math.min(0, bx, cx) - 0.5));
    const right = Math.min(width - 1, Math.floor(ax + Math.max(0, bx, cx) + 0.5));
    const top = Math.max(0, Math.ceil(ay + Math.min(0, by, cy) - 0.5));
    const bottom = Math.min(height - 1, Math.floor(ay + Math.max(0, by, cy) + 0.5));
    for (let y = top; y <= bottom; y++) {
      for (let x = left; x <= right; x++) {
        const wb = ((x - ax) * cy - (y - ay) * cx) / area, wc = ((y - ay) * bx - (x - ax) * by) / area;
        const wa = 1 - wb - wc;
        if (wa < -1e-3 || wb < -1e-3 || wc < -1e-3) continue;
        const at = y * width + x, depth = wa * near[a] + wb * near[b] + wc * near[c];
        if (depth <= buffer[at]) continue;
        buffer[at] = depth;
        out[4 * at] = wa * red[a] + wb * red[b] + wc * red[c];
        out[4 * at + 1] = wa * green[a] + wb * green[b] + wc * green[c];
        out[4 * at + 2] = wa * blue[a] + wb * blue[b] + wc * blue[c];
        out[4 * at + 3] = 255;
      }
    }
  }

  /** Three short axes in a corner, and the length of the image's side. */
  axes(context, project, width, height) {
    const length = 0.13 * this.size, origin = project(0, 0, 0);
    const at = [34, height - 62];
    context.font = "12px system-ui, sans-serif";
    context.lineWidth = 2;
    for (const [name, ...end] of [["x", length, 0, 0], ["y", 0, length, 0], ["z", 0, 0, length]]) {
      const tip = project(...end), x = at[0] + tip[0] - origin[0], y = at[1] + tip[1] - origin[1];
      context.strokeStyle = context.fillStyle = css(`--${name}`);
      context.beginPath();
      context.moveTo(...at);
      context.lineTo(x, y);
      context.stroke();
      context.fillText(name, x + 3, y - 2);
    }
    const wide = this.x.at(-1) - this.x[0], tall = this.y.at(-1) - this.y[0];
    context.fillStyle = css("--muted");
    context.textAlign = "right";
    context.fillText(`${wide.toFixed(1)} × ${tall.toFixed(1)} mm; drag to turn, scroll to zoom`, width - 2, height - 6);
    context.textAlign = "left";
  }
}
