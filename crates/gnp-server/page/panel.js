// What stands around the road: who is watched and why he goes where, who is in hand, the changes, the forces.
import * as changesOf from "./changes.js";
import { relation } from "./draw.js";

/* global gnpScene */
const { parameterChart, SLOTS } = gnpScene;
const MOST_CAUSES = 8;
const NOTHING_M = 0.05;

export const byId = (id) => document.getElementById(id);
const element = (name, text, attributes = {}) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};
const signed = (v, digits = 1) => (Math.abs(v) < 0.5 * 10 ** -digits ? (0).toFixed(digits) : `${v < 0 ? "−" : "+"}${Math.abs(v).toFixed(digits)}`);
const say = (id, text) => { if (byId(id).textContent !== text) byId(id).textContent = text; };
const show = (id, shown) => { byId(id).hidden = !shown; };
const seconds = (v) => `${v.toFixed(1)} s`;

// The parts of a side of an explanation at its end, m: the largest first, small ones together.
const causesOf = (side, nameOf) => {
  const rows = side.parts.map((part) => ({ name: nameOf(part), by: part.displacement.at(-1) }));
  const start = side.constant_velocity?.at(-1) ?? [0, 0];
  if (side.isChange && Math.hypot(...start) > NOTHING_M) rows.push({ name: "constant velocity", by: start });
  rows.sort((a, b) => Math.hypot(...b.by) - Math.hypot(...a.by));
  const large = rows.filter(({ by }, i) => i < MOST_CAUSES && by.some((v) => Math.abs(v) >= NOTHING_M));
  const rest = rows.filter((row) => !large.includes(row)).reduce((sum, { by }) => [sum[0] + by[0], sum[1] + by[1]], [0, 0]);
  if (rest.some((v) => Math.abs(v) >= NOTHING_M)) large.push({ name: "the rest", by: rest });
  return large;
};

const causeTable = (side, after, nameOf) => {
  const rows = causesOf(side, nameOf), sum = side.isChange ? side.path.at(-1) : side.sum.at(-1), most = Math.max(...rows.map(({ by }) => Math.abs(by[0])), 1);
  byId("causes").caption.textContent = side.isChange ? `What the changes do to the path in ${after}, m` : `What moves it in ${after} away from constant velocity, m`;
  const row = ({ name, by }, total = false) => {
    const line = element("tr", undefined, total ? { class: "total" } : {}), cell = element("td"), bar = element("div", undefined, { class: by[0] < 0 ? "bar back" : "bar on" });
    if (!total) { bar.style.width = `${(50 * Math.abs(by[0])) / most}%`; cell.append(bar); }
    line.append(element("th", name, { scope: "row" }), cell, element("td", signed(by[0])), element("td", signed(by[1])));
    return line;
  };
  byId("causes").tBodies[0].replaceChildren(...rows.map((one) => row(one)), row({ name: side.isChange ? "difference" : "together", by: sum }, true));
};

