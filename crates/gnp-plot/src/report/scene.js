// How a scene on a road looks: its view, vehicles, paths, arrows and charts on canvas. The report's player and the live
// page both draw with it; it knows neither where the data comes from nor what can be done with it.
"use strict";
const gnpScene = (() => {
  const COLOURS = { target: "#d55e00", others: "#32cd32", neighbours: "#0072b2" };
  const SLOTS = ["ahead", "behind", "left ahead", "left beside", "left behind", "right ahead", "right beside", "right behind"];
  const SLOT_COLOURS = ["#0072b2", "#56b4e9", "#009e73", "#e69f00", "#cc79a7", "#d55e00", "#7f7f7f", "#a6761d"];
  const NAMES = ["ink", "road", "edge", "lane", "past", "best", "test", "other", "near", "hull", "paper", "rim"];

  // Colours that differ between light and dark stand in the style sheet.
  const readLook = () => {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  };
  const darkNow = () => {
    const root = document.documentElement;
    return getComputedStyle(root).colorScheme === "dark" || (!root.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
  };
  const switchTheme = () => { document.documentElement.dataset.theme = darkNow() ? "light" : "dark"; };
  // Light colours have a dark rim, dark ones a white one.
  const rim = (colour) => {
    const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b > 140 ? `rgb(${r * 0.43} ${g * 0.43} ${b * 0.43})` : "#ffffff";
  };

  const cm = (v) => v / 100;
  // Positions come in cm, as differences after the first.
  const unpack = (v) => {
    const sum = (list) => { let s = 0; return Float32Array.from(list, (d) => cm(s += d)); };
    return { ...v, x: sum(v.x), y: sum(v.y) };
  };
  // Where a vehicle is at a frame, which may lie between two; null where it is not there.
  const at = (v, frame) => {
    const i = frame - v.first;
    if (i < 0 || i > v.x.length - 1) return null;
    const a = Math.floor(i), b = Math.min(a + 1, v.x.length - 1), t = i - a;
    return [v.x[a] + (v.x[b] - v.x[a]) * t, v.y[a] + (v.y[b] - v.y[a]) * t];
  };
  const speed = (v, frame, rate) => {
    const i = Math.min(Math.max(Math.floor(frame - v.first), 1), v.x.length - 1);
    return (v.x[i] - v.x[i - 1]) * rate;
  };
  // The point of a path at a step, which may lie between two.
  const along = (points, step) => {
    const a = Math.min(Math.floor(step), points.length - 1), b = Math.min(a + 1, points.length - 1), t = step - a;
    return [points[a][0] + (points[b][0] - points[a][0]) * t, points[a][1] + (points[b][1] - points[a][1]) * t];
  };
  // The next of those that have a place, by their order along the road.
  const next = (places, now, step) => {
    const there = [...places.keys()].sort((a, b) => places.get(a)[0] - places.get(b)[0]);
    const i = there.indexOf(now);
    return there.length ? there[(i < 0 ? 0 : i + step + there.length) % there.length] : null;
  };

  const fit = (canvas, pen) => {
    const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    const [w, h] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, box.width, box.height);
    return [box.width, box.height];
  };

  // A carriageway on a canvas; forward is right, left is up. Zoom 1 shows `range.x`; the road fills the height.
  class Road {
    constructor(canvas) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.look = {};
      this.range = { x: [0, 1], y: [0, 1] };
      [this.zoom, this.centre, this.width, this.height, this.sx, this.sy] = [1, 0, 1, 1, 1, 1];
    }
    px(x) { return (x - this.centre) * this.sx + this.width / 2; }
    py(y) { return this.height / 2 - (y - (this.range.y[0] + this.range.y[1]) / 2) * this.sy; }
    // The place, m, under a point of the canvas, px.
    place([x, y]) { return [(x - this.width / 2) / this.sx + this.centre, (this.height / 2 - y) / this.sy + (this.range.y[0] + this.range.y[1]) / 2]; }
    measure() {
      this.sx = (this.width / (this.range.x[1] - this.range.x[0])) * this.zoom;
      this.sy = this.height / (this.range.y[1] - this.range.y[0]);
    }
    // A clean canvas with the asphalt and its lines, `{ y, boundary }` in m; dashes start at `start` px.
    begin(lines, dash = [9, 7], start = 0) {
      const { pen } = this, ys = lines.map((line) => line.y);
      this.look = readLook();
      [this.width, this.height] = fit(this.canvas, pen);
      this.measure();
      pen.fillStyle = this.look.road;
      const top = this.py(Math.max(...ys));
      pen.fillRect(0, top, this.width, this.py(Math.min(...ys)) - top);
      for (const line of lines) {
        const y = this.py(line.y);
        pen.beginPath(); pen.moveTo(0, y); pen.lineTo(this.width, y);
        pen.strokeStyle = line.boundary ? this.look.edge : this.look.lane; pen.lineWidth = line.boundary ? 2 : 1;
        pen.setLineDash(line.boundary ? [] : dash); pen.lineDashOffset = start; pen.stroke(); pen.setLineDash([]);
      }
      pen.lineDashOffset = 0;
    }
    stroke(points, colour, width, dash = []) {
      const { pen } = this;
      pen.beginPath();
      points.forEach(([x, y], i) => (i ? pen.lineTo(this.px(x), this.py(y)) : pen.moveTo(this.px(x), this.py(y))));
      pen.strokeStyle = colour; pen.lineWidth = width; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
    }
    // A vehicle of this size, m; with a `round` of its corners, px, it gets a windscreen.
    box(size, [x, y], fill, rim, { dash = [], round = 0, width = 1 } = {}) {
      const { pen } = this, w = size[0] * this.sx, h = size[1] * this.sy, left = this.px(x) - w / 2, top = this.py(y) - h / 2;
      pen.beginPath();
      if (round) pen.roundRect(left, top, w, h, Math.min(round, w / 3, h / 3));
      if (fill) { pen.fillStyle = fill; if (round) pen.fill(); else pen.fillRect(left, top, w, h); }
      pen.setLineDash(dash); pen.strokeStyle = rim; pen.lineWidth = width;
      if (round) pen.stroke(); else pen.strokeRect(left, top, w, h);
      pen.setLineDash([]);
      if (!round || !fill || w < 14) return;
      const glass = left + w * (size[0] > 8 ? 0.84 : 0.6);
      pen.beginPath(); pen.moveTo(glass, top + h * 0.16); pen.lineTo(glass, top + h * 0.84); pen.strokeStyle = rim; pen.lineWidth = Math.min(w * 0.07, 2.5); pen.stroke();
    }
    // `scale`: px for 1 m/s².
    arrow([x, y], [fx, fy], scale, colour) {
      const { pen } = this, [dx, dy] = [fx * scale, -fy * scale], length = Math.hypot(dx, dy);
      if (length < 2) return;
      const [ux, uy, head] = [dx / length, dy / length, Math.min(length, 8)];
      const [x0, y0, tx, ty] = [this.px(x), this.py(y), this.px(x) + dx, this.py(y) + dy];
      const [nx, ny] = [tx - ux * head, ty - uy * head];
      for (const [style, width] of [[rim(colour), 4.5], [colour, 2.5]]) {
        pen.strokeStyle = style; pen.lineWidth = width;
        pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(nx, ny); pen.stroke();
      }
      pen.beginPath(); pen.moveTo(tx, ty); pen.lineTo(nx - uy * head / 2, ny + ux * head / 2); pen.lineTo(nx + uy * head / 2, ny - ux * head / 2); pen.closePath();
      pen.fillStyle = colour; pen.fill(); pen.strokeStyle = "#ffffff"; pen.lineWidth = .7; pen.stroke();
    }
    // How long lengths and, where there are any, forces are; and what is *simulated*.
    legend({ scale, simulated }) {
      const { pen } = this;
      pen.font = "12px system-ui, sans-serif"; pen.fillStyle = this.look.ink;
      const bar = [5, 10, 20, 50, 100].find((m) => m * this.sx > 60) || 100;
      pen.fillRect(10, this.height - 10, bar * this.sx, 2);
      pen.fillText(`${bar} m; lateral axis stretched ×${(this.sy / this.sx).toFixed(1)}`, 14 + bar * this.sx, this.height - 6);
      if (scale) {
        // Where there is little room, at the upper edge.
        const force = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5].find((f) => f * scale > 25) || 10;
        const [right, base] = [this.width - 100, this.width < 560 ? 14 : this.height - 6];
        pen.fillRect(right - force * scale, base - 4, force * scale, 2);
        pen.fillText(`force ${force} m/s²`, right + 6, base);
      }
      if (simulated) { pen.font = "bold 13px system-ui, sans-serif"; pen.fillText("simulated", 10, 16); }
    }
    // Where a pointer is on the canvas, px.
    pointer(event) {
      const area = this.canvas.getBoundingClientRect();
      return [event.clientX - area.left, event.clientY - area.top];
    }
    // Whether a point, px, is on a vehicle of this size, with at least `reach` px around its centre.
    covers([x, y], place, size, reach = 6) {
      return Math.abs(this.px(place[0]) - x) <= Math.max(size[0] * this.sx / 2, reach) && Math.abs(this.py(place[1]) - y) <= Math.max(size[1] * this.sy / 2, reach);
    }
  }

  // Parameters of the forces over a forecast. A panel is `{ title, colour, slots, values }`: `values[step]` are one, or one
  // for each neighbour slot; `present` are the slots with a vehicle; steps are `every` s apart, of `end` s; `now` is marked.
  const parameterChart = (canvas, { panels, present, every, end, now, empty }) => {
    const pen = canvas.getContext("2d"), look = readLook(), [w, h] = fit(canvas, pen);
    pen.font = "11px system-ui, sans-serif"; pen.fillStyle = look.ink;
    if (empty) { pen.fillText(empty, 10, 16); return; }
    // Beside each other, or below each other where there is little room.
    const narrow = w < 560, legend = 100, count = Math.max(panels.length, 1);
    const [wide, high] = narrow ? [w - legend, h / count] : [(w - legend) / count, h];
    const draw = (left, upper, title, curves) => {
      const top = Math.max(...curves.flatMap((c) => c.values), 1e-3) * 1.1;
      const X = (s) => left + 42 + (s / end) * (wide - 60), Y = (v) => upper + high - 22 - (v / top) * (high - 44);
      pen.fillStyle = look.ink; pen.strokeStyle = look.ink; pen.lineWidth = 1;
      pen.strokeRect(X(0), Y(top), wide - 60, high - 44);
      pen.fillText(title, X(0), upper + 14);
      for (const s of [0, 1, 2, 3, 4, 5].filter((s) => s <= end)) pen.fillText(`${s} s`, X(s) - 6, upper + high - 8);
      pen.textAlign = "right";
      for (const v of [0, top / 2.2, top / 1.1]) pen.fillText(v.toPrecision(2), left + 38, Y(v) + 4);
      pen.textAlign = "left";
      for (const { values, colour, dash } of curves) {
        pen.beginPath();
        values.forEach((v, i) => (i ? pen.lineTo(X(i * every), Y(v)) : pen.moveTo(X(0), Y(v))));
        pen.strokeStyle = colour; pen.lineWidth = 1.8; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
      }
      pen.strokeStyle = COLOURS.target; pen.beginPath(); pen.moveTo(X(now), Y(0)); pen.lineTo(X(now), Y(top)); pen.stroke();
    };
    const curves = ({ colour, slots, values }) => {
      // Dark lines on light paper, light ones on dark.
      const dark = rim(colour), light = dark !== "#ffffff", single = darkNow() ? (light ? colour : look.ink) : light ? dark : colour;
      if (!slots) return [{ values: values.map((v) => v[0]), colour: single, dash: [] }];
      if (!present.length) return [{ values: [0], colour: "#777", dash: [] }];
      return present.map((slot) => ({ values: values.map((v) => v[slot]), colour: SLOT_COLOURS[slot], dash: slot % 2 ? [5, 3] : [] }));
    };
    panels.forEach((panel, i) => draw(narrow ? 0 : wide * i, narrow ? high * i : 0, panel.title, curves(panel)));
    const bySlot = panels.findIndex((panel) => panel.slots);
    if (bySlot < 0) return;
    present.forEach((slot, n) => {
      const y = (narrow ? high * bySlot : 0) + 30 + 13 * n;
      pen.beginPath(); pen.moveTo(w - legend - 8, y - 4); pen.lineTo(w - legend + 10, y - 4);
      pen.strokeStyle = SLOT_COLOURS[slot]; pen.lineWidth = 2.4; pen.setLineDash(slot % 2 ? [5, 3] : []); pen.stroke(); pen.setLineDash([]);
      pen.fillStyle = look.ink; pen.fillText(SLOTS[slot], w - legend + 14, y);
    });
  };

  // Time that goes on: `advance(seconds)` each frame until it says false.
  class Clock {
    constructor(advance) { this.advance = advance; this.running = false; this.last = 0; this.frame = 0; }
    start() {
      if (this.running) return;
      this.running = true; this.last = performance.now();
      this.ask();
    }
    stop() { this.running = false; cancelAnimationFrame(this.frame); }
    ask() { this.frame = requestAnimationFrame((time) => this.tick(time)); }
    tick(time) {
      if (!this.running) return;
      const passed = Math.min(Math.max(time - this.last, 0), 100) / 1000;
      this.last = time;
      if (this.advance(passed) === false) this.running = false;
      else this.ask();
    }
  }

  // A text beside the pointer, and on the page; none hides it.
  const showTip = (tip, text, event) => {
    tip.hidden = !text;
    if (!text) return;
    tip.textContent = text;
    tip.style.left = `${Math.max(Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8), 0)}px`;
    tip.style.top = `${Math.max(Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8), 0)}px`;
  };

  return { COLOURS, SLOTS, Road, Clock, unpack, at, speed, along, next, cm, switchTheme, rim, readLook, parameterChart, showTip };
})();
