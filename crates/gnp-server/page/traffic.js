// Who is where: the tracks of a recording, fetched in spans, and the same with the changes of a moment.
import * as changesOf from "./changes.js";

/* global gnpScene */
const SPAN_S = 60;
const LONGEST_S = 118; // of a recording that is fetched at once
const BEFORE_S = 4; // of a span, so that pasts are whole
const AFTER_S = 1;
const AHEAD_S = 15; // before its end the next span is fetched
const MOST_SPANS = 6;
const SPEED_S = 0.5;

// Over the last half second: places are rounded, and recorded ones jump.
const speedOf = (track, frame, rate) => {
  const i = Math.min(Math.floor(frame - track.first), track.x.length - 1), back = Math.min(i, Math.round(SPEED_S * rate));
  return back > 0 ? ((track.x[i] - track.x[i - back]) / back) * rate : track.x.length > 1 ? (track.x[1] - track.x[0]) * rate : 0;
};

export class Tracks {
  #spans = new Map();
  #wanted = new Set();
  // `fetch(recording, query)` gives tracks; `onLoaded` and `onProblem` are told of it.
  constructor(fetch, { onLoaded, onProblem }) { Object.assign(this, { fetch, onLoaded, onProblem, recording: null, road: 0, rate: 10 }); }
  open(recording, road) {
    [this.recording, this.road] = [recording, road];
    this.#spans = new Map();
    this.#wanted = new Set();
    const whole = recording.to_s - recording.from_s;
    this.length = whole <= LONGEST_S ? whole + 1 : SPAN_S;
  }
  #index(time) { return Math.max(Math.floor((time - this.recording.from_s) / this.length), 0); }
  // Fetches what is needed around a time, s.
  want(time) {
    if (!this.recording) return;
    this.#load(this.#index(time));
    if (time + AHEAD_S < this.recording.to_s) this.#load(this.#index(time + AHEAD_S));
  }
  async #load(index) {
    const { recording, road } = this, from = recording.from_s + index * this.length;
    if (this.#spans.has(index) || this.#wanted.has(index) || from > recording.to_s) return;
    const wanted = this.#wanted;
    wanted.add(index);
    try {
      const query = { road, from_s: Math.max(from - BEFORE_S, recording.from_s), to_s: Math.min(from + this.length + AFTER_S, recording.to_s) };
      const found = await this.fetch(recording.name, query);
      if (wanted !== this.#wanted) return; // of another recording by now
      const vehicles = new Map();
      for (const v of found.vehicles) vehicles.set(v.id, [...(vehicles.get(v.id) ?? []), gnpScene.unpack(v)]);
      this.rate = found.rate_hz;
      this.#spans.set(index, { from: found.from_s, vehicles });
      if (this.#spans.size > MOST_SPANS) this.#spans.delete([...this.#spans.keys()].find((key) => key !== index));
      this.onLoaded();
    } catch (problem) {
      this.onProblem(problem);
    } finally {
      wanted.delete(index);
    }
  }
  // A time that is shown: one of the recording's frames, s.
  snap(time) {
    const { from_s: from, to_s: to } = this.recording;
    return Math.min(Math.max(from + Math.round((time - from) * this.rate) / this.rate, from), to);
  }
  // Who is there, by name: `{ id, class, size, at, speed, track, frame }`; null while it is not known.
  at(time) {
    const span = this.#spans.get(this.#index(time));
    if (!span) return null;
    const frame = Math.round((time - span.from) * this.rate * 1e4) / 1e4, there = new Map();
    for (const [id, parts] of span.vehicles) {
      for (const track of parts) {
        const at = gnpScene.at(track, frame);
        if (at) there.set(id, { id, class: track.class, size: track.size, at, speed: speedOf(track, frame, this.rate), track, frame });
      }
    }
    return there;
  }
  // When most vehicles are there that were seen for `observed` s, s; of what is fetched around a time.
  busiest(time, observed) {
    const span = this.#spans.get(this.#index(time)), change = new Map();
    if (!span) return time;
    const put = (frame, by) => change.set(frame, (change.get(frame) ?? 0) + by);
    for (const track of [...span.vehicles.values()].flat()) {
      const seen = track.first + Math.ceil(observed * this.rate), end = track.first + track.x.length;
      if (seen < end) { put(seen, 1); put(end, -1); }
    }
    let [count, most, best] = [0, 0, null];
    for (const frame of [...change.keys()].sort((a, b) => a - b)) {
      count += change.get(frame);
      if (count > most) [most, best] = [count, frame];
    }
    return best === null ? time : this.snap(span.from + best / this.rate);
  }
  // Where a vehicle was in the seconds before.
  past({ track, frame, at }, seconds) {
    const points = [];
    for (let f = Math.max(track.first, Math.ceil(frame - seconds * this.rate)); f < frame; f += 1) points.push(gnpScene.at(track, f));
    return [...points, at];
  }
}

// Everyone with the changes of the moment, driven `ahead` s along the `forecasts`, with `speeds` as they are predicted from:
// `{ recorded, start, at, before, added, removed }` more than of the tracks; `recorded` is null for who was added, `start` the
// place at the moment, `before` the speed without a change.
export const changedTraffic = (recorded, changes, { forecasts, speeds }, ahead) => {
  const everyone = new Map();
  for (const [id, v] of recorded) {
    const moved = changesOf.find(changes, "move", id), start = moved ? v.at.map((value, i) => value + moved.by[i]) : v.at;
    const before = speeds.get(id) ?? v.speed;
    everyone.set(id, { ...v, before, speed: changesOf.find(changes, "speed", id)?.mps ?? before, recorded: v.at, start, at: start, added: false, removed: changesOf.isRemoved(changes, id) });
  }
  for (const c of changes) if (c.kind === "add") everyone.set(c.vehicle, { id: c.vehicle, class: c.class, size: c.size, speed: c.mps, before: c.mps, recorded: null, start: c.at, at: c.at, added: true, removed: false });
  if (ahead > 0) {
    for (const v of everyone.values()) {
      const forecast = forecasts.get(v.id);
      // Who is not predicted goes on as he does.
      if (forecast) v.at = gnpScene.along(forecast.paths[0], ahead / forecast.dt);
      else v.at = [v.start[0] + v.speed * ahead, v.start[1]];
    }
  }
  return everyone;
};

// The middle of the lane at y, or y itself beside the road; and how wide it is.
export const laneAt = (lines, y) => {
  const ys = lines.map((line) => line.y).sort((a, b) => a - b), i = ys.findIndex((line) => line > y);
  return i > 0 ? { middle: (ys[i - 1] + ys[i]) / 2, width: ys[i] - ys[i - 1] } : { middle: y, width: 3.5 };
};
