// Everything by keyboard: one list of keys, which the help shows, too.
import * as changesOf from "./changes.js";
import { laneAt } from "./traffic.js";

const FAR_M = 10;
const ACROSS_M = 0.5;

// `page` as in hands.js, which gives the other two.
export const keys = (page, { letGo, dragging }) => {
  const { state } = page;
  // Steps of the vehicle in hand, or of the goal, while a moment is held.
  const push = ([along, left], far) => {
    if (state.goalInHand) {
      const goal = page.goal(), width = laneAt(page.lines(), goal?.[1] ?? 0).width;
      if (goal) page.drawGoalTo([goal[0] + along * (far ? FAR_M : 1), goal[1] + left * (far ? width : ACROSS_M)], "push goal");
      return;
    }
    const v = page.everyone().get(state.hand);
    if (!v || v.removed) { page.say("Take a vehicle in hand first: N, J and K, or L."); return; }
    const width = laneAt(page.lines(), v.start[1]).width, place = [v.start[0] + along * (far ? FAR_M : 1), v.start[1] + left * (far ? width : ACROSS_M)];
    state.change(changesOf.move(state.changes, v.id, place, v.recorded), `push ${v.id}`);
  };
  // In the recording the arrows are time.
  const arrow = (along, left) => (event) => {
    if (state.held) push([along, left], event.shiftKey);
    else if (along) page.step(along, event.shiftKey);
  };
  const toggle = (name) => () => state.set({ shown: { ...state.shown, [name]: !state.shown[name] } });
  const escape = () => {
    if (letGo()) return;
    if (state.adding) state.set({ adding: false });
    else state.release();
  };

  const list = [
    ["Space", [" "], "play and pause; of a held moment, its next 5 s", page.play],
    ["← →", ["ArrowLeft", "ArrowRight"], "a step in time, with Shift a second; of a held moment: the vehicle in hand 1 m back or forward, with Shift 10 m", null],
    ["↑ ↓", ["ArrowUp", "ArrowDown"], "of a held moment: the vehicle in hand 0.5 m to the left or right, with Shift a lane", null],
    [", .", [",", "."], "a step in time, back or forward", null],
    ["G", ["g"], "take hold of the moment", () => state.hold()],
    ["Esc", ["Escape"], "let go of what is dragged; else back to the recording", escape],
    ["N P", ["n", "p"], "watch the next or previous vehicle", null],
    ["J K", ["j", "k"], "take the previous or next vehicle in hand", null],
    ["L", ["l"], "take the leader of the watched vehicle in hand", page.takeLeader],
    ["W", ["w"], "watch the vehicle in hand", () => state.hand !== null && page.watch(state.hand)],
    ["T", ["t"], "take the goal of the watched vehicle in hand: arrows move it", () => state.set({ goalInHand: page.goal() !== null && !state.goalInHand })],
    ["+ −", ["+", "-", "=", "_"], "1 m/s faster or slower", null],
    ["Del", ["Delete", "Backspace"], "remove the vehicle in hand", page.remove],
    ["A, Enter", ["a"], "add a vehicle: by a click, or with Enter in front of the watched one", () => state.set({ adding: !state.adding })],
    ["1 to 9", [..."123456789"], "switch a term of the force off and on", (event) => page.switchTerm(Number(event.key) - 1)],
    ["Ctrl Z, Ctrl Shift Z", [], "undo, redo", null],
    ["R", ["r"], "take all changes back", page.reset],
    ["F M B O", ["f", "m", "b", "o"], "show forces, other futures, neighbours, the paths of others", null],
    ["I U", ["i", "u"], "zoom in and out", null],
    ["Home End", ["Home", "End"], "the start and the end", null],
    ["C", ["c"], "copy the link", page.copyLink],
    ["?", ["?"], "this list", page.help],
  ];
  const actions = Object.fromEntries(list.flatMap(([, names, , action]) => (action ? names.map((name) => [name, action]) : [])));
  Object.assign(actions, {
    ArrowLeft: arrow(-1, 0), ArrowRight: arrow(1, 0), ArrowUp: arrow(0, 1), ArrowDown: arrow(0, -1),
    ",": () => page.step(-1), ".": () => page.step(1),
    n: () => page.watchNext(1), p: () => page.watchNext(-1), j: () => page.takeNext(-1), k: () => page.takeNext(1),
    "+": () => page.changeSpeed(1), "=": () => page.changeSpeed(1), "-": () => page.changeSpeed(-1), _: () => page.changeSpeed(-1),
    f: toggle("forces"), m: toggle("futures"), b: toggle("neighbours"), o: toggle("paths"),
    i: () => page.zoom(1.4), u: () => page.zoom(1 / 1.4),
    Home: () => page.end(0), End: () => page.end(1),
    Enter: () => state.adding && page.addAhead(),
  });

  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (document.querySelector("dialog[open]")) return;
    // A drag is one step: what happens within it only ends it.
    if (dragging() && key !== "Escape") { event.preventDefault(); return; }
    if ((event.ctrlKey || event.metaKey) && !event.altKey) {
      const name = key.toLowerCase();
      if (name !== "z" && name !== "y") return;
      event.preventDefault();
      if (name === "y" || event.shiftKey) state.redo(); else state.undo();
      return;
    }
    if (event.altKey || event.metaKey) return;
    // Sliders, lists and buttons have keys of their own.
    const own = target.matches("select") || (target.matches("input[type=range]") && /^(Arrow|Home|End|Page)/.test(key)) || (target.matches("button, input[type=checkbox], summary, a") && (key === " " || key === "Enter"));
    const action = actions[key] ?? actions[key.toLowerCase()];
    if (own || !action || (!target.closest("main, header") && target !== document.body)) return;
    // Arrows scroll where nothing is steered by them.
    if (/^(Arrow(Up|Down)|Home|End)$/.test(key) && target !== page.scene.road.canvas && target !== document.body) return;
    if (/^Arrow(Up|Down)$/.test(key) && !state.held) return;
    if (key === "Enter" && !state.adding) return;
    event.preventDefault();
    action(event);
  });
  return list.map(([names, , meaning]) => [names, meaning]);
};
