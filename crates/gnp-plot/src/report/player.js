// The scene player: one carriageway of a recording over time, with forecasts and the forces behind
// them. The data stands in <script id="recording">; lengths there are in cm.
"use strict";
(() => {
  const holder = document.getElementById("recording");
  if (!holder) return;
  const data = JSON.parse(holder.textContent);
  const byId = (id) => document.getElementById(id);
  const [road, chart, slider, tip, status] = ["road", "chart", "time", "tip", "status"].map(byId);
  const pen = road.getContext("2d");
  const plot = chart.getContext("2d");
  const COLOURS = { target: "#d55e00", others: "#32cd32", neighbours: "#0072b2" };
  // What is said of a force stands in its term; a parameter knows its place among all of a step's.
  const parameters = data.terms.flatMap((t) => t.parameters);
  // Colours that differ between light and dark stand in the style sheet.
  let look = {};
  const readLook = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "road", "edge", "lane", "past", "best", "test", "other", "near", "hull"]) look[name] = style.getPropertyValue(`--${name}`).trim();
  };
  const SLOTS = ["ahead", "behind", "left ahead", "left beside", "left behind", "right ahead", "right beside", "right behind"];

  const state = {
    frame: 0, playing: false, picked: -1, zoom: 1, centre: 0, hover: -1,
    forces: true, modes: true, neighbours: true,
  };
  const cm = (v) => v / 100;
  const vehicles = data.vehicles.map((v) => {
    // Positions are differences, after the first.
    const sum = (list) => { let s = 0; return Float32Array.from(list, (d) => cm(s += d)); };
    return { ...v, x: sum(v.x), y: sum(v.y), forecasts: [] };
  });
  for (const f of data.forecasts) vehicles[f.vehicle].forecasts.push(f);
  // px for 1 m/s²: a force that only one step in 20 exceeds is 40 px long.
  const sizes = data.forecasts.flatMap((f) => f.steps.map((s) => Math.max(...s.forces.map((f) => Math.hypot(...f)), 0))).sort((a, b) => a - b);
  const pxPerForce = 40 / Math.max(sizes[Math.floor(sizes.length * 0.95)] || 1, 0.01);
  const force = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5].find((f) => f * pxPerForce > 25) || 10;
  for (const v of vehicles) v.forecasts.sort((a, b) => a.frame - b.frame);
  const ys = data.lines.map((l) => cm(l.y));
  const allX = vehicles.flatMap((v) => [v.x[0], v.x[v.x.length - 1]]);
  const range = { x: [Math.min(...allX) - 5, Math.max(...allX) + 5], y: [Math.min(...ys, ...vehicles.map((v) => Math.min(...v.y))) - 2, Math.max(...ys, ...vehicles.map((v) => Math.max(...v.y))) + 2] };
  state.centre = (range.x[0] + range.x[1]) / 2;
  // At first a metre has at least 7 px, so that vehicles have the form of vehicles; the view follows the picked one.
  state.zoom = Math.min(Math.max(((range.x[1] - range.x[0]) * 7) / Math.max(road.getBoundingClientRect().width, 1), 1), 12);

  const at = (v, frame) => {
    const i = frame - v.first;
    if (i < 0 || i > v.x.length - 1) return null;
    const a = Math.floor(i), b = Math.min(a + 1, v.x.length - 1), t = i - a;
    return [v.x[a] + (v.x[b] - v.x[a]) * t, v.y[a] + (v.y[b] - v.y[a]) * t];
  };
  const speed = (v, frame) => {
    const i = Math.min(Math.max(Math.floor(frame - v.first), 1), v.x.length - 1);
    return (v.x[i] - v.x[i - 1]) * data.rate;
  };
  // The latest forecast made at or before a frame that still reaches it.
  const forecastOf = (v, frame) => {
    let found = null;
    for (const f of v.forecasts) if (f.frame <= frame + 1e-9 && frame - f.frame <= data.horizon * data.rate) found = f;
    return found;
  };
  const pathOf = (f, mode) => {
    const points = [[cm(f.at[0]), cm(f.at[1])]];
    const p = f.modes[mode].path;
    for (let i = 0; i + 1 < p.length; i += 2) points.push([points[0][0] + cm(p[i]), points[0][1] + cm(p[i + 1])]);
    return points; // data.every seconds apart
  };
  const along = (points, step) => {
    const a = Math.min(Math.floor(step), points.length - 1), b = Math.min(a + 1, points.length - 1), t = step - a;
    return [points[a][0] + (points[b][0] - points[a][0]) * t, points[a][1] + (points[b][1] - points[a][1]) * t];
  };

  // Forward is right, left is up.
  let view = { width: 1, height: 1, sx: 1, sy: 1 };
  const px = (x) => (x - state.centre) * view.sx + view.width / 2;
  const py = (y) => view.height / 2 - (y - (range.y[0] + range.y[1]) / 2) * view.sy;
  const fit = (canvas, context) => {
    const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    const [w, h] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, box.width, box.height);
    return [box.width, box.height];
  };
  const stroke = (points, colour, width, dash = []) => {
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(px(x), py(y)) : pen.moveTo(px(x), py(y))));
    pen.strokeStyle = colour; pen.lineWidth = width; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
  };
  const box = (v, [x, y], fill, rim, dash = []) => {
    const w = cm(v.size[0]) * view.sx, h = cm(v.size[1]) * view.sy;
    pen.setLineDash(dash);
    if (fill) { pen.fillStyle = fill; pen.fillRect(px(x) - w / 2, py(y) - h / 2, w, h); }
    pen.strokeStyle = rim; pen.lineWidth = 1; pen.strokeRect(px(x) - w / 2, py(y) - h / 2, w, h); pen.setLineDash([]);
  };
  // Light colours have a dark rim, dark ones a white one.
  const rim = (colour) => {
    const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b > 140 ? `rgb(${r * 0.43} ${g * 0.43} ${b * 0.43})` : "#ffffff";
  };
  const arrow = ([x, y], [fx, fy], colour) => {
    const [dx, dy] = [fx * pxPerForce, -fy * pxPerForce], length = Math.hypot(dx, dy);
    if (length < 2) return;
    const [ux, uy, head] = [dx / length, dy / length, Math.min(length, 8)];
    const [x0, y0, tx, ty] = [px(x), py(y), px(x) + dx, py(y) + dy];
    const [nx, ny] = [tx - ux * head, ty - uy * head];
    for (const [style, width] of [[rim(colour), 4.5], [colour, 2.5]]) {
      pen.strokeStyle = style; pen.lineWidth = width;
      pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(nx, ny); pen.stroke();
    }
    pen.beginPath(); pen.moveTo(tx, ty); pen.lineTo(nx - uy * head / 2, ny + ux * head / 2); pen.lineTo(nx + uy * head / 2, ny - ux * head / 2); pen.closePath();
    pen.fillStyle = colour; pen.fill(); pen.strokeStyle = "#ffffff"; pen.lineWidth = .7; pen.stroke();
  };

  const draw = () => {
    readLook();
    const picked = vehicles[state.picked];
    const here = picked && at(picked, state.frame);
    if (here && state.zoom > 1) state.centre = here[0];
    [view.width, view.height] = fit(road, pen);
    view.sx = (view.width / (range.x[1] - range.x[0])) * state.zoom;
    view.sy = view.height / (range.y[1] - range.y[0]);
    pen.fillStyle = look.road;
    pen.fillRect(0, py(Math.max(...ys)), view.width, py(Math.min(...ys)) - py(Math.max(...ys)));
    for (const line of data.lines) {
      const y = py(cm(line.y));
      pen.beginPath(); pen.moveTo(0, y); pen.lineTo(view.width, y);
      pen.strokeStyle = line.boundary ? look.edge : look.lane; pen.lineWidth = line.boundary ? 2 : 1;
      pen.setLineDash(line.boundary ? [] : [9, 7]); pen.stroke(); pen.setLineDash([]);
    }
    const forecast = picked && forecastOf(picked, state.frame);
    const near = new Set(forecast && state.neighbours ? forecast.neighbours.filter((n) => n >= 0) : []);
    vehicles.forEach((v, i) => {
      const place = at(v, state.frame);
      if (!place) return;
      box(v, place, i === state.picked ? COLOURS.target : near.has(i) ? look.near : v.evaluated ? look.test : look.other, i === state.hover ? COLOURS.target : near.has(i) ? COLOURS.neighbours : look.hull);
    });
    if (picked && here) {
      const past = [];
      for (let f = Math.max(picked.first, state.frame - data.observed * data.rate); f <= state.frame; f += 1) past.push(at(picked, f));
      stroke(past.filter(Boolean), look.past, 2.5);
    }
    if (forecast) {
      const prediction = pathOf(forecast, 0), step = (state.frame - forecast.frame) / data.rate / data.every;
      if (state.modes) forecast.modes.forEach((m, i) => i && stroke(pathOf(forecast, i), COLOURS.others, 1.6));
      stroke(prediction, look.best, 2.6);
      const ghost = along(prediction, step);
      if (step > 0.01) box(picked, ghost, null, COLOURS.target, [3, 2]);
      if (state.forces) {
        const s = forecast.steps[Math.min(Math.floor(step), forecast.steps.length - 1)];
        if (s) for (let i = data.terms.length - 1; i >= 0; i -= 1) arrow(ghost, s.forces[i], data.terms[i].colour);
      }
    }
    pen.font = "12px system-ui, sans-serif"; pen.fillStyle = look.ink;
    const bar = [5, 10, 20, 50, 100].find((m) => m * view.sx > 60) || 100;
    pen.fillRect(10, view.height - 10, bar * view.sx, 2);
    pen.fillText(`${bar} m; lateral axis stretched ×${(view.sy / view.sx).toFixed(1)}`, 14 + bar * view.sx, view.height - 6);
    // Where there is little room, at the upper edge.
    const [right, base] = [view.width - 100, view.width < 560 ? 14 : view.height - 6];
    if (data.forecasts.length) {
      pen.fillRect(right - force * pxPerForce, base - 4, force * pxPerForce, 2);
      pen.fillText(`force ${force} m/s²`, right + 6, base);
    }
    if (data.simulated) { pen.font = "bold 13px system-ui, sans-serif"; pen.fillText("simulated", 10, 16); }
    if (data.forecasts.length) drawChart(forecast);
    slider.value = state.frame;
    byId("play").textContent = state.playing ? "Pause" : "Play";
    const seconds = (state.frame / data.rate).toFixed(1);
    status.textContent = `${seconds} s` + (picked && here ? `, vehicle ${picked.id}: ${speed(picked, state.frame).toFixed(1)} m/s` : "") + (picked && !here ? `, vehicle ${picked.id} is not there` : "") + (forecast ? `, forecast made at ${(forecast.frame / data.rate).toFixed(1)} s, the first of ${forecast.modes.length}: ${(100 * forecast.modes[0].p).toFixed(0)} %` + (picked.evaluated ? ` (${data.subset} subset)` : ` (not in the ${data.subset} subset)`) : picked ? (data.forecasts.length ? ", no forecast yet" : "") : ", pick a vehicle by click or with N");
    for (const key of ["forces", "modes", "neighbours"]) byId(key).setAttribute("aria-pressed", state[key]);
  };

  // The parameters of the terms over the horizon of the forecast shown.
  const drawChart = (forecast) => {
    const [w, h] = fit(chart, plot);
    plot.font = "11px system-ui, sans-serif"; plot.fillStyle = look.ink;
    if (!forecast) { plot.fillText(`${parameters.map((p) => p.name).join(" and ")} over the forecast of the picked vehicle`, 10, 16); return; }
    // Beside each other, or below each other where there is little room.
    const narrow = w < 560, legend = 100, steps = forecast.steps, end = data.horizon, count = Math.max(parameters.length, 1);
    const [wide, high] = narrow ? [w - legend, h / count] : [(w - legend) / count, h];
    const panel = (left, upper, title, curves) => {
      const top = Math.max(...curves.flatMap((c) => c.values), 1e-3) * 1.1;
      const X = (s) => left + 42 + (s / end) * (wide - 60), Y = (v) => upper + high - 22 - (v / top) * (high - 44);
      plot.fillStyle = look.ink; plot.strokeStyle = look.ink; plot.lineWidth = 1;
      plot.strokeRect(X(0), Y(top), wide - 60, high - 44);
      plot.fillText(title, X(0), upper + 14);
      for (const s of [0, 1, 2, 3, 4, 5].filter((s) => s <= end)) plot.fillText(`${s} s`, X(s) - 6, upper + high - 8);
      for (const v of [0, top / 2.2, top / 1.1]) plot.fillText(v.toPrecision(2), left + 4, Y(v) + 4);
      for (const { values, colour, dash } of curves) {
        plot.beginPath();
        values.forEach((v, i) => (i ? plot.lineTo(X(i * data.every), Y(v)) : plot.moveTo(X(0), Y(v))));
        plot.strokeStyle = colour; plot.lineWidth = 1.8; plot.setLineDash(dash); plot.stroke(); plot.setLineDash([]);
      }
      const now = Math.min((state.frame - forecast.frame) / data.rate, end);
      plot.strokeStyle = COLOURS.target; plot.beginPath(); plot.moveTo(X(now), Y(0)); plot.lineTo(X(now), Y(top)); plot.stroke();
    };
    const colours = ["#0072b2", "#56b4e9", "#009e73", "#e69f00", "#cc79a7", "#d55e00", "#7f7f7f", "#a6761d"];
    const present = SLOTS.map((_, i) => i).filter((i) => forecast.neighbours[i] !== -2);
    const drawn = parameters.map((p, i) => {
      const { colour } = data.terms.find((t) => t.parameters.includes(p)), dark = rim(colour), single = dark === "#ffffff" ? colour : dark;
      if (!p.slots) return [{ values: steps.map((s) => s.parameters[i][0]), colour: single, dash: [] }];
      if (!present.length) return [{ values: [0], colour: "#777", dash: [] }];
      return present.map((slot) => ({ values: steps.map((s) => s.parameters[i][slot]), colour: colours[slot], dash: slot % 2 ? [5, 3] : [] }));
    });
    parameters.forEach((p, i) => panel(narrow ? 0 : wide * i, narrow ? high * i : 0, `${p.title} ${p.name} (${p.unit})`, drawn[i]));
    const bySlot = parameters.findIndex((p) => p.slots);
    if (bySlot < 0) return;
    present.forEach((i, n) => {
      const y = (narrow ? high * bySlot : 0) + 30 + 13 * n;
      plot.beginPath(); plot.moveTo(w - legend - 8, y - 4); plot.lineTo(w - legend + 10, y - 4);
      plot.strokeStyle = colours[i]; plot.lineWidth = 2.4; plot.setLineDash(i % 2 ? [5, 3] : []); plot.stroke(); plot.setLineDash([]);
      plot.fillStyle = look.ink; plot.fillText(SLOTS[i], w - legend + 14, y);
    });
  };

  const setFrame = (frame) => { state.frame = Math.min(Math.max(frame, 0), data.frames - 1); draw(); };
  const pick = (index) => { state.picked = index; draw(); };
  const pickNext = (step) => {
    const there = vehicles.map((v, i) => i).filter((i) => at(vehicles[i], state.frame));
    if (!there.length) return;
    there.sort((a, b) => at(vehicles[a], state.frame)[0] - at(vehicles[b], state.frame)[0]);
    const now = there.indexOf(state.picked);
    pick(there[(now < 0 ? 0 : now + step + there.length) % there.length]);
  };
  const toggle = (key) => { state[key] = !state[key]; draw(); };
  let last = 0;
  const tick = (time) => {
    if (!state.playing) return;
    const next = state.frame + (Math.min(Math.max(time - last, 0), 100) / 1000) * data.rate;
    last = time;
    if (next >= data.frames - 1) state.playing = false;
    setFrame(next);
    requestAnimationFrame(tick);
  };
  const play = () => {
    state.playing = !state.playing;
    if (state.playing && state.frame >= data.frames - 1) state.frame = 0;
    last = performance.now();
    if (state.playing) requestAnimationFrame(tick);
    draw();
  };
  const zoom = (factor) => { state.zoom = Math.min(Math.max(state.zoom * factor, 1), 12); if (state.zoom === 1) state.centre = (range.x[0] + range.x[1]) / 2; draw(); };
  const under = (event) => {
    const area = road.getBoundingClientRect(), [mx, my] = [event.clientX - area.left, event.clientY - area.top];
    return vehicles.findIndex((v) => {
      const place = at(v, state.frame);
      return place && Math.abs(px(place[0]) - mx) <= Math.max(cm(v.size[0]) * view.sx / 2, 6) && Math.abs(py(place[1]) - my) <= Math.max(cm(v.size[1]) * view.sy / 2, 6);
    });
  };
  const show = (vector, unit) => `${vector[0].toFixed(2)} forward, ${vector[1].toFixed(2)} left ${unit}`;
  const describe = (index) => {
    const v = vehicles[index], place = at(v, state.frame), f = forecastOf(v, state.frame);
    const lines = [`vehicle ${v.id}, ${v.class}, ${cm(v.size[0]).toFixed(1)} by ${cm(v.size[1]).toFixed(1)} m`, `x ${place[0].toFixed(1)} m, y ${place[1].toFixed(2)} m, ${speed(v, state.frame).toFixed(1)} m/s`];
    if (f) {
      const s = f.steps[Math.min(Math.floor((state.frame - f.frame) / data.rate / data.every), f.steps.length - 1)];
      if (s) {
        data.terms.forEach((t, i) => lines.push(`${t.label} ${show(s.forces[i], t.unit)}`));
        parameters.forEach((p, i) => {
          if (!p.slots) lines.push(`${p.name} ${s.parameters[i][0].toFixed(2)} ${p.unit}`);
          else f.neighbours.forEach((n, slot) => n !== -2 && lines.push(`${p.name} ${SLOTS[slot]} ${s.parameters[i][slot].toFixed(3)} ${p.unit}`));
        });
      }
    }
    return lines.join("\n");
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
  byId("theme").addEventListener("click", () => {
    const root = document.documentElement, dark = getComputedStyle(root).colorScheme === "dark" || (!root.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
    root.dataset.theme = dark ? "light" : "dark";
    draw();
  });
  slider.addEventListener("input", () => { state.playing = false; setFrame(Number(slider.value)); });
  road.addEventListener("click", (event) => { const found = under(event); if (found >= 0) pick(found); });
  road.addEventListener("mousemove", (event) => {
    const found = under(event);
    if (found !== state.hover) { state.hover = found; draw(); }
    tip.hidden = found < 0;
    if (found < 0) return;
    tip.textContent = describe(found);
    // Beside the pointer, and on the page.
    tip.style.left = `${Math.max(Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8), 0)}px`;
    tip.style.top = `${Math.max(Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8), 0)}px`;
  });
  road.addEventListener("mouseleave", () => { tip.hidden = true; state.hover = -1; draw(); });
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
    const there = vehicles.map((v, i) => i).filter((i) => at(vehicles[i], state.frame));
    const busy = (i) => { const f = forecastOf(vehicles[i], state.frame); return (vehicles[i].evaluated ? 100 : 0) + (f ? 1 + f.neighbours.filter((n) => n !== -2).length : 0); };
    const named = vehicles.findIndex((v) => String(v.id) === asked.get("vehicle"));
    pick(named >= 0 ? named : there.length ? there.reduce((best, i) => (busy(i) > busy(best) ? i : best)) : -1);
  };
  addEventListener("hashchange", () => location.hash.includes("=") && open()); // else it is a place on the page
  open();
  addEventListener("load", () => {
    byId("ready").textContent = `Ready after ${(performance.now() / 1000).toFixed(2)} s: ${(data.frames / data.rate).toFixed(0)} s of traffic, ${vehicles.length} vehicles${data.forecasts.length ? `, ${data.forecasts.length} forecasts` : ""}.`;
  });
})();
