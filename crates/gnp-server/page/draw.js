// The road on its canvas: who is there, where they go, what moves the watched one, what was before the changes.

/* global gnpScene */
const { Road, COLOURS, SLOTS, along } = gnpScene;

// px for 1 m/s²; an arrow that would be longer than that, px, is cut and says how strong it is.
const FORCE_PX = 40;
const LONGEST_PX = 130;
// A future that ends farther from the first one, m along and across, is labelled.
const APART_M = [6, 1];
const GOAL_PX = 9;
export const OBSERVED_S = 3; // before a moment
const METRE_PX = 13; // of a metre across the road
const HEIGHTS = [180, 370]; // of the canvas, px
const SPANS_M = 40; // the least that is shown
const LETTERS = "12px system-ui, sans-serif";

export class Scene {
  constructor(canvas) {
    this.road = new Road(canvas);
    this.lines = [];
    this.following = true;
  }
  // A carriageway as the server describes it.
  open({ lines, x }) {
    const { road } = this, ys = lines.map((line) => line.y);
    this.lines = lines.map(({ y, kind }) => ({ y, boundary: kind === "boundary" }));
    road.range = { x: [x[0] - 20, Math.max(x[1] + 20, x[0] + 100)], y: ys.length ? [Math.min(...ys) - 2.5, Math.max(...ys) + 2.5] : [-8, 8] };
    this.fitHeight();
    const [from, to] = road.range.x, narrow = road.canvas.clientWidth < 560;
    road.zoom = this.limit(((to - from) * (narrow ? 3.6 : 7)) / Math.max(road.canvas.clientWidth, 1));
    road.centre = (from + to) / 2;
    this.following = true;
  }
  fitHeight() {
    const { canvas, range } = this.road, wanted = (range.y[1] - range.y[0]) * METRE_PX;
    canvas.style.height = `${Math.min(Math.max(wanted, HEIGHTS[0]), canvas.clientWidth < 560 ? 260 : HEIGHTS[1])}px`;
  }
  limit(zoom) { return Math.min(Math.max(zoom, 1), (this.road.range.x[1] - this.road.range.x[0]) / SPANS_M); }
  get view() {
    const { centre, range, zoom } = this.road;
    return { centre, span: (range.x[1] - range.x[0]) / zoom };
  }
  set view({ centre, span }) {
    this.road.zoom = this.limit((this.road.range.x[1] - this.road.range.x[0]) / span);
    this.road.centre = centre;
    this.keepInside();
    this.following = false;
  }
  // The road stays in sight.
  keepInside() {
    const { road } = this, [from, to] = road.range.x;
    road.centre = road.zoom === 1 ? (from + to) / 2 : Math.min(Math.max(road.centre, from), to);
  }
  // Around a point of the canvas that stays where it is.
  zoomBy(factor, pointer = [this.road.width / 2, 0]) {
    const { road } = this, before = road.place(pointer)[0];
    road.zoom = this.limit(road.zoom * factor);
    road.measure();
    road.centre += before - road.place(pointer)[0];
    this.keepInside();
  }
  panBy(px) {
    this.road.centre -= px / this.road.sx;
    this.following = false;
    this.keepInside();
  }
  // A bit of what was, more of what comes.
  follow(x) {
    const { span } = this.view;
    if (this.road.zoom > 1) this.road.centre = x + span * 0.22;
  }
  bringIntoView(x) {
    const { centre, span } = this.view;
    if (x < centre - span * 0.45 || x > centre + span * 0.3) this.follow(x);
  }

  // Of what is under a point, px: the goal, a vehicle's name, or null.
  goalUnder(pointer, goal, reach = 14) {
    return goal !== null && Math.hypot(this.road.px(goal[0]) - pointer[0], this.road.py(goal[1]) - pointer[1]) <= reach;
  }
  vehicleUnder(pointer, everyone, reach = 6) {
    const far = (v) => Math.hypot(this.road.px(v.at[0]) - pointer[0], this.road.py(v.at[1]) - pointer[1]);
    const found = [...everyone.values()].filter((v) => !v.removed && this.road.covers(pointer, v.at, v.size, reach));
    return found.length ? found.reduce((a, b) => (far(a) <= far(b) ? a : b)).id : null;
  }

