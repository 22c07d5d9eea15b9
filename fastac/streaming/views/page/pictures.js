// Images on canvases: the camera's, normals, presses, force maps, and the dial of the shear.

import { css, fit } from "./curves.js";

/** A table of 256 colours, [r, g, b, ...], through the points of a ramp. */
export function table(ramp) {
  const found = new Uint8Array(3 * 256);
  for (let k = 0; k < 256; k++) {
    const place = (k / 255) * (ramp.length - 1);
    const low = Math.min(Math.floor(place), ramp.length - 2);
    for (let band = 0; band < 3; band++) {
      found[3 * k + band] = ramp[low][band] + (place - low) * (ramp[low + 1][band] - ramp[low][band]);
    }
  }
  return found;
}

/** Draw an image of rows × columns; `colour(k, out, at)` writes red, green, blue of pixel k. */
function paint(canvas, rows, columns, colour) {
  if (canvas.width !== columns || canvas.height !== rows) {
    canvas.width = columns;
    canvas.height = rows;
  }
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  for (let k = 0; k < rows * columns; k++) {
    colour(k, image.data, 4 * k);
    image.data[4 * k + 3] = 255;
  }
  context.putImageData(image, 0, 0);
}

/** The camera's B, G, R as a picture, and NIR, where there is one, as another. */
export function camera(canvas, nir, { shape, data }) {
  const [rows, columns, channels] = shape;
  paint(canvas, rows, columns, (k, out, at) => {
    for (let band = 0; band < 3; band++) out[at + band] = data[channels * k + 2 - band];
  });
  if (channels > 3) {
    paint(nir, rows, columns, (k, out, at) => out.fill(data[channels * k + 3], at, at + 3));
  }
}

export function colours(canvas, { shape, data }) {
  paint(canvas, shape[0], shape[1], (k, out, at) => {
    for (let band = 0; band < 3; band++) out[at + band] = data[3 * k + band];
  });
}

/** Values by a table of colours, whose end stands for `full`. */
export function ramped(canvas, [rows, columns], values, full, colour) {
  paint(canvas, rows, columns, (k, out, at) => {
    const place = 3 * Math.round(255 * Math.min(Math.max(values[k] / full, 0), 1));
    for (let band = 0; band < 3; band++) out[at + band] = colour[place + band];
  });
}

/** F_x and F_y as an arrow in a circle of `fullShear`, y downwards as in the image; F_z as a bar of `full`. */
export function dial(canvas, force, fullShear, full) {
  const { context, width, height } = fit(canvas);
  const bar = 16, radius = Math.min(width - bar - 30, height - 8) / 2;
  const x0 = radius + 4, y0 = height / 2;
  context.strokeStyle = css("--grid");
  context.lineWidth = 1;
  for (const share of [0.5, 1]) {
    context.beginPath();
    context.arc(x0, y0, share * radius, 0, 2 * Math.PI);
    context.stroke();
  }
  context.beginPath();
  context.moveTo(x0 - radius, y0);
  context.lineTo(x0 + radius, y0);
  context.moveTo(x0, y0 - radius);
  context.lineTo(x0, y0 + radius);
  context.stroke();
  context.fillStyle = css("--muted");
  context.font = "11px system-ui, sans-serif";
  context.fillText("x", x0 + radius - 8, y0 - 4);
  context.fillText("y", x0 + 4, y0 + radius - 3);
  const [x, y] = [force.x ?? 0, force.y ?? 0].map((n) => (n / fullShear) * radius);
  arrow(context, x0, y0, x0 + x, y0 + y, css("--arrow"));
  if (force.z !== undefined) {
    const left = width - bar - 2, tall = 2 * radius, high = Math.max(0, Math.min(1, force.z / full)) * tall;
    context.fillStyle = css("--grid");
    context.fillRect(left, y0 - radius, bar, tall);
    context.fillStyle = css("--z");
    context.fillRect(left, y0 + radius - high, bar, high);
    context.fillStyle = css("--muted");
    context.textAlign = "right";
    context.fillText("z", left - 4, y0 + radius - 2);
    context.textAlign = "left";
  }
}

/** A line with a head at its end. */
export function arrow(context, x0, y0, x1, y1, colour) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (length < 1.5) return;
  const head = Math.min(11, 0.6 * length), along = [(x1 - x0) / length, (y1 - y0) / length];
  const base = [x1 - head * along[0], y1 - head * along[1]];
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 3;
  context.lineCap = "round";
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(...base);
  context.stroke();
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(base[0] - 0.55 * head * along[1], base[1] + 0.55 * head * along[0]);
  context.lineTo(base[0] + 0.55 * head * along[1], base[1] - 0.55 * head * along[0]);
  context.fill();
}
