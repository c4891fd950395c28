// Drives the report's player as a user would, and writes what it saw into the page.
(async () => {
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const road = document.getElementById("road"), player = document.getElementById("player");
  const status = () => document.getElementById("status").textContent;
  const key = (name) => road.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true }));
  const colours = () => {
    const { data } = road.getContext("2d").getImageData(0, 0, road.width, road.height);
    const seen = new Map();
    for (let i = 0; i < data.length; i += 4) {
      const c = `${data[i]},${data[i + 1]},${data[i + 2]}`;
      seen.set(c, (seen.get(c) || 0) + 1);
    }
    return seen;
  };
  const yellow = () => colours().get("245,196,0") || 0;
  const result = { errors: window.__errors };
  try {
    key("Home");
    result.start = status();
    result.colours = colours().size;
    for (let i = 0; i < 45; i++) key("ArrowRight");
    result.stepped = status();
    // Until a vehicle with a forecast is picked.
    for (let i = 0; i < 60 && !status().includes("forecast made"); i++) key("n");
    result.picked = status();
    result.forces = yellow();
    key("f");
    result.withoutForces = yellow();
    result.pressed = document.getElementById("forces").getAttribute("aria-pressed");
    key("f");
    const before = status();
    // A browser that only dumps a page draws no frames: time stands in for them.
    window.requestAnimationFrame = (frame) => setTimeout(() => frame(performance.now()), 20);
    document.getElementById("play").click();
    await wait(600);
    document.getElementById("play").click();
    result.played = status() !== before;
    const slider = document.getElementById("time");
    slider.value = 20;
    slider.dispatchEvent(new Event("input"));
    result.scrubbed = status();
    const box = road.getBoundingClientRect();
    const tip = document.getElementById("tip");
    for (let x = 4; x < box.width && tip.hidden; x += 6) {
      for (let y = 4; y < box.height && tip.hidden; y += 6) {
        road.dispatchEvent(new MouseEvent("mousemove", { clientX: box.left + x, clientY: box.top + y, bubbles: true }));
        if (!tip.hidden) road.dispatchEvent(new MouseEvent("click", { clientX: box.left + x, clientY: box.top + y, bubbles: true }));
      }
    }
    result.hover = tip.textContent;
    result.clicked = status();
    // A moment by its address.
    location.hash = "#t=5.5&vehicle=25";
    await wait(50);
    result.addressed = status();
    result.tip = [tip.getBoundingClientRect().right <= innerWidth, tip.getBoundingClientRect().bottom <= innerHeight];
    result.ready = document.getElementById("ready").textContent;
    document.getElementById("theme").click();
    result.theme = document.documentElement.dataset.theme;
  } catch (error) {
    result.errors.push(String(error));
  }
  const out = document.createElement("pre");
  out.id = "driven";
  out.textContent = JSON.stringify(result);
  document.body.append(out);
})();
