// What the server says of a moment, in the form in which it is drawn. One question is what is predicted of everyone and why
// the watched one goes where.
import * as api from "./api.js";
import * as changesOf from "./changes.js";

const EVERY_S = 0.2; // between the points of paths
// An answer that is about another moment is shown for as long as this, s.
const NEAR_S = 0.75;

// Why he goes where is not asked of who is not there. Of more than `most` vehicles those around the watched one are predicted,
// or around `x`, where one looks.
export const questionOf = (state, time, everyone, x, most) => {
  const watched = everyone.get(state.watched), middle = watched?.start[0] ?? x;
  const question = { recording: state.recording, road: state.road, time, changes: state.changes, watched: watched ? state.watched : null };
  const there = [...everyone.values()].filter((v) => !v.removed), far = (v) => Math.abs(v.start[0] - middle);
  return there.length <= most ? question : { ...question, vehicles: there.sort((a, b) => far(a) - far(b)).slice(0, most).map((v) => v.id) };
};

const pathOf = (at, mode) => [at, ...mode.path];
// One side of an explanation: as it is, or changed. Its forces are `dt` apart, the points of its path `pathDt`.
const sideOf = (side) => side && {
  ...side,
  pathDt: side.modes?.length ? (side.dt * side.path.length) / side.modes[0].path.length : side.dt,
  path: side.modes?.length ? pathOf(side.at, side.modes[0]) : [],
  forces: side.forces ?? [],
  parameters: side.parameters ?? [],
};

// Who was removed has a forecast from before alone, and who was added one from now.
const explain = async ({ scene, changes, watched }, signal) => {
  if (watched === null) return null;
  const kept = changesOf.isRemoved(changes, watched) ? [] : changes;
  try {
    return await api.explain({ scene, vehicle: watched, changes: kept }, signal);
  } catch (error) {
    if (!(error instanceof api.Problem) || error.passes) throw error;
    return { problem: error.message };
  }
};

// Both answers to a question, together.
export const answer = async (question, signal) => {
  const { recording, road, time, changes, watched, vehicles } = question, scene = { recording, road, time_s: time };
  const [found, why] = await Promise.all([api.predict({ scene, changes, every_s: EVERY_S, vehicles }, signal), explain({ scene, changes, watched }, signal)]);
  const forecasts = new Map(found.forecasts.map((f) => [f.id, { ...f, dt: found.dt_s, paths: f.modes.map((mode) => pathOf(f.at, mode)) }]));
  const explained = why && (why.problem ? why : { before: sideOf(why.as_it_is), after: sideOf(why.changed), change: why.change && { ...why.change, isChange: true } });
  return { forecasts, explained, leftOut: new Map(found.left_out.map(({ id, reason }) => [id, reason])) };
};

// How fast everyone is without a change of speed, m/s, by name: as the answer `found` says, and of who has one now as the
// answers before said of the same moment.
export const speedsOf = (found, question, last) => {
  const same = last && ["recording", "road", "time"].every((name) => last.question[name] === question[name]), speeds = new Map(same ? last.speeds : []);
  const given = (id) => changesOf.find(question.changes, "speed", id) || changesOf.find(question.changes, "add", id);
  for (const [id, { velocity }] of found.forecasts) if (!given(id)) speeds.set(id, Math.hypot(...velocity));
  return speeds;
};

const NONE = { forecasts: new Map(), speeds: new Map(), leftOut: new Map(), explained: null, behind: 0, question: null };
// What of the last answer fits what is shown: while the next one is on its way the last one is better than none.
export const fitting = (last, state) => {
  const { question } = last ?? {};
  if (!question || question.recording !== state.recording || question.road !== state.road) return NONE;
  const behind = state.time - question.time;
  if (Math.abs(behind) > NEAR_S) return NONE;
  return { ...last, behind: state.held ? 0 : Math.max(behind, 0), explained: question.watched === state.watched ? last.explained : null };
};

// Whose forecast is worth a first look: a near leader, neighbours, a whole past, and far from both ends.
export const worthWatching = (forecasts, [from, to]) => {
  const middle = (from + to) / 2, all = [...forecasts.values()];
  const rank = (f) => {
    const leader = forecasts.get(f.leader), near = leader ? 6 - (leader.at[0] - f.at[0]) / 10 : 0;
    return Math.max(near, 0) + f.neighbours.filter(Boolean).length * 0.5 + (f.past === "full" ? 2 : 0) - (6 * Math.abs(f.at[0] - middle)) / (to - from);
  };
  return all.length ? all.reduce((a, b) => (rank(b) > rank(a) ? b : a)).id : null;
};
