// The live view: connects to the stream, keeps the newest record, draws it, and asks for the next one.

import { History, css, curves, strip } from "./curves.js";
import { camera, colours, dial, ramped, table } from "./pictures.js";
import { Surface } from "./surface.js";
import { decode } from "./wire.js";

const FLAGS = ["slipping", "suspect", "bad", "lost"]; // bits 0 to 3 of a row's flags
const at = (id) => document.getElementById(id);
const surface = new Surface(at("surface"));
const history = new History();
let about, rest, ramp, newest, held, paused = false;

// Numbers in words

const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const milliseconds = (seconds) => (seconds === null ? "–" : (1e3 * seconds).toFixed(3));
const norm = (force) => Math.hypot(...Object.values(force));

function keys(id, entries) {
  at(id).replaceChildren(...entries.map(([name, colour]) => {
    const key = document.createElement("span"), mark = document.createElement("i");
    mark.style.setProperty("--key", `var(${colour})`);
    key.append(mark, name);
    return key;
  }));
}

function describe(message) {
  about = message.about;
  rest = message.arrays.rest_mm;
  ramp = table(message.drawn.ramp);
  surface.place(message.drawn.x_mm, message.drawn.y_mm, rest.data, ramp);
  const has = (name) => about.arrays.includes(name), axes = about.force_axes;
  document.title = `${about.scene} – FasTac live`;
  at("scene").textContent = about.scene;
  const clock = about.simulated_clock ? "simulated clock" : "clock";
  at("origin").textContent =
    `${about.source} → ${about.via}, ${about.height_px} × ${about.width_px} px, ${about.channels.join(", ")}`;
  at("about").textContent =
    `Bundle ${about.bundle_sha256.slice(0, 16)}, pixels of ${about.pitch_mm.toFixed(4)} mm, ${clock} of ` +
    `${about.clock_mhz} MHz. F_z is positive in compression; the circle has F_x and F_y, the bar F_z; times are the source’s.`;
  if (about.simulated_clock) at("hardware-name").textContent = "Hardware, first pixel to result (simulated)";
  at("forces").replaceChildren(...axes.map((axis) => {
    const tile = document.createElement("div");
    tile.style.setProperty("--axis-colour", `var(--${axis})`);
    tile.innerHTML = `<dt>F_${axis}</dt><dd><b id="force-${axis}">–</b> N</dd>`;
    return tile;
  }));
  keys("force-keys", axes.map((axis) => [`F_${axis}`, `--${axis}`]));
  keys("latency-keys", [[`hardware${about.simulated_clock ? ", simulated" : ""}`, "--x"], ["host", "--y"]]);
  keys("flag-keys", [["ok", "--ok"], ...FLAGS.map((name) => [name, `--${name}`])]);
  const there = {
    "image-card": has("image"), "nir-card": has("image") && about.channels.length > 3,
    "normals-card": has("normals"), "depth-card": has("depth_mm"), "deepest-tile": has("depth_mm"),
    "map-card": has("force_map_n"), "force-card": axes.length > 0, "dial-card": axes.length > 0,
  };
  for (const [id, shown] of Object.entries(there)) at(id).hidden = !shown;
  at("forces").hidden = !axes.length;
  at("curves").classList.toggle("without-force", !axes.length);
  at("surface-name").textContent = axes.length ? "Skin and force" : "Skin";
  at("map-axis").textContent = axes.at(-1) ?? "";
  colours(at("ramp"), { shape: [1, 128], data: ramp.filter((_, k) => Math.floor(k / 3) % 2 === 0) });
}

function words({ facts, timing, drawn }) {
  at("frame").textContent = facts.frame;
  at("rate").textContent = number(drawn.frames_per_second, 1);
  at("shown").textContent = drawn.shown;
  at("left-out").textContent = drawn.left_out;
  at("hardware").textContent = milliseconds(timing.first_pixel_to_result_s);
  at("host").textContent = milliseconds(timing.host_latency_s);
  for (const axis of about.force_axes) {
    at(`force-${axis}`).textContent = axis in facts.force_n ? signed(facts.force_n[axis], 3) : "–";
  }
  at("deepest").textContent = number(drawn.deepest_mm, 3);
  at("slip-tile").hidden = facts.slip_px === null;
  at("slip").textContent = number(facts.slip_px, 2);
  at("ramp-end").textContent = `${drawn.full_press_mm.toFixed(2)} mm pressed`;
  const flagged = [...FLAGS].reverse().filter((name) => facts[name]);
  const told = flagged.map((name) => (name === "suspect" ? `suspect: ${facts.reasons.join(", ")}` : name));
  told.push(...timing.errors.map((name) => `error ${name}`));
  status(flagged[0] ?? "ok", told.join("; ") || "ok");
}

