// Messages of the server taken apart: views/page_message.py says what is in them.

const KINDS = { "|u1": Uint8Array, "<f4": Float32Array };
const texts = new TextDecoder();

/** The parts of a message, Uint8Arrays. */
function parts(buffer) {
  const view = new DataView(buffer);
  const count = view.getUint32(0, true);
  const found = [];
  let at = 4 * (count + 1);
  for (let k = 0; k < count; k++) {
    const length = view.getUint32(4 * (k + 1), true);
    found.push(new Uint8Array(buffer, at, length));
    at += length;
  }
  return found;
}

const json = (part) => JSON.parse(texts.decode(part));

/** Arrays by name: {shape, data}. */
function arrays(described, octets) {
  const found = {};
  described.forEach(({ name, dtype, shape }, k) => {
    const copy = octets[k].slice(); // whose first byte lies where any type may begin
    found[name] = { shape, data: new KINDS[dtype](copy.buffer) };
  });
  return found;
}

/** {kind: "about", about, drawn, arrays} or {kind: "record", facts, timing, drawn, arrays}. */
export function decode(buffer) {
  const all = parts(buffer);
  const kind = texts.decode(all[0]);
  if (kind === "about") {
    const drawn = json(all[2]);
    return { kind, about: json(all[1]), drawn, arrays: arrays(drawn.arrays, all.slice(3)) };
  }
  const drawn = json(all[3]);
  return { kind, facts: json(all[1]), timing: json(all[2]), drawn, arrays: arrays(drawn.arrays, all.slice(4)) };
}
