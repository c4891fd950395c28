// The page: a recording one can take hold of, with live forecasts. Here its parts meet.
import * as api from "./api.js";
import { answer, fitting, questionOf, speedsOf, worthWatching } from "./answers.js";
import * as changesOf from "./changes.js";
import { OBSERVED_S, Scene, relation } from "./draw.js";
import { hands } from "./hands.js";
import { keys } from "./keys.js";
import * as link from "./link.js";
import { NOTHING_SAID, byId, keyRows, news, options, panel, termBoxes } from "./panel.js";
import { State } from "./state.js";
import { Tracks, changedTraffic, laneAt } from "./traffic.js";

/* global gnpScene */
const SAID_MS = 6000;
const READ_MS = 15000;
const LINK_MS = 150;
const LIVE_MS = 500;
const SINCE_1970_S = 1e6; // times from here on are shown since the start of the recording
const AHEAD_M = 25; // of the watched vehicle, or half the way to his leader: where a vehicle is added by keyboard
const root = document.documentElement;

const state = new State(), scene = new Scene(byId("road"));
let recordings = [], terms = [], horizon = 5, mostAsked = Infinity, last = null, asked = "", toCheck = null, lookAround = false, wrong = -1, hovered = null, scheduled = 0, answered = 0;

// Sentences for the reader go after a while; what is wrong with the server stays until it answers.
let saying = 0, trouble = false;
const say = (text, { bad = false, ms = SAID_MS } = {}) => {
  clearTimeout(saying);
  trouble = false;
  byId("notice").textContent = text;
  byId("notice").classList.toggle("bad", bad);
  if (text && ms) saying = setTimeout(() => say(""), ms);
};
const onProblem = (problem) => {
  wrong = problem.change ?? -1;
  say(problem.status === 0 ? "The server does not answer; trying again." : `${problem.message}${/[.!?]$/.test(problem.message) ? "" : "."}`, { bad: true, ms: 0 });
  trouble = true;
  if (problem.status === 404) lookAgain();
  update();
};

const newest = new api.Newest(answer, {
  onAnswer: (question, found, ms) => {
    last = { ...found, question, speeds: speedsOf(found, question, last) };
    wrong = -1;
    if (trouble) say("");
    byId("latency").textContent = `answered in ${ms.toFixed(0)} ms`;
    answered += 1;
    if (state.watched === null && !root.dataset.ready) page.watch(worthWatching(found.forecasts, scene.road.range.x));
    update();
  },
  onProblem,
});
const tracks = new Tracks(api.tracks, { onLoaded: () => { settleTime(); check(); update(); }, onProblem: (problem) => { onProblem(problem); if (problem.passes) api.wait(1000).then(update); } });
state.snap = (time) => (tracks.recording ? tracks.snap(time) : time);

const zeroOf = (recording) => (recording?.from_s > SINCE_1970_S ? recording.from_s : 0);
const recordingOf = (name) => recordings.find((r) => r.name === name);
const recorded = () => tracks.at(state.time) ?? new Map();
const everyone = () => changedTraffic(recorded(), state.changes, fitting(last, state), state.held ? state.ahead : 0);