  // `everyone` as `changedTraffic` gives it; `forecasts` by name; `before` and `now` the watched one's explained sides.
  draw({ state, everyone, forecasts, before, now, goal, terms, hover, simulated, behind, past }) {
    const { road } = this, watched = everyone.get(state.watched), shown = state.shown;
    if (this.following && watched && !watched.removed) this.follow(watched.at[0]);
    road.begin(this.lines, [3, 9].map((m) => m * road.sx), road.centre * road.sx - road.width / 2);
    const { look, pen } = road, forecast = forecasts.get(state.watched);
    const step = (f) => (state.held ? state.ahead : behind) / f.dt;
    const rest = (f, path) => [along(path, step(f)), ...path.slice(Math.floor(step(f)) + 1)];
    for (const v of everyone.values()) if (v.recorded && (v.removed || v.start !== v.recorded)) this.ghost(v, look);
    if (shown.paths) {
      pen.globalAlpha = 0.5;
      for (const [id, f] of forecasts) if (id !== state.watched) road.stroke(rest(f, f.paths[0]), look.past, 1.2);
      pen.globalAlpha = 1;
    }
    if (past.length > 1) road.stroke(past, look.past, 2.5);
    const compared = before && state.changes.length > 0;
    if (forecast) {
      if (shown.futures) for (const path of forecast.paths.slice(1)) road.stroke(rest(forecast, path), COLOURS.others, 1.8);
      road.stroke(rest(forecast, forecast.paths[0]), look.best, compared ? 4 : 3);
    }
    if (compared) this.before(before, state, watched, look);
    const near = new Set(forecast && shown.neighbours ? forecast.neighbours.filter(Boolean) : []);
    for (const v of everyone.values()) if (!v.removed) this.vehicle(v, { state, near, hover, look, leader: forecast?.leader });
    if (shown.futures && forecast?.modes.length > 1) this.ends(forecast, look);
    if (goal) this.goal(goal, state, look);
    const acts = shown.forces && now && watched && !watched.removed && terms.length > 0;
    if (acts) this.arrows(watched.at, now.forces, Math.floor(step(now)), look);
    this.labels({ state, everyone, hover, leader: forecast?.leader }, look);
    road.legend({ scale: acts ? FORCE_PX : 0, simulated });
  }
  vehicle(v, { state, near, hover, look, leader }) {
    const { road } = this, inHand = v.id === state.hand && !state.goalInHand;
    const fill = v.id === state.watched ? COLOURS.target : near.has(v.id) || v.id === leader ? look.near : look.test;
    const rim = inHand || v.id === hover ? look.ink : near.has(v.id) || v.id === leader ? COLOURS.neighbours : look.hull;
    road.box(v.size, v.at, fill, rim, { round: 5, width: inHand ? 2.5 : v.id === hover ? 2 : 1, dash: v.added && !inHand ? [3, 2] : [] });
  }
  ghost(v, look) {
    const { road } = this, { pen } = road;
    pen.globalAlpha = 0.75;
    road.box(v.size, v.recorded, null, look.past, { dash: [4, 3], round: 5, width: 1.5 });
    if (v.removed) {
      const [x, y] = [road.px(v.recorded[0]), road.py(v.recorded[1])];
      pen.strokeStyle = look.past; pen.lineWidth = 1.5;
      pen.beginPath(); pen.moveTo(x - 5, y - 5); pen.lineTo(x + 5, y + 5); pen.moveTo(x + 5, y - 5); pen.lineTo(x - 5, y + 5); pen.stroke();
    } else road.stroke([v.recorded, v.start], look.past, 1, [2, 3]);
    pen.globalAlpha = 1;
  }
  goal(at, state, look) {
    const { pen } = this.road, [x, y] = [this.road.px(at[0]), this.road.py(at[1])], forced = state.changes.some((c) => c.kind === "goal" && c.vehicle === state.watched);
    pen.beginPath(); pen.arc(x, y, GOAL_PX, 0, 2 * Math.PI);
    pen.fillStyle = forced ? "#f5c400" : look.paper; pen.globalAlpha = forced ? 1 : 0.75; pen.fill(); pen.globalAlpha = 1;
    pen.strokeStyle = state.goalInHand ? look.ink : "#8a6d00"; pen.lineWidth = state.goalInHand ? 3 : 2; pen.stroke();
    pen.beginPath(); pen.moveTo(x - 4, y); pen.lineTo(x + 4, y); pen.moveTo(x, y - 4); pen.lineTo(x, y + 4); pen.strokeStyle = forced ? "#1d2229" : look.ink; pen.lineWidth = 1.2; pen.stroke();
  }
  // Letters on paper, so that they can be read on anything; where others stand already, above them, or not at all.
  text(words, x, y, look, taken, { bold = false, above = true } = {}) {
    const { pen, width } = this.road;
    pen.font = bold ? `600 ${LETTERS}` : LETTERS;
    const w = pen.measureText(words).width + 6, left = Math.min(Math.max(x - w / 2, 2), width - w - 2);
    let top = Math.max(y - 8, 2);
    const hidden = () => taken.some((t) => left < t.left + t.w && t.left < left + w && Math.abs(top - t.top) < 16);
    while (above && hidden()) top -= 16;
    if (top < 0 || hidden()) return;
    taken.push({ left, top, w });
    pen.fillStyle = look.paper; pen.globalAlpha = 0.82; pen.beginPath(); pen.roundRect(left, top, w, 16, 4); pen.fill(); pen.globalAlpha = 1;
    pen.fillStyle = look.ink; pen.fillText(words, left + 3, top + 12);
  }
  // What was before, on top of what is: both are seen where one hides the other.
  before({ path, pathDt }, state, watched, look) {
    const { road } = this, box = { dash: [4, 3], round: 4, width: 1.5 }, end = path.at(-1);
    road.stroke(path, look.past, 2, [7, 5]);
    if (!watched) return;
    road.box(watched.size, end, null, look.past, box);
    this.text("before", road.px(end[0]), road.py(end[1]) + (watched.size[1] * road.sy) / 2 + 10, look, []);
    if (state.ahead > 0) road.box(watched.size, along(path, state.ahead / pathDt), null, look.past, box);
  }
  // Where each future ends: a dot whose area is its probability.
  ends(forecast, look) {
    const { road } = this, { pen } = road, first = forecast.paths[0].at(-1), taken = [], last = forecast.modes.length - 1;
    for (let i = last; i >= 0; i -= 1) {
      const [x, y] = forecast.paths[i].at(-1);
      pen.beginPath(); pen.arc(road.px(x), road.py(y), 10 * Math.sqrt(forecast.modes[i].probability), 0, 2 * Math.PI);
      pen.fillStyle = i ? COLOURS.others : look.best; pen.fill(); pen.strokeStyle = look.paper; pen.lineWidth = 1; pen.stroke();
    }
    forecast.modes.forEach(({ probability }, i) => {
      const end = forecast.paths[i].at(-1), [x, y] = [road.px(end[0]), road.py(end[1])];
      const apart = i === 0 || APART_M.some((m, axis) => Math.abs(end[axis] - first[axis]) > m);
      if (apart && x > 0 && x < road.width) this.text(`${(100 * probability).toFixed(0)} %`, x, y - GOAL_PX - 11, look, taken, { bold: i === 0, above: false });
    });
  }
  arrows(at, forces, i, look) {
    const { road } = this, taken = [];
    for (const { values, colour } of forces.toReversed()) {
      if (!values.length) continue;
      const force = values[Math.min(i, values.length - 1)], size = Math.hypot(...force), cut = Math.min(LONGEST_PX / (size * FORCE_PX), 1);
      const [fx, fy] = force.map((v) => v * cut);
      road.arrow(at, [fx, fy], FORCE_PX, colour);
      if (cut < 1) this.text(`${size.toFixed(1)} m/s²`, road.px(at[0]) + fx * FORCE_PX, road.py(at[1]) - fy * FORCE_PX + 14, look, taken);
    }
  }
  labels({ state, everyone, hover, leader }, look) {
    const { road } = this, taken = [];
    for (const id of new Set([state.watched, state.hand, leader, hover])) {
      const v = everyone.get(id);
      if (!v || v.removed) continue;
      const x = road.px(v.at[0]);
      if (x > -20 && x < road.width + 20) this.text(`${id}${(id === hover || id === state.hand) && !state.ahead ? ` · ${v.speed.toFixed(1)} m/s` : ""}`, x, road.py(v.at[1]) - (v.size[1] * road.sy) / 2 - 10, look, taken, { bold: id === state.watched });
    }
  }
}

// What a vehicle is to the watched one, in words.
export const relation = (id, forecast) => {
  if (!forecast) return "";
  if (id === forecast.leader) return "its leader";
  const slot = forecast.neighbours.indexOf(id);
  return slot < 0 ? "" : SLOTS[slot];
};
