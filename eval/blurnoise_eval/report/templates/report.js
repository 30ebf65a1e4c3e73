let panels = [], mapAxes = ["exposure", "blur"];

function chosen() {
  const value = id => byId(id) ? byId(id).value : "0";
  const measure = value("measure") === "confidence" ? null : Number(value("measure"));
  const view = views[document.querySelector("#views [aria-pressed=true]").dataset.view], lines = Number(value("lines"));
  const [across, up] = [value("across"), value("up")];
  return {view, lines, measure, group: Number(value("group")), model: value("model"), across, up,
    fixed: fixedBut([view.along, lines]), mapFixed: fixedBut(mapUses(across, up)),
    name: measure === null ? run.shown : run.measures[measure].name};
}

function layPanels(model) {
  const shown = model === "all" ? models.map((_, index) => index) : [Number(model)];
  if (shown.join() === panels.map(panel => panel.model).join()) return;
  for (const panel of panels) for (const plot of [panel.curve, panel.map]) Plotly.purge(plot);
  byId("curves").replaceChildren();
  byId("maps").replaceChildren();
  panels = shown.map(index => {
    const title = models[index] ?? "";
    const {plot: curve, remark} = addPanel(byId("curves"), title, "curve");
    return {model: index, curve, remark, map: addPanel(byId("maps"), title, "map").plot};
  });
}

// The lines that the view allows, the usual ones first; the choice is shown where there is one.
function layLines() {
  const {view} = chosen(), lines = linesOver(view);
  byId("lines").replaceChildren(...lines.map(along => new Option(run.axes[along].word, along)));
  byId("lines").parentElement.hidden = lines.length < 2;
  hidden.clear();
}

// Only the selects that say something; that of the light always, unless neither chart holds it.
function laySelects({fixed, mapFixed}) {
  run.axes.forEach((_, along) => {
    if (selectOf(along)) selectOf(along).parentElement.hidden = !fixed.includes(along) && !mapFixed.includes(along);
  });
}

function draw() {
  const now = chosen();
  layPanels(now.model);
  layLegend(now);
  laySelects(now);
  byId("group").disabled = now.measure !== null;
  byId("reading").textContent = readingOf(now);
  byId("map-axes").textContent = `${now.across} × ${now.up}`;
  byId("colours").textContent = coloursOf(now);
  for (const panel of panels) { drawCurve(panel, now); drawMap(panel, now); }
}

// A map of an axis against itself is none: the other axis takes the place of the one that was chosen.
function chooseMap() {
  const [across, up] = [byId("across"), byId("up")];
  if (across.value === up.value) {
    if (across.value === mapAxes[0]) across.value = mapAxes[1];
    else up.value = mapAxes[0];
  }
  mapAxes = [across.value, up.value];
  draw();
}

function start() {
  for (const id of ["model", "measure", "group"]) byId(id)?.addEventListener("change", draw);
  for (const select of document.querySelectorAll("[data-axis]")) select.addEventListener("change", draw);
  byId("lines").addEventListener("change", () => { hidden.clear(); draw(); });
  for (const id of ["across", "up"]) byId(id).addEventListener("change", chooseMap);
  for (const button of document.querySelectorAll("#views button")) button.addEventListener("click", () => {
    for (const other of document.querySelectorAll("#views button")) other.setAttribute("aria-pressed", String(other === button));
    layLines();
    draw();
  });
  layLines();
  draw();
}

// The library of charts is packed in the page, which asks the network for nothing.
async function load() {
  const packed = Uint8Array.from(atob(byId("plotly").textContent), letter => letter.charCodeAt(0));
  const text = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  document.head.append(Object.assign(document.createElement("script"), {textContent: text}));
  start();
}
const ready = byId("plotly") ? load() : Promise.resolve();

function filterExamples() {
  const [model, outcome] = ["seen-by", "outcome"].map(id => byId(id)?.value ?? "all");
  let shown = 0;
  for (const figure of document.querySelectorAll(".pictures figure")) {
    figure.hidden = (model !== "all" && figure.dataset.model !== model) || (outcome !== "all" && figure.dataset.outcome !== outcome);
    shown += !figure.hidden;
  }
  if (byId("shown")) byId("shown").textContent = `${shown} shown`;
}
for (const id of ["seen-by", "outcome"]) byId(id)?.addEventListener("change", filterExamples);
filterExamples();