const page = {
  state, scene,
  everyone,
  get terms() { return terms; },
  lines: () => scene.lines,
  horizon: () => horizon,
  span: () => { const r = recordingOf(state.recording); return state.held ? [0, horizon] : r ? [r.from_s, r.to_s] : [0, 1]; },
  labelOf: (term) => terms.find((t) => t.name === term)?.label ?? term,
  wrongChange: () => wrong,
  shownTime: (time) => time - zeroOf(recordingOf(state.recording)),
  recorded: (id) => recorded().get(id)?.at ?? null,
  // Where the watched vehicle is drawn to; none while time goes on.
  goal: () => {
    const v = everyone().get(state.watched), forced = changesOf.find(state.changes, "goal", state.watched);
    if (!v || v.removed || (state.held && state.ahead > 0) || state.playing) return null;
    if (forced) return v.start.map((value, i) => value + forced.at[i]);
    const mode = fitting(last, state).forecasts.get(state.watched)?.modes[0];
    return mode?.goal ?? null;
  },
  draw: () => { if (!scheduled) scheduled = requestAnimationFrame(render); saveLink(); },
  say,
  watch: (id, look = true) => {
    state.set({ watched: id, hand: id, goalInHand: false });
    const v = everyone().get(id);
    if (v && look) { scene.bringIntoView(v.at[0]); page.draw(); }
  },
  hover: (target, event) => {
    const id = target?.id ?? null, v = id === null ? null : everyone().get(id);
    const told = v ? [`vehicle ${id}, ${v.class}, ${v.speed.toFixed(1)} m/s`, relation(id, fitting(last, state).forecasts.get(state.watched))].filter(Boolean).join("\n") : target?.goal ? "drag to force another goal" : "";
    gnpScene.showTip(byId("tip"), state.playing ? "" : told, event);
    scene.road.canvas.style.cursor = state.adding ? "crosshair" : target ? "grab" : "";
    if (id !== hovered) { hovered = id; page.draw(); }
  },
  play: () => {
    if (state.playing) { page.pause(); return; }
    saveLink.now();
    const [from, to] = page.span();
    if (state.held) state.set({ playing: true, goalInHand: false, ahead: state.ahead >= to ? 0 : state.ahead });
    else state.set({ playing: true, time: state.time >= to ? from : state.time });
    scene.following = state.watched !== null;
    clock.start();
  },
  pause: () => { if (state.playing) state.set({ playing: false, time: state.held ? state.time : state.snap(state.time) }); },
  step: (direction, far) => {
    page.pause();
    const by = direction * (far ? 1 : state.held ? 0.2 : 1 / tracks.rate);
    page.goTo((state.held ? state.ahead : state.time) + by);
  },
  goTo: (value) => {
    const [from, to] = page.span(), time = Math.min(Math.max(value, from), to);
    state.set(state.held ? { ahead: Math.round(time * 1e6) / 1e6, playing: false, goalInHand: false } : { time: state.snap(time), playing: false });
    if (scene.following || !state.held) followWatched();
  },
  end: (which) => page.goTo(page.span()[which]),
  zoom: (factor) => { scene.zoomBy(factor); page.draw(); },
  watchNext: (step) => { const id = nextOf(state.watched, step); if (id !== null) page.watch(id); },
  takeNext: (step) => { const id = nextOf(state.hand, step); if (id !== null) state.set({ hand: id, goalInHand: false, watched: state.watched ?? id }); },
  takeLeader: () => {
    const leader = fitting(last, state).forecasts.get(state.watched)?.leader;
    if (leader) state.set({ hand: leader, goalInHand: false }); else say("The watched vehicle has no leader.");
  },
  changeSpeed: (by) => {
    const v = everyone().get(state.hand);
    if (v && !v.removed) page.setSpeed(v.speed + by);
  },
  setSpeed: (mps) => {
    const v = everyone().get(state.hand), [least, most] = changesOf.SPEEDS;
    if (v && !v.removed) state.change(changesOf.setSpeed(state.changes, v.id, Math.round(10 * Math.min(Math.max(mps, least), most)) / 10, v.before), `speed ${v.id}`);
  },
  drawGoalTo: (place, gesture) => {
    const v = everyone().get(state.watched);
    if (v && !v.removed) state.change(changesOf.setGoal(state.changes, v.id, place.map((value, i) => value - v.start[i])), gesture, { goalInHand: true });
  },
  remove: () => {
    const v = everyone().get(state.hand);
    if (!v || v.removed) { say("Take a vehicle in hand first: N, J and K, or L."); return; }
    state.change(changesOf.remove(state.changes, v.id));
    state.set({ hand: v.added && state.watched === v.id ? null : state.watched, watched: v.added && state.watched === v.id ? null : state.watched });
  },
  addAt: (place) => {
    const all = everyone(), id = changesOf.newName(state.changes, all), at = [place[0], laneAt(scene.lines, place[1]).middle];
    // As fast as who is nearest.
    const near = [...all.values()].filter((v) => !v.removed).sort((a, b) => Math.hypot(a.start[0] - at[0], 5 * (a.start[1] - at[1])) - Math.hypot(b.start[0] - at[0], 5 * (b.start[1] - at[1])))[0];
    state.change(changesOf.add(state.changes, id, at, near?.speed ?? 20));
    state.set({ hand: id, goalInHand: false, watched: state.watched ?? id, adding: false });
  },
  addAhead: () => {
    const all = everyone(), v = all.get(state.watched), leader = all.get(fitting(last, state).forecasts.get(state.watched)?.leader);
    if (v) page.addAt([leader && !leader.removed ? (v.start[0] + leader.start[0]) / 2 : v.start[0] + AHEAD_M, v.start[1]]);
    else page.addAt([scene.road.centre, scene.lines[0]?.y ?? 0]);
  },
  switchTerm: (index) => { if (terms[index]) state.change(changesOf.switchTerm(state.changes, terms[index].name)); },
  reset: () => { if (state.changes.length) state.change([]); },
  copyLink: async () => {
    saveLink.now();
    try {
      await navigator.clipboard.writeText(location.href);
      say("The link is copied.");
    } catch {
      say("The link is in the address bar; the browser does not let it be copied from here.");
    }
  },
  help: () => byId("help-dialog").showModal(),
};
const nextOf = (id, step) => gnpScene.next(new Map([...everyone().values()].filter((v) => !v.removed).map((v) => [v.id, v.at])), id, step);
const followWatched = () => {
  const v = everyone().get(state.watched);
  if (v) { scene.bringIntoView(v.at[0]); page.draw(); }
};

