// The scene player: one carriageway of a recording over time, with forecasts and the forces behind
// them. The data stands in <script id="recording">; lengths there are in cm. Draws with scene.js.
"use strict";
(() => {
  const holder = document.getElementById("recording");
  if (!holder) return;
  const { COLOURS, SLOTS, Road, Clock, cm, unpack, along, switchTheme, parameterChart, showTip } = gnpScene;
  const data = JSON.parse(holder.textContent);
  const byId = (id) => document.getElementById(id);
  const [chart, slider, tip, status] = ["chart", "time", "tip", "status"].map(byId);
  const road = new Road(byId("road"));
  // What is said of a force stands in its term; a parameter knows its place among all of a step's.
  const parameters = data.terms.flatMap((t) => t.parameters);

  const state = { frame: 0, picked: -1, hover: -1, forces: true, modes: true, neighbours: true };
  const lines = data.lines.map((line) => ({ ...line, y: cm(line.y) }));
  const vehicles = data.vehicles.map((v) => ({ ...unpack(v), size: v.size.map(cm), forecasts: [] }));
  for (const f of data.forecasts) vehicles[f.vehicle].forecasts.push(f);
  for (const v of vehicles) v.forecasts.sort((a, b) => a.frame - b.frame);
  // px for 1 m/s²: a force that only one step in 20 exceeds is 40 px long.
  const sizes = data.forecasts.flatMap((f) => f.steps.map((s) => Math.max(...s.forces.map((f) => Math.hypot(...f)), 0))).sort((a, b) => a - b);
  const pxPerForce = 40 / Math.max(sizes[Math.floor(sizes.length * 0.95)] || 1, 0.01);
  const ys = lines.map((l) => l.y);
  const allX = vehicles.flatMap((v) => [v.x[0], v.x[v.x.length - 1]]);
  road.range = { x: [Math.min(...allX) - 5, Math.max(...allX) + 5], y: [Math.min(...ys, ...vehicles.map((v) => Math.min(...v.y))) - 2, Math.max(...ys, ...vehicles.map((v) => Math.max(...v.y))) + 2] };
  const middle = (road.range.x[0] + road.range.x[1]) / 2;
  road.centre = middle;
  // At first a metre has at least 7 px, so that vehicles have the form of vehicles; the view follows the picked one.
  road.zoom = Math.min(Math.max(((road.range.x[1] - road.range.x[0]) * 7) / Math.max(road.canvas.getBoundingClientRect().width, 1), 1), 12);

  const at = (v) => gnpScene.at(v, state.frame);
  const speed = (v) => gnpScene.speed(v, state.frame, data.rate);
  // The latest forecast made at or before this frame that still reaches it.
  const forecastOf = (v) => {
    let found = null;
    for (const f of v.forecasts) if (f.frame <= state.frame + 1e-9 && state.frame - f.frame <= data.horizon * data.rate) found = f;
    return found;
  };
  const pathOf = (f, mode) => {
    const points = [[cm(f.at[0]), cm(f.at[1])]];
    const p = f.modes[mode].path;
    for (let i = 0; i + 1 < p.length; i += 2) points.push([points[0][0] + cm(p[i]), points[0][1] + cm(p[i + 1])]);
    return points; // data.every seconds apart
  };
  // How many points of its path ago a forecast was made.
  const age = (f) => (state.frame - f.frame) / data.rate / data.every;
  const stepOf = (f) => f.steps[Math.min(Math.floor(age(f)), f.steps.length - 1)];

  const draw = () => {
    const picked = vehicles[state.picked];
    const here = picked && at(picked);
    if (here && road.zoom > 1) road.centre = here[0];
    road.begin(lines);
    const { look } = road;
    const forecast = picked && forecastOf(picked);
    const near = new Set(forecast && state.neighbours ? forecast.neighbours.filter((n) => n >= 0) : []);
    vehicles.forEach((v, i) => {
      const place = at(v);
      if (!place) return;
      road.box(v.size, place, i === state.picked ? COLOURS.target : near.has(i) ? look.near : v.evaluated ? look.test : look.other, i === state.hover ? COLOURS.target : near.has(i) ? COLOURS.neighbours : look.hull);
    });
    if (picked && here) {
      const past = [];
      for (let f = Math.max(picked.first, state.frame - data.observed * data.rate); f <= state.frame; f += 1) past.push(gnpScene.at(picked, f));
      road.stroke(past.filter(Boolean), look.past, 2.5);
    }
    if (forecast) {
      const prediction = pathOf(forecast, 0), step = age(forecast);
      if (state.modes) forecast.modes.forEach((m, i) => i && road.stroke(pathOf(forecast, i), COLOURS.others, 1.6));
      road.stroke(prediction, look.best, 2.6);
      const ghost = along(prediction, step);
      if (step > 0.01) road.box(picked.size, ghost, null, COLOURS.target, { dash: [3, 2] });
      const s = state.forces && stepOf(forecast);
      if (s) for (let i = data.terms.length - 1; i >= 0; i -= 1) road.arrow(ghost, s.forces[i], pxPerForce, data.terms[i].colour);
    }
    road.legend({ scale: data.forecasts.length ? pxPerForce : 0, simulated: data.simulated });
    if (data.forecasts.length) drawChart(forecast);
    slider.value = state.frame;
    byId("play").textContent = clock.running ? "Pause" : "Play";
    const seconds = (state.frame / data.rate).toFixed(1);
    status.textContent = `${seconds} s` + (picked && here ? `, vehicle ${picked.id}: ${speed(picked).toFixed(1)} m/s` : "") + (picked && !here ? `, vehicle ${picked.id} is not there` : "") + (forecast ? `, forecast made at ${(forecast.frame / data.rate).toFixed(1)} s, the first of ${forecast.modes.length}: ${(100 * forecast.modes[0].p).toFixed(0)} %` + (picked.evaluated ? ` (${data.subset} subset)` : ` (not in the ${data.subset} subset)`) : picked ? (data.forecasts.length ? ", no forecast yet" : "") : ", pick a vehicle by click or with N");
    for (const key of ["forces", "modes", "neighbours"]) byId(key).setAttribute("aria-pressed", state[key]);
  };

  // The parameters of the terms over the horizon of the forecast shown.
  const drawChart = (forecast) => {
    if (!forecast) { parameterChart(chart, { empty: `${parameters.map((p) => p.name).join(" and ")} over the forecast of the picked vehicle` }); return; }
    const panels = parameters.map((p, i) => ({
      title: `${p.title} ${p.name} (${p.unit})`, slots: p.slots, values: forecast.steps.map((s) => s.parameters[i]),
      colour: data.terms.find((t) => t.parameters.includes(p)).colour,
    }));
    const present = SLOTS.map((_, i) => i).filter((i) => forecast.neighbours[i] !== -2);
    parameterChart(chart, { panels, present, every: data.every, end: data.horizon, now: Math.min(age(forecast) * data.every, data.horizon) });
  };

  const setFrame = (frame) => { state.frame = Math.min(Math.max(frame, 0), data.frames - 1); draw(); };
  const pick = (index) => { state.picked = index; draw(); };
  const pickNext = (step) => {
    const places = new Map(vehicles.map((v, i) => [i, at(v)]).filter(([, place]) => place));
    const found = gnpScene.next(places, state.picked, step);
    if (found !== null) pick(found);
  };
  const toggle = (key) => { state[key] = !state[key]; draw(); };
  const clock = new Clock((seconds) => {
    const next = state.frame + seconds * data.rate;
    if (next >= data.frames - 1) clock.stop();
    setFrame(next);
    return clock.running;
  });
  const play = () => {
    if (clock.running) clock.stop();
    else {
      if (state.frame >= data.frames - 1) state.frame = 0;
      clock.start();
    }
    draw();
  };
  const zoom = (factor) => { road.zoom = Math.min(Math.max(road.zoom * factor, 1), 12); if (road.zoom === 1) road.centre = middle; draw(); };
  const under = (event) => {
    const pointer = road.pointer(event);
    return vehicles.findIndex((v) => { const place = at(v); return place && road.covers(pointer, place, v.size); });
  };
  const show = (vector, unit) => `${vector[0].toFixed(2)} forward, ${vector[1].toFixed(2)} left ${unit}`;
  const describe = (index) => {
    const v = vehicles[index], place = at(v), f = forecastOf(v);
    const told = [`vehicle ${v.id}, ${v.class}, ${v.size[0].toFixed(1)} by ${v.size[1].toFixed(1)} m`, `x ${place[0].toFixed(1)} m, y ${place[1].toFixed(2)} m, ${speed(v).toFixed(1)} m/s`];
    const s = f && stepOf(f);
    if (s) {
      data.terms.forEach((t, i) => told.push(`${t.label} ${show(s.forces[i], t.unit)}`));
      parameters.forEach((p, i) => {
        if (!p.slots) told.push(`${p.name} ${s.parameters[i][0].toFixed(2)} ${p.unit}`);
        else f.neighbours.forEach((n, slot) => n !== -2 && told.push(`${p.name} ${SLOTS[slot]} ${s.parameters[i][slot].toFixed(3)} ${p.unit}`));
      });
    }
    return told.join("\n");
  };

  // Under the player: each force in its colour.
  byId("terms").replaceChildren(...data.terms.flatMap((t, i) => {
    const swatch = document.createElement("span");
    swatch.textContent = "■";
    swatch.style.color = t.colour;
    return [i ? ", " : " (", swatch, ` ${t.label}`];
  }), data.terms.length ? ")" : "");
  byId("play").addEventListener("click", play);
  for (const key of ["forces", "modes", "neighbours"]) byId(key).addEventListener("click", () => toggle(key));
  byId("next").addEventListener("click", () => pickNext(1));
  byId("closer").addEventListener("click", () => zoom(1.5));
  byId("farther").addEventListener("click", () => zoom(1 / 1.5));
  byId("theme").addEventListener("click", () => { switchTheme(); draw(); });
  slider.addEventListener("input", () => { clock.stop(); setFrame(Number(slider.value)); });
  road.canvas.addEventListener("click", (event) => { const found = under(event); if (found >= 0) pick(found); });
  road.canvas.addEventListener("mousemove", (event) => {
    const found = under(event);
    if (found !== state.hover) { state.hover = found; draw(); }
    showTip(tip, found < 0 ? "" : describe(found), event);
  });
  road.canvas.addEventListener("mouseleave", () => { tip.hidden = true; state.hover = -1; draw(); });
  const KEYS = {
    " ": play, f: () => toggle("forces"), m: () => toggle("modes"), b: () => toggle("neighbours"), n: () => pickNext(1), p: () => pickNext(-1),
    "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), Home: () => setFrame(0), End: () => setFrame(data.frames - 1),
    ArrowRight: (e) => setFrame(Math.floor(state.frame) + (e.shiftKey ? data.rate : 1)), ArrowLeft: (e) => setFrame(Math.ceil(state.frame) - (e.shiftKey ? data.rate : 1)),
  };
  byId("player").addEventListener("keydown", (event) => {
    const onButton = event.target.tagName === "BUTTON" && event.key === " ";
    const action = KEYS[event.key] || KEYS[event.key.toLowerCase()];
    if (!action || onButton || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action(event);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("resize", draw);
  slider.max = data.frames - 1;
  // Traffic without forecasts has neither forces nor futures.
  if (!data.forecasts.length) for (const part of document.querySelectorAll("#player .forecast, #forces, #modes, #neighbours, #chart")) part.style.display = "none";
  // `report.html#t=12.5&vehicle=7&theme=dark` opens that moment; without a vehicle the evaluated one with the
  // most neighbours in its forecast.
  const open = () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (["light", "dark"].includes(asked.get("theme"))) document.documentElement.dataset.theme = asked.get("theme");
    state.frame = Math.min(Math.max(Math.round((Number(asked.get("t")) || 0) * data.rate), 0), data.frames - 1);
    const there = vehicles.map((v, i) => i).filter((i) => at(vehicles[i]));
    const busy = (i) => { const f = forecastOf(vehicles[i]); return (vehicles[i].evaluated ? 100 : 0) + (f ? 1 + f.neighbours.filter((n) => n !== -2).length : 0); };
    const named = vehicles.findIndex((v) => String(v.id) === asked.get("vehicle"));
    pick(named >= 0 ? named : there.length ? there.reduce((best, i) => (busy(i) > busy(best) ? i : best)) : -1);
  };
  addEventListener("hashchange", () => location.hash.includes("=") && open()); // else it is a place on the page
  open();
  addEventListener("load", () => {
    byId("ready").textContent = `Ready after ${(performance.now() / 1000).toFixed(2)} s: ${(data.frames / data.rate).toFixed(0)} s of traffic, ${vehicles.length} vehicles${data.forecasts.length ? `, ${data.forecasts.length} forecasts` : ""}.`;
  });
})();