// `model` is what draw.js gets, and `leftOut` by name, `explained`.
// `render` gives what there is to read aloud.
export const panel = (page) => {
  const { state } = page;
  let listed = "";
  // As the term is called elsewhere; the free road of the causes is what the driver does without others: two terms.
  const nameOf = ({ cause, kind }) => (kind === "term" ? page.labelOf(cause) : kind === "free_road" ? "free road and habit" : cause);

  const why = ({ everyone, forecasts, leftOut, explained }) => {
    const v = everyone.get(state.watched), f = forecasts.get(state.watched);
    say("watched", v ? `Vehicle ${v.id}` : state.watched === null ? "Nobody is watched" : `Vehicle ${state.watched} is not there`);
    const facts = [];
    if (v) facts.push(v.class, v.removed ? "removed" : `${v.speed.toFixed(1)} m/s`);
    if (f) {
      facts.push(f.leader ? `behind ${f.leader}` : "nobody ahead");
      if (f.past === "filled") facts.push(`seen for only ${seconds(f.observed_s)}`);
      if (f.modes.length > 1) facts.push(`futures ${f.modes.map((m) => `${(100 * m.probability).toFixed(0)}\u00a0%`).join(", ")}`);
    }
    say("facts", facts.join(" · "));
    const side = explained?.change ?? explained?.before ?? explained?.after, left = leftOut.get(state.watched);
    const told = !v ? (state.watched === null ? "Click a vehicle, or press N." : "")
      : left ? `It has no forecast: ${left}.`
      : explained?.problem ?? side?.sentence ?? "";
    say("sentence", told);
    show("causes", Boolean(side) && Boolean(v) && !left);
    if (side && v) causeTable(side, seconds(side.parts[0] ? side.parts[0].displacement.length * side.dt : page.horizon()), nameOf);
    return told;
  };

  const hand = ({ everyone, forecasts }) => {
    const v = everyone.get(state.hand), f = forecasts.get(state.watched), usable = Boolean(v) && !v.removed && !state.goalInHand;
    say("in-hand", state.goalInHand ? `In hand: the goal of vehicle ${state.watched}` : v ? `In hand: ${v.added ? "" : "vehicle "}${v.id}` : "Nothing in hand");
    const goal = page.goal(), at = forecasts.get(state.watched)?.at;
    const related = v && v.id !== state.watched ? relation(v.id, f) : "";
    say("hand-facts", state.goalInHand ? (goal && at ? `${(goal[0] - at[0]).toFixed(1)} m ahead, ${signed(goal[1] - at[1])} m to the left` : "")
      : v ? [v.removed ? "removed" : "", related && `${related} of ${state.watched}`.replace("its leader of", "leader of"), `${v.size[0].toFixed(1)} × ${v.size[1].toFixed(1)} m`].filter(Boolean).join(" · ") : "Click a vehicle, or press J and K.");
    for (const id of ["speed", "slower", "faster", "remove"]) byId(id).disabled = !usable;
    byId("watch").disabled = !usable || v.id === state.watched;
    say("leader", f?.leader ? `Take leader ${f.leader}` : "Take the leader");
    byId("leader").disabled = !f?.leader || (state.hand === f.leader && !state.goalInHand);
    byId("take-goal").disabled = goal === null;
    byId("take-goal").setAttribute("aria-pressed", state.goalInHand);
    byId("add").setAttribute("aria-pressed", state.adding);
    if (v && !state.goalInHand) {
      if (document.activeElement !== byId("speed") || Math.abs(Number(byId("speed").value) - v.speed) > 0.5) byId("speed").value = v.speed;
      say("speed-value", `${v.speed.toFixed(1)} m/s`);
    } else say("speed-value", "");
  };

  const changes = () => {
    // Not made anew without need: a button with the focus would lose it.
    const key = JSON.stringify([state.changes, page.wrongChange()]);
    byId("undo").disabled = !state.canUndo;
    if (key !== listed) {
      listed = key;
      const focused = [...byId("changes").querySelectorAll("button")].indexOf(document.activeElement);
      byId("changes").replaceChildren(...state.changes.map((c, i) => {
        const item = element("li", undefined, i === page.wrongChange() ? { class: "wrong" } : {}), said = changesOf.words(c, page.labelOf);
        const button = element("button", "✕", { "aria-label": `Take back: ${said}`, title: "Take back" });
        // Clicked twice, it may be gone already.
        button.addEventListener("click", () => {
          const rest = changesOf.without(state.changes, c);
          if (rest.length < state.changes.length) state.change(rest);
        });
        item.append(element("span", said), button);
        return item;
      }));
      // Whoever took one back by keyboard goes on from there.
      if (focused >= 0) ([...byId("changes").querySelectorAll("button")].slice(0, focused + 1).at(-1) ?? byId(state.canUndo ? "undo" : "road")).focus();
    }
    show("unchanged", !state.changes.length);
    byId("redo").disabled = !state.canRedo;
    byId("reset").disabled = !state.changes.length;
  };

  const forces = ({ now, forecasts, behind }) => {
    for (const box of byId("terms").querySelectorAll("input")) box.checked = !changesOf.isOff(state.changes, box.value);
    for (const button of byId("layers").children) button.setAttribute("aria-pressed", state.shown[button.dataset.shown]);
    const neighbours = forecasts.get(state.watched)?.neighbours ?? [];
    if (!now?.parameters.length) { parameterChart(byId("chart"), { empty: "Parameters of the forces over the forecast of the watched vehicle" }); return; }
    const panels = now.parameters.map((p) => ({
      title: `${p.title} ${p.name} (${p.unit})`, slots: p.slots, values: p.values.map((v) => (Array.isArray(v) ? v : [v])),
      colour: page.terms.find((t) => t.name === p.term)?.colour ?? "#777777",
    }));
    const end = now.parameters[0].values.length * now.dt;
    parameterChart(byId("chart"), { panels, present: SLOTS.map((_, i) => i).filter((i) => neighbours[i]), every: now.dt, end, now: Math.min(state.held ? state.ahead : behind, end) });
  };

  const transport = () => {
    const slider = byId("time"), [from, to] = page.span(), value = state.held ? state.ahead : state.time;
    if (Number(slider.min) !== from || Number(slider.max) !== to) [slider.min, slider.max, slider.step] = [from, to, state.held ? 0.1 : 0.02];
    slider.value = value;
    slider.setAttribute("aria-valuetext", state.held ? `${seconds(value)} after the held moment` : seconds(page.shownTime(value)));
    say("clock", state.held ? `+${seconds(state.ahead)}` : seconds(page.shownTime(state.time)));
    say("play", state.playing ? "Pause" : "Play");
    say("hold", state.held ? "Back to the recording" : "Take hold");
    show("moment", state.held);
    const count = state.changes.length;
    say("moment", `held at ${seconds(page.shownTime(state.time))}${count ? `, ${count} change${count > 1 ? "s" : ""}` : ""}${state.ahead ? `, driven on ${seconds(state.ahead)}` : ""}`);
    byId("road").classList.toggle("adding", state.adding);
  };

  return { render: (model) => { transport(); hand(model); changes(); forces(model); return { sentence: why(model), hand: byId("in-hand").textContent, changes: state.changes.map((c) => changesOf.words(c, page.labelOf)) }; } };
};
export const NOTHING_SAID = { sentence: "", hand: "", changes: [] };
// What of `now` is new to who has heard `told`; both as `render` gives them.
export const news = (told, now) => {
  const [more, gone] = [[now, told], [told, now]].map(([a, b]) => a.changes.filter((words) => !b.changes.includes(words)).join("; "));
  return [now.hand !== told.hand && now.hand, more || (gone && `No longer: ${gone}`), now.sentence !== told.sentence && now.sentence].filter(Boolean).map((text) => text.replace(/[.]?$/, ".")).join(" ");
};

// Boxes that switch terms of the force.
export const termBoxes = (terms, onSwitch) => byId("terms").replaceChildren(...terms.map((term, i) => {
  const label = element("label", undefined, { class: "term", title: i < 9 ? String(i + 1) : "" }), box = element("input", undefined, { type: "checkbox", value: term.name });
  const swatch = element("span", "", { class: "swatch", "aria-hidden": "true" });
  swatch.style.background = term.colour;
  box.checked = true;
  box.addEventListener("change", () => onSwitch(term.name));
  label.append(box, swatch, term.label);
  return label;
}));
export const options = (select, values) => select.replaceChildren(...values.map(([value, text]) => element("option", text, { value })));
export const keyRows = (list) => byId("keys").replaceChildren(...list.map(([names, meaning]) => {
  const line = element("tr");
  line.append(element("th", names, { scope: "row" }), element("td", meaning));
  return line;
}));