const clock = new gnpScene.Clock((passed) => {
  if (!state.playing) return false;
  const [, to] = page.span(), name = state.held ? "ahead" : "time";
  // What is not there yet is waited for.
  if (!state.held && !tracks.at(state.time + passed)) tracks.want(state.time + passed);
  else {
    const next = Math.min(state[name] + passed, to);
    state.set({ [name]: next, playing: next < to });
  }
  return state.playing;
});

// One answer for each thing that can be asked.
const questionNow = () => questionOf(state, state.snap(state.time), everyone(), scene.road.centre, mostAsked);
const ask = () => {
  if (!state.recording || !tracks.at(state.time) || toCheck || lookAround) return;
  const question = questionNow(), key = JSON.stringify(question);
  if (key === asked) return;
  asked = key;
  newest.ask(question);
};

let saving = 0;
const saveLink = () => { clearTimeout(saving); saving = setTimeout(saveLink.now, LINK_MS); };
saveLink.now = () => { if (state.recording && !toCheck && !state.playing) history.replaceState(null, "", link.write(state, scene.view)); };

let living = 0, told = NOTHING_SAID, toTell = "";
const render = () => {
  scheduled = 0;
  if (!state.recording) return;
  const found = fitting(last, state), all = everyone(), watched = recorded().get(state.watched), v = all.get(state.watched), { explained } = found;
  const change = state.changes.length > 0;
  const model = {
    ...found, state, everyone: all, terms, hover: hovered, goal: page.goal(), simulated: recordingOf(state.recording)?.simulated,
    before: explained?.before, now: (change && explained?.after) || explained?.before,
    // A past that is made up, as with another speed, is not drawn.
    past: watched && v && !v.removed && !state.ahead && !changesOf.find(state.changes, "speed", v.id) ? tracks.past(watched, OBSERVED_S).map(([x, y]) => [x + v.start[0] - v.recorded[0], y + v.start[1] - v.recorded[1]]) : [],
  };
  scene.draw(model);
  const now = side.render(model);
  root.dataset.answered = answered;
  if (last && (state.watched !== null || !last.forecasts.size) && (last.question.watched === state.watched || !all.has(state.watched))) root.dataset.ready = "1";
  // Read aloud is what has come to rest.
  const key = JSON.stringify(now);
  if (key !== toTell && !state.playing) {
    toTell = key;
    clearTimeout(living);
    living = setTimeout(() => {
      const said = news(told, now);
      if (said) byId("live").textContent = said;
      told = now;
    }, LIVE_MS);
  }
};
const update = () => {
  if (!state.recording) return;
  tracks.want(state.time);
  ask();
  page.draw();
};
state.listen(update);

// Before another scene: the browser's Back returns to this one with its changes.
const leave = () => {
  page.pause();
  saveLink.now();
  history.pushState(null, "", location.href);
};
// A recording and its carriageway, at a time; what a link says of it is for `check`.
const open = (name, road, values = {}, said = null) => {
  toCheck = said;
  const recording = recordingOf(name), index = road ?? recording.roads[0]?.index ?? 0;
  byId("recording").value = name;
  options(byId("carriageway"), recording.roads.map((r) => [r.index, String(r.index)]));
  byId("carriageway").value = index;
  byId("carriageways").hidden = recording.roads.length < 2;
  byId("simulated").hidden = !recording.simulated;
  [last, asked] = [null, ""];
  tracks.open(recording, index);
  scene.open(recording.roads.find((r) => r.index === index) ?? { lines: [], x: [0, 100] });
  lookAround = values.time === undefined;
  delete root.dataset.ready; // who is watched is chosen anew
  state.open({ recording: name, road: index, time: recording.from_s, ...values });
};
// Where no time was asked for, the busiest one that is fetched first.
const settleTime = () => {
  if (!lookAround || !tracks.at(state.time)) return;
  lookAround = false;
  state.set({ time: tracks.busiest(state.time, OBSERVED_S) });
};

// What an address says is taken when everyone at its moment is known.
const check = () => {
  if (!toCheck || !tracks.at(state.time)) return;
  const found = toCheck, names = [...recorded().keys()];
  toCheck = null;
  const problem = link.wrongNames(found, names, terms.map((t) => t.name));
  if (problem) { say(`The link cannot be followed: ${problem}. The scene is shown as it was recorded.`, { bad: true, ms: READ_MS }); return; }
  state.open({ time: tracks.snap(state.time), watched: found.watched ?? null, hand: found.watched ?? null, changes: found.changes, held: Boolean(found.held) });
  if (found.view) scene.view = found.view; else followWatched();
};
const openLink = () => {
  let found = null, problem = null;
  try {
    found = link.read(location.hash);
    if (found) problem = link.wrongPlace(found, recordings);
  } catch (error) {
    problem = error.message;
  }
  if (problem) say(`The link cannot be followed: ${problem}. Another scene is shown.`, { bad: true, ms: READ_MS });
  if (!found || problem) { openBusiest(); return; }
  open(found.recording, found.road, found.time === undefined ? {} : { time: found.time }, found);
  check();
};

