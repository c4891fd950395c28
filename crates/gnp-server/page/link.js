// The scene as the part of an address after `#`, and back. Readable:
// `#recording=us101-1&road=0&t=12.4&watch=7&x=120&span=180&move=9,-10,0&remove=12&off=neighbours`.

// Times may be since 1970.
const NUMBER = /^[+-]?\d{1,15}(\.\d{1,6})?$/;
const MOST_CHANGES = 500; // which the server takes
const MOST_LETTERS = 1000; // of one value
const CLASSES = ["car", "truck", "motorcycle"];

// How each kind of change is written: its key, its numbers and, of a name at the end, what it may be.
const KINDS = {
  remove: { numbers: 0, write: () => [], read: () => ({}) },
  move: { numbers: 2, write: (c) => c.by, read: (n) => ({ by: n }) },
  speed: { numbers: 1, write: (c) => [c.mps], read: ([mps]) => ({ mps }) },
  add: { numbers: 5, write: (c) => [...c.at, c.mps, ...c.size, c.class], read: ([x, y, mps, l, w], name) => ({ at: [x, y], mps, class: name, size: [l, w] }), names: CLASSES },
  goal: { numbers: 2, write: (c) => c.at, read: (n) => ({ at: n }) },
};

// Commas and spaces can stay readable; what else an address gives a meaning to cannot.
const text = (value) => encodeURIComponent(value).replaceAll("%2C", ",").replaceAll("%20", "+");
const short = (v) => String(Math.round(v * 1000) / 1000);

// The address of a state and a view, `{ centre, span }` in m.
export const write = (state, view) => {
  const parts = [["recording", state.recording], ["road", state.road], ["t", short(state.time)]];
  if (state.watched !== null) parts.push(["watch", state.watched]);
  if (view) parts.push(["x", view.centre.toFixed(0)], ["span", view.span.toFixed(0)]);
  if (state.held && !state.changes.length) parts.push(["held", 1]);
  for (const c of state.changes) {
    if (c.kind === "without_term") parts.push(["off", c.term]);
    else parts.push([c.kind, [c.vehicle, ...KINDS[c.kind].write(c).map((v) => (typeof v === "number" ? short(v) : v))].join(",")]);
  }
  return `#${parts.map(([key, value]) => `${key}=${text(value)}`).join("&")}`;
};

const numberOf = (key, value) => {
  if (!NUMBER.test(value)) throw new Error(`${value} in ${key} is no number`);
  return Number(value);
};

// Names of vehicles may have commas: the numbers are counted from the end.
const changeOf = (kind, value) => {
  const { numbers, read, names } = KINDS[kind], fields = value.split(",");
  const last = names ? fields.pop() : null, found = numbers ? fields.splice(-numbers) : [], vehicle = fields.join(",");
  if (!vehicle || found.length < numbers || (names && !names.includes(last))) throw new Error(`${kind}=${value} is not complete`);
  return { kind, vehicle, ...read(found.map((v) => numberOf(kind, v)), last) };
};

// What an address says: `{ recording, road, time, watched, held, changes, view }`, those it names; null for none. Throws for
// what nobody can have written.
export const read = (hash) => {
  if (hash.length < 2) return null;
  const found = { changes: [] }, view = {};
  for (const [key, value] of new URLSearchParams(hash.slice(1))) {
    if (value.length > MOST_LETTERS) throw new Error(`${key} is too long`);
    if (key === "recording") found.recording = value;
    else if (key === "road") found.road = numberOf(key, value);
    else if (key === "t") found.time = numberOf(key, value);
    else if (key === "watch") found.watched = value;
    else if (key === "x") view.centre = numberOf(key, value);
    else if (key === "span") view.span = numberOf(key, value);
    else if (key === "held") found.held = value === "1";
    else if (key === "off") found.changes.push({ kind: "without_term", term: value });
    else if (Object.hasOwn(KINDS, key)) found.changes.push(changeOf(key, value));
    else throw new Error(`it has ${key}, which is not known`);
  }
  if (found.changes.length > MOST_CHANGES) throw new Error(`it has more than ${MOST_CHANGES} changes`);
  if (view.centre !== undefined && view.span > 0) found.view = view;
  if (found.changes.length) found.held = true;
  return found;
};

// What is wrong with what an address says, in words, or null: `recordings` are those served, `names` the vehicles that are
// there at its moment, `terms` those of the model.
export const wrongPlace = (found, recordings) => {
  const recording = recordings.find((r) => r.name === found.recording);
  if (!recording) return `recording ${found.recording} is not served here`;
  if (!recording.roads.some((road) => road.index === (found.road ?? 0))) return `${recording.name} has no carriageway ${found.road}`;
  const time = found.time ?? recording.from_s;
  if (time < recording.from_s - 0.1 || time > recording.to_s + 0.1) return `${recording.name} goes from ${recording.from_s.toFixed(1)} to ${recording.to_s.toFixed(1)} s`;
  return null;
};
export const wrongNames = (found, names, terms) => {
  const there = new Set(names), seen = new Set();
  for (const c of found.changes) {
    const key = JSON.stringify([c.kind, c.vehicle, c.term]);
    if (seen.has(key)) return `it has ${c.kind === "without_term" ? "off" : c.kind} twice for ${c.vehicle ?? c.term}`;
    seen.add(key);
    if (c.kind === "without_term") { if (!terms.includes(c.term)) return `the model has no term ${c.term}`; }
    else if (c.kind === "add") { if (there.has(c.vehicle)) return `vehicle ${c.vehicle} is there already`; there.add(c.vehicle); }
    else if (!there.has(c.vehicle)) return `vehicle ${c.vehicle} is not there at that moment`;
    else if (c.kind === "remove") there.delete(c.vehicle);
  }
  return found.watched !== undefined && !names.includes(found.watched) && !there.has(found.watched) ? `vehicle ${found.watched} is not there at that moment` : null;
};
