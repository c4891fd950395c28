// The one owner of what is shown: recording, moment, changes, who is watched and who is in hand; and of what was before.

// What undo brings back.
const KEPT = ["time", "held", "changes", "watched", "hand"];
const LONGEST_MEMORY = 200;
// Steps of one gesture that follow each other faster are one to undo, ms; a drag may rest.
const SAME_GESTURE_MS = 1200;
export const DRAG = "drag";

export class State {
  // Of the recording: its name, the index of its carriageway, the time, s. A moment is `held` while it can be changed;
  // then `ahead` is how far, s, its forecasts have been driven.
  recording = null;
  road = 0;
  time = 0;
  held = false;
  ahead = 0;
  changes = [];
  // Names of vehicles: whose forecast is shown, and to whom changes are made. `goalInHand`: its goal instead.
  watched = null;
  hand = null;
  goalInHand = false;
  adding = false;
  playing = false;
  shown = { forces: true, futures: true, neighbours: true, paths: true };
  // The nearest time that a moment can be held at.
  snap = (time) => time;
  #past = [];
  #future = [];
  #gesture = { name: null, at: 0, future: [] };
  #listeners = [];

  listen(listener) { this.#listeners.push(listener); }
  #tell() { for (const listener of this.#listeners) listener(); }
  #keep() { return Object.fromEntries(KEPT.map((name) => [name, this[name]])); }

  // What is not worth an undo.
  set(values) {
    Object.assign(this, values);
    this.#tell();
  }
  // What can be undone. Those of one gesture, such as all of a drag, are one.
  act(values, gesture = null) {
    const now = performance.now(), { name, at } = this.#gesture;
    let { future } = this.#gesture;
    if (!gesture || gesture !== name || (gesture !== DRAG && now - at > SAME_GESTURE_MS)) {
      future = this.#future;
      this.#past.push(this.#keep());
      if (this.#past.length > LONGEST_MEMORY) this.#past.shift();
    }
    this.#future = [];
    this.#gesture = { name: gesture, at: now, future };
    this.set(values);
  }
  // A change holds the moment and shows it, whatever was played of it.
  change(changes, gesture = null, others = {}) {
    this.act({ ...others, changes, held: true, time: this.snap(this.time), ahead: 0, playing: false }, gesture);
  }
  endGesture() { this.#gesture = { name: null, at: 0, future: [] }; }
  // As if the drag that is still going on had not been.
  cancelDrag() {
    if (this.#gesture.name !== DRAG || !this.#past.length) return;
    const before = this.#past.pop();
    this.#future = this.#gesture.future;
    this.endGesture();
    this.set({ ...before, ahead: 0 });
  }

  get canUndo() { return this.#past.length > 0; }
  get canRedo() { return this.#future.length > 0; }
  undo() { this.#swap(this.#past, this.#future); }
  redo() { this.#swap(this.#future, this.#past); }
  #swap(from, to) {
    if (!from.length) return;
    to.push(this.#keep());
    this.endGesture();
    this.set({ ...from.pop(), ahead: 0, playing: false, adding: false });
  }

  hold() { if (!this.held) this.act({ held: true, time: this.snap(this.time), ahead: 0, playing: false }); }
  // Back to the recording: the changes are gone, but not from memory.
  release() { if (this.held) this.act({ held: false, ahead: 0, changes: [], playing: false, adding: false, goalInHand: false }); }
  // Another recording or carriageway has no memory of this one.
  open(values) {
    this.#past = [];
    this.#future = [];
    this.endGesture();
    this.set({ held: false, ahead: 0, changes: [], watched: null, hand: null, playing: false, adding: false, goalInHand: false, ...values });
  }
}