const side = panel(page);
keyRows(keys(page, hands(page)));
const onClick = (id, action) => byId(id).addEventListener("click", action);
for (const [id, action] of Object.entries({
  play: page.play, back: () => page.step(-1), forward: () => page.step(1), hold: () => (state.held ? state.release() : state.hold()),
  closer: () => page.zoom(1.4), farther: () => page.zoom(1 / 1.4), help: page.help, theme: () => { gnpScene.switchTheme(); page.draw(); },
  slower: () => page.changeSpeed(-1), faster: () => page.changeSpeed(1), watch: () => page.watch(state.hand), leader: page.takeLeader,
  "take-goal": () => state.set({ goalInHand: !state.goalInHand }), remove: page.remove, add: () => state.set({ adding: !state.adding }),
  undo: () => state.undo(), redo: () => state.redo(), reset: page.reset, copy: page.copyLink,
})) onClick(id, action);
for (const button of byId("layers").children) button.addEventListener("click", () => state.set({ shown: { ...state.shown, [button.dataset.shown]: !state.shown[button.dataset.shown] } }));
byId("time").addEventListener("input", (event) => page.goTo(Number(event.target.value)));
byId("speed").addEventListener("input", (event) => page.setSpeed(Number(event.target.value)));
byId("recording").addEventListener("change", (event) => { leave(); open(event.target.value); });
byId("carriageway").addEventListener("change", (event) => { leave(); open(state.recording, Number(event.target.value)); });
addEventListener("hashchange", openLink);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", page.draw);
new ResizeObserver(() => { scene.fitHeight(); page.draw(); }).observe(byId("frame"));

// For tests and the console: where a vehicle is, px of the window; its drawn path, m; the changes.
window.gnp = {
  where: (id) => { const v = everyone().get(String(id)), area = scene.road.canvas.getBoundingClientRect(); return v ? [area.left + scene.road.px(v.at[0]), area.top + scene.road.py(v.at[1])] : null; },
  forecast: (id) => fitting(last, state).forecasts.get(String(id))?.paths[0] ?? null,
  changes: () => structuredClone(state.changes),
  perMetre: () => [scene.road.sx, scene.road.sy],
  // When the answer to what is shown now is drawn.
  settled: async () => { while (newest.busy || scheduled || !answered || asked !== JSON.stringify(questionNow())) await api.wait(20); },
};

// A name that has the site in it says enough.
const plain = (text) => text.toLowerCase().replace(/[^a-z0-9]/g, "");
const list = (listed) => {
  recordings = listed;
  options(byId("recording"), recordings.map((r) => [r.name, plain(r.name).includes(plain(r.site)) ? r.name : `${r.name}, ${r.site}`]));
  if (!recordings.length) say("The server has no recordings.", { bad: true, ms: 0 });
  return recordings.length > 0;
};
// Where most is going on.
const openBusiest = () => {
  const busy = (r) => r.vehicles / Math.max(r.to_s - r.from_s, 1);
  open(recordings.reduce((a, b) => (busy(b) > busy(a) ? b : a)).name);
};
// A server that was started anew may have other recordings.
let looking = false;
const lookAgain = async () => {
  if (looking) return;
  looking = true;
  try {
    const listed = (await api.recordings()).recordings, gone = state.recording;
    if (listed.some((r) => r.name === gone)) return;
    leave();
    if (!list(listed)) return;
    openBusiest();
    say(`Recording ${gone} is not served any more. Another scene is shown.`, { bad: true, ms: READ_MS });
  } catch (problem) {
    if (!(problem instanceof api.Problem)) throw problem; // a server that goes again is missed by the next question
  } finally {
    looking = false;
  }
};

const start = async () => {
  let served = [];
  for (let failures = 0; ; failures += 1) {
    try {
      const [card, listed] = await Promise.all([api.model(), api.recordings()]);
      ({ terms } = card);
      horizon = card.predicted_s ?? 5;
      mostAsked = card.max_vehicles ?? Infinity;
      byId("model").textContent = card.name ? `model ${card.name}` : "";
      served = listed.recordings;
      break;
    } catch (problem) {
      onProblem(problem);
      if (!problem.passes) return;
      await api.wait(api.patience(failures, problem));
    }
  }
  say("");
  termBoxes(terms, (name) => state.change(changesOf.switchTerm(state.changes, name)));
  if (list(served)) openLink();
};
start();
