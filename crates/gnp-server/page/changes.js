// What can be changed in a moment: a list of the API's changes, at most one of a kind for each vehicle. Pure functions:
// each gives a new list.

export const CAR = [4.5, 1.8]; // m, of a vehicle that is added
export const SPEEDS = [0, 60]; // m/s, of the slider
const SAME_MPS = 0.1;
const CM = 100;
const round = (v) => Math.round(v * CM) / CM;
const of = (kind, vehicle) => (c) => c.kind === kind && c.vehicle === vehicle;

export const find = (changes, kind, vehicle) => changes.find(of(kind, vehicle));
export const isRemoved = (changes, vehicle) => changes.some(of("remove", vehicle));
export const isOff = (changes, term) => changes.some((c) => c.kind === "without_term" && c.term === term);

// In its place where there is one of its kind already, else at the end.
const put = (changes, change) => {
  const i = changes.findIndex(of(change.kind, change.vehicle));
  return i < 0 ? [...changes, change] : changes.with(i, change);
};
const drop = (changes, kind, vehicle) => changes.filter((c) => !of(kind, vehicle)(c));

export const add = (changes, vehicle, [x, y], mps) => [...changes, { kind: "add", vehicle, at: [round(x), round(y)], mps: round(mps), class: "car", size: CAR }];
// A vehicle that is gone has no other changes, and one that was added leaves nothing.
export const remove = (changes, vehicle) => {
  const others = changes.filter((c) => c.vehicle !== vehicle);
  return find(changes, "add", vehicle) ? others : [...others, { kind: "remove", vehicle }];
};
// To `place`, from where it was recorded; without a record it was added.
export const move = (changes, vehicle, place, recorded) => {
  const added = find(changes, "add", vehicle);
  if (added) return put(changes, { ...added, at: place.map(round) });
  const by = place.map((v, i) => round(v - recorded[i]));
  return by.every((v) => v === 0) ? drop(changes, "move", vehicle) : put(changes, { kind: "move", vehicle, by });
};
// A speed that is the one `before` any change is none.
export const setSpeed = (changes, vehicle, mps, before) => {
  const added = find(changes, "add", vehicle);
  if (!added && Math.abs(mps - before) < SAME_MPS) return drop(changes, "speed", vehicle);
  return put(changes, added ? { ...added, mps: round(mps) } : { kind: "speed", vehicle, mps: round(mps) });
};
// Forward and left of where the vehicle is.
export const setGoal = (changes, vehicle, at) => put(changes, { kind: "goal", vehicle, at: at.map(round) });
export const switchTerm = (changes, term) => (isOff(changes, term) ? changes.filter((c) => c.term !== term) : [...changes, { kind: "without_term", term }]);
// What was done to an added vehicle goes with it.
export const without = (changes, gone) => changes.filter((c) => c.vehicle !== gone.vehicle || c.term !== gone.term || (gone.kind !== "add" && c.kind !== gone.kind));

const metres = (v, digits = 1) => `${Math.abs(v).toFixed(digits)} m`;
const ways = ([along, left]) => {
  const parts = [];
  if (Math.abs(along) >= 0.05) parts.push(`${metres(along)} ${along > 0 ? "forward" : "back"}`);
  if (Math.abs(left) >= 0.05) parts.push(`${metres(left)} to the ${left > 0 ? "left" : "right"}`);
  return parts.join(", ") || "hardly";
};
// In words; `label` says what a term is called.
export const words = (c, label = (term) => term) => ({
  remove: () => `vehicle ${c.vehicle} removed`,
  move: () => `vehicle ${c.vehicle} moved ${ways(c.by)}`,
  speed: () => `vehicle ${c.vehicle} at ${c.mps.toFixed(1)} m/s`,
  add: () => `${c.vehicle} added at ${c.mps.toFixed(1)} m/s`,
  goal: () => `vehicle ${c.vehicle} drawn to ${ways(c.at)} of it`,
  without_term: () => `${label(c.term)} switched off`,
})[c.kind]();

// The first free name for an added vehicle.
export const newName = (changes, taken) => {
  let n = 1;
  while (taken.has(`new ${n}`) || changes.some((c) => c.vehicle === `new ${n}`)) n += 1;
  return `new ${n}`;
};
