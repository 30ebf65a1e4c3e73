"use strict";
/* The page's state is a query, which goes to the server whole. */
const one = (selector, within = document) => within.querySelector(selector);
const all = (selector) => [...document.querySelectorAll(selector)];
let query = document.body.dataset.query; // of what the controls show
let facts = null; // the last answer

/* Requests. While one is on its way only the newest query is kept, so that a slider shows what the machine can do and
   never lags behind. */
let wanted = null;
let running = false;
let rest = new AbortController();

async function show(next) {
  query = wanted = next;
  rest.abort(); // of the full picture and what follows
  if (running) return;
  running = true;
  document.body.classList.add("busy");
  while (wanted !== null) {
    const asked = wanted;
    wanted = null;
    rest = new AbortController();
    try {
      await answer(asked, rest.signal);
    } catch (error) {
      if (error.name === "AbortError") continue;
      if (facts) settle(facts); // the controls go back to what is shown
      say(error.message);
    }
  }
  running = false;
  document.body.classList.remove("busy");
}

async function asked(path, of, signal) {
  const response = await fetch(`${path}?${of}`, { signal });
  if (!response.ok) throw new Error(await response.text());
  return response;
}

async function answer(of, signal) {
  const preview = await asked("preview.jpg", of);
  if (preview.status === 200) {
    await paint(preview);
    await new Promise((resolve) => setTimeout(resolve, 150)); // a slider that has not moved since rests
    signal.throwIfAborted();
    await paint(await asked("picture.png", of, signal));
  } else {
    await paint(await asked("picture.png", of));
    signal.throwIfAborted();
  }
  settle(await (await asked("facts", of, signal)).json());
  document.body.classList.remove("busy");
  if (facts.scored) draw(await (await asked("curve", of, signal)).json());
}

async function paint(response) {
  const image = one(".seen img");
  const old = image.src;
  image.src = URL.createObjectURL(await response.blob());
  await image.decode();
  URL.revokeObjectURL(old);
}

/* What is shown. */
function say(text) {
  one("#message").textContent = text;
}

function settle(next) {
  facts = next;
  query = facts.query;
  history.replaceState(null, "", `?${query}`);
  if (facts.message) say(facts.message);
  one("#verdict").textContent = facts.verdict;
  one("#verdict").classList.toggle("no", !facts.good);
  one("#window").textContent = "";
  one("#curve").hidden = !facts.scored;
  for (const [name, [text, position]] of Object.entries(facts.controls)) {
    const control = one(`[data-control=${name}]`);
    one("span input", control).value = text;
    one("[type=range]", control).value = position;
  }
  one("#numbers").replaceChildren(
    ...facts.numbers.map(([name, title, text]) => {
      const entry = document.createElement("div");
      entry.append(document.createElement("dt"), document.createElement("dd"));
      entry.firstChild.textContent = title;
      entry.lastChild.textContent = text;
      entry.lastChild.dataset.number = name;
      return entry;
    }),
  );
  box(one(".seen svg"), facts.boxes);
  box(one(".original svg"), facts.original_boxes);
}

function box(svg, boxes) {
  const [width, height] = facts.size;
  const font = Math.max(width, height) / 32;
  const make = (tag, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.replaceChildren(
    ...boxes.map(({ box: [x, y, right, bottom], kind, text }) => {
      const group = make("g", { class: kind });
      const label = make("text", { x: Math.max(0, x), y: y > 1.3 * font ? y - 0.3 * font : y + font, "font-size": font });
      label.textContent = text;
      const size = { width: Math.max(0, right - x), height: Math.max(0, bottom - y) };
      group.append(make("rect", { x, y, ...size, "vector-effect": "non-scaling-stroke" }), label);
      return group;
    }),
  );
}

function draw(curve) {
  if (!curve.points.length) return;
  one("#window").textContent = curve.sentence;
  const ink = "#7c8894"; // readable on light and dark
  const level = (at) => ({ yref: "y", xref: "paper", x0: 0, x1: 1, y0: at, y1: at, line: { color: ink, dash: "dash", width: 1 } });
  const here = { yref: "paper", xref: "x", y0: 0, y1: 1, x0: curve.at_ms, x1: curve.at_ms, line: { color: ink, width: 2 } };
  const works = curve.window && { type: "rect", yref: "paper", y0: 0, y1: 1, x0: curve.window[0], x1: curve.window[1], fillcolor: "#12803f2b", line: { width: 0 } };
  Plotly.react(
    one("#curve div"),
    [{ x: curve.points.map((point) => point[0]), y: curve.points.map((point) => point[1]), mode: "lines+markers", line: { color: "#2584ad" } }],
    {
      height: 170, margin: { l: 34, r: 16, t: 8, b: 24 }, font: { color: ink }, paper_bgcolor: "transparent", plot_bgcolor: "transparent",
      xaxis: { type: "log", showgrid: false, dtick: 1 }, yaxis: { range: [0, 1.02], dtick: 0.5, gridcolor: "#7c889440" },
      shapes: [level(curve.required), here, works].filter(Boolean),
    },
    { displayModeBar: false, responsive: true },
  );
}

/* What people do. */
function changed(name, text) {
  const parts = new URLSearchParams(query);
  parts.delete(name);
  parts.append(name, text); // last, as a part resets what it excludes
  say("");
  show(parts.toString());
}

for (const control of all(".control")) {
  const [field, slider] = [one("span input", control), one("[type=range]", control)];
  const texts = JSON.parse(control.dataset.texts);
  slider.addEventListener("input", () => {
    field.value = texts[slider.value];
    changed(control.dataset.key, field.value);
  });
  field.addEventListener("change", () => changed(control.dataset.key, field.value));
}

function choose(kind, name) {
  const parts = new URLSearchParams(query); // another page, as its controls are others
  if (kind === "picture") ["moves", "seed", "repeat"].forEach((part) => parts.delete(part)); // are the picture's
  parts.set(kind, name);
  location.search = parts.toString();
}
for (const select of all("select")) select.addEventListener("change", () => choose(select.id, select.value));

async function open(file) {
  if (!file) return;
  try {
    const response = await fetch(`dropped?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    const text = await response.text();
    if (response.ok) choose("picture", text);
    else say(text);
  } catch {
    say(`${file.name}: cannot be read; must be a picture file`);
  }
}
one("#file").addEventListener("change", (event) => open(event.target.files[0]));
const holdsFiles = (event) => event.dataTransfer.types.includes("Files");
addEventListener("dragover", (event) => holdsFiles(event) && event.preventDefault());
addEventListener("drop", (event) => {
  if (!holdsFiles(event)) return;
  event.preventDefault();
  open(event.dataTransfer.files[0]);
});

one("#copy").addEventListener("click", async () => {
  try {
    one("#copied code").textContent = await (await asked("command", query)).text();
    one("#copied").showModal();
  } catch (error) {
    say(error.message);
  }
});

addEventListener("DOMContentLoaded", () => show(query)); // once Plotly is loaded
