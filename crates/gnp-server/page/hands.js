// Pointer, touch and wheel on the road: what is taken, dragged, picked, panned, zoomed.
import * as changesOf from "./changes.js";
import { DRAG } from "./state.js";

const THRESHOLD_PX = { mouse: 4, pen: 6, touch: 9 };
const REACH_PX = { mouse: 6, pen: 12, touch: 20 };
const LONG_PRESS_MS = 550;
// Less than this across the road, m, is an unsteady hand.
const UNSTEADY_M = 0.5;
const PX_PER_NOTCH = 100;

// `page` has state, scene, everyone(), goal(), recorded(id), draw().
export const hands = (page) => {
  const { state, scene } = page, { canvas } = scene.road;
  const pointers = new Map();
  let drag = null, pinch = null, press = 0;

  const reach = (event, of) => of[event.pointerType] ?? of.mouse;
  const under = (event) => {
    const point = scene.road.pointer(event);
    if (scene.goalUnder(point, page.goal(), reach(event, REACH_PX) + 8)) return { goal: true };
    const id = scene.vehicleUnder(point, page.everyone(), reach(event, REACH_PX));
    return id === null ? null : { id };
  };
  const takeInHand = (id) => state.set({ hand: id, goalInHand: false, watched: state.watched ?? id });

  const startDrag = (event) => {
    const { target } = drag;
    clearTimeout(press);
    drag.moving = true;
    page.hover(null, event);
    page.pause();
    if (target?.id !== undefined) {
      const v = page.everyone().get(target.id);
      if (!v || v.removed) { drag = null; return; }
      // What is dragged while its forecasts are driven is dragged from where it was at the moment.
      drag.from = v.start;
      takeInHand(target.id);
    } else if (target?.goal) {
      drag.from = page.goal();
      state.set({ goalInHand: true });
    }
    canvas.classList.add("dragging");
    moveDrag(event);
  };
  // Along and across; with shift only where it has moved most.
  const moved = (event) => {
    const { road } = scene, by = [(event.clientX - drag.x) / road.sx, -(event.clientY - drag.y) / road.sy];
    if (event.shiftKey) by[Math.abs(by[0] * road.sx) >= Math.abs(by[1] * road.sy) ? 1 : 0] = 0;
    else if (Math.abs(by[1]) < UNSTEADY_M) by[1] = 0;
    return by;
  };
  const moveDrag = (event) => {
    const { target } = drag;
    if (!target) {
      scene.panBy(event.clientX - drag.lastX);
      drag.lastX = event.clientX;
      page.draw();
      return;
    }
    // It can go meanwhile, by another finger on a button, or with the whole scene.
    const v = target.goal ? null : page.everyone().get(target.id), recorded = page.recorded(target.id);
    if (!target.goal && (!v || v.removed || (!v.added && !recorded))) { stop(); return; }
    const by = moved(event), place = drag.from.map((value, i) => value + by[i]);
    if (target.goal) page.drawGoalTo(place, DRAG);
    else state.change(changesOf.move(state.changes, target.id, place, recorded), DRAG);
  };
  const click = (event, target) => {
    if (state.adding) page.addAt(scene.road.place(scene.road.pointer(event)));
    else if (target?.goal) state.set({ goalInHand: !state.goalInHand });
    else if (target && event.shiftKey) takeInHand(target.id);
    else if (target) { page.watch(target.id, false); }
    else state.set({ hand: state.watched, goalInHand: false });
  };
  // The one end of every drag; of a `cancelled` one, all is as it was before.
  const stop = (cancelled = false) => {
    clearTimeout(press);
    canvas.classList.remove("dragging");
    if (cancelled && drag?.moving && drag.target) state.cancelDrag();
    state.endGesture();
    drag = null;
  };
  const end = (event, cancelled) => {
    pointers.delete(event.pointerId);
    if (pinch) { if (pointers.size < 2) pinch = null; stop(); return; }
    if (!drag || drag.pointer !== event.pointerId) return;
    const { moving, target, done } = drag;
    stop(cancelled);
    if (!moving && !cancelled && !done) click(event, target);
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
    if (pointers.size === 2) {
      // A second finger: what the first one dragged stays where it was.
      stop(true);
      pinch = { ...spread() };
      return;
    }
    drag = { pointer: event.pointerId, x: event.clientX, y: event.clientY, lastX: event.clientX, target: state.adding ? null : under(event), moving: false };
    if (drag.target?.id !== undefined && event.pointerType === "touch") press = setTimeout(() => { if (drag && !drag.moving) { drag.done = true; takeInHand(drag.target.id); } }, LONG_PRESS_MS);
  });
  const spread = () => {
    const [a, b] = [...pointers.values()].map((event) => scene.road.pointer(event));
    return { wide: Math.max(Math.hypot(a[0] - b[0], a[1] - b[1]), 20), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
  };
  canvas.addEventListener("pointermove", (event) => {
    if (pointers.has(event.pointerId)) pointers.set(event.pointerId, event);
    if (pinch && pointers.size >= 2) {
      const now = spread();
      scene.panBy(now.middle[0] - pinch.middle[0]);
      scene.zoomBy(now.wide / pinch.wide, now.middle);
      pinch = now;
      page.draw();
    } else if (drag?.pointer === event.pointerId) {
      if (!drag.moving && !drag.done && Math.hypot(event.clientX - drag.x, event.clientY - drag.y) > reach(event, THRESHOLD_PX)) startDrag(event);
      else if (drag.moving) moveDrag(event);
    } else if (event.pointerType === "mouse") page.hover(under(event), event);
  });
  canvas.addEventListener("pointerup", (event) => end(event, false));
  canvas.addEventListener("pointercancel", (event) => end(event, true));
  canvas.addEventListener("pointerleave", (event) => page.hover(null, event));
  canvas.addEventListener("contextmenu", (event) => {
    const target = under(event);
    if (target?.id === undefined) return;
    event.preventDefault();
    takeInHand(target.id);
  });
  // One finger beside all vehicles scrolls the page up and down.
  canvas.addEventListener("touchstart", (event) => {
    const [touch] = event.changedTouches;
    if (event.touches.length > 1 || under({ clientX: touch.clientX, clientY: touch.clientY, pointerType: "touch" })) event.preventDefault();
  }, { passive: false });
  // On the vehicle in hand, or the watched one, its speed; else the zoom, and sideways the place.
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const id = scene.vehicleUnder(scene.road.pointer(event), page.everyone()), notches = -event.deltaY / (event.deltaMode === 0 ? PX_PER_NOTCH : 3);
    if (!event.ctrlKey && id !== null && (id === state.hand || id === state.watched)) {
      state.set({ hand: id, goalInHand: false });
      page.changeSpeed(Math.max(Math.min(notches, 3), -3));
    } else if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) { scene.panBy(-event.deltaX); page.draw(); }
    else { scene.zoomBy(1.25 ** Math.max(Math.min(notches * (event.ctrlKey ? 4 : 1), 3), -3), scene.road.pointer(event)); page.draw(); }
  }, { passive: false });

  return {
    // Lets go of what is dragged, which is back where it was; whether anything was.
    letGo: () => {
      if (!drag?.moving) return false;
      stop(true);
      return true;
    },
    // Whether a vehicle or a goal is being dragged.
    dragging: () => Boolean(drag?.moving && drag.target),
  };
};