function status(state, text) {
  at("status").dataset.state = state;
  at("status").lastElementChild.textContent = text;
}

// Pictures

function pictures({ facts, drawn, arrays }) {
  if (arrays.image) camera(at("image"), at("nir"), arrays.image);
  if (arrays.normals_rgb) colours(at("normals"), arrays.normals_rgb);
  if (arrays.depth_mm) {
    const press = arrays.depth_mm.data.map((z, k) => rest.data[k] - z);
    ramped(at("depth"), rest.shape, press, drawn.full_press_mm, ramp);
  }
  if (arrays.force_map_n) {
    const { shape, data } = arrays.force_map_n;
    ramped(at("map"), shape, data, Math.max(...data, 1e-9), ramp);
  }
  if (facts.lost) return;
  if (about.force_axes.length) {
    dial(at("dial"), facts.force_n, drawn.full_shear_n, drawn.full_force_n);
    at("dial-text").textContent = `○ ${drawn.full_shear_n.toFixed(2)}, ▮ ${drawn.full_force_n.toFixed(2)} N`;
  }
  solid();
}

function solid() {
  if (!newest || newest.facts.lost) return;
  const { facts, drawn, arrays } = newest;
  surface.draw(arrays.depth_mm?.data ?? null, drawn.full_press_mm, drawn.arrow, `${norm(facts.force_n).toFixed(2)} N`);
}

function plots() {
  const axes = about.force_axes;
  const nothing = axes.map(() => null);
  if (axes.length) {
    const forces = (row) => (row[1].length ? row[1].map((n) => n ?? null) : nothing);
    curves(at("force-curve"), history, forces, axes.map((axis) => `--${axis}`), 0.1);
  }
  curves(at("latency-curve"), history, (row) => row[2], ["--x", "--y"], 0.1);
  strip(at("flag-curve"), history, (row) => FLAGS[31 - Math.clz32(row[3])] ?? null);
}

function redraw() {
  if (!newest) return;
  pictures(newest);
  plots();
}

// The stream

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream${location.search}`);
  socket.binaryType = "arraybuffer";
  const next = () => {
    if (socket.readyState === WebSocket.OPEN) socket.send("next");
  };
  const show = (message) => {
    const first = !newest;
    history.add(message.drawn.history);
    requestAnimationFrame(() => {
      newest = message;
      words(message);
      redraw();
      if (first) requestAnimationFrame(next); // when it is on the screen
      else next();
    });
  };
  socket.onopen = () => (at("origin").textContent = "Connected: the sensor's bundle is being loaded …");
  socket.onmessage = ({ data }) => {
    const message = decode(data);
    if (message.kind === "about") return describe(message);
    if (paused) held = message;
    else show(message);
  };
  socket.onclose = ({ wasClean }) => {
    status("waiting", wasClean ? "the stream has ended" : "no connection: is fastac live still running?");
    at("pause").hidden = true;
  };
  at("pause").onclick = () => {
    paused = !paused;
    at("pause").textContent = paused ? "Go on" : "Pause";
    at("pause").setAttribute("aria-pressed", paused);
    if (!paused && held) show(held);
    held = undefined;
  };
}

at("theme").onclick = () => {
  const dark = css("color-scheme") === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  at("theme").textContent = dark ? "Dark" : "Light";
  redraw();
};
at("theme").textContent = css("color-scheme") === "dark" ? "Light" : "Dark";
at("turn").onclick = () => {
  surface.reset();
  solid();
};
at("exaggeration").onchange = (event) => {
  surface.exaggeration = Number(event.target.value);
  solid();
};
surface.changed = solid;
at("depth").onmousemove = ({ offsetX, offsetY, target }) => {
  if (!newest?.arrays.depth_mm) return;
  const [rows, columns] = rest.shape;
  const v = Math.min(rows - 1, Math.floor((offsetY / target.clientHeight) * rows));
  const u = Math.min(columns - 1, Math.floor((offsetX / target.clientWidth) * columns));
  const k = v * columns + u, z = newest.arrays.depth_mm.data[k];
  at("probe").textContent = `${(rest.data[k] - z).toFixed(3)} mm, z ${z.toFixed(3)} mm`;
};
at("depth").onmouseleave = () => (at("probe").textContent = "");
new ResizeObserver(redraw).observe(document.body);
connect();
