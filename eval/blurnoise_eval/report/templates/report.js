"use strict";
// The curves and heat maps. Every row has its places on the axes of the run: at = [exposure, velocity, light, ...].
// A view goes along one axis and has a line for each value of another; all other axes stand where their selects say.
const EXPOSURE = 0, VELOCITY = 1;
const byId = id => document.getElementById(id);
const run = JSON.parse(byId("numbers").textContent);
const {axes, views, measures} = run;
const rowsOf = rows => rows.map(([place, y, low, high, n]) => ({at: run.conditions[place], y, low, high, n}));
const series = run.series.map(([measure, model, group, clean, rows]) => ({measure, model, group, clean, rows: rowsOf(rows)}));
const models = [...document.querySelectorAll(".models thead th")].slice(1).map(head => head.textContent);
const colour = name => getComputedStyle(document.querySelector(".panels")).getPropertyValue(`--${name}`).trim();
// Only buttons that work offline: the library would otherwise offer to upload the chart.
const config = {responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]]};
const night = matchMedia("(prefers-color-scheme: dark)");  // charts have the page's colours, and change with them
const coloursOf = axis => night.matches ? axes[axis].by_night : axes[axis].colours;
const layout = () => ({font: {family: "system-ui, sans-serif", size: 13, color: colour("ink")}, paper_bgcolor: colour("paper"),
  plot_bgcolor: colour("paper"), hoverlabel: {align: "left"}, hovermode: "closest", showlegend: false, dragmode: false, margin: {l: 52, r: 12, t: 30, b: 46}});
const axisStyle = () => ({gridcolor: colour("line"), zeroline: false, showline: true, linecolor: colour("soft"), automargin: true});
const short = (value, digits = 3) => String(Number(value.toPrecision(digits)));
const several = axis => axes[axis].count > 1;

const blurOf = at => axes[VELOCITY].x[at[VELOCITY]] * axes[EXPOSURE].x[at[EXPOSURE]] / 1e3;
const height = blur => blur < 1 ? blur : 1 + Math.log10(blur);  // blur is drawn linear below 1 px, logarithmic above
const ofBlur = view => view.scale === "symlog";
const xOf = (view, at) => ofBlur(view) ? height(blurOf(at)) : axes[view.along].x[at[view.along]];
const xAxis = ({title, scale, ticks, range}) => ({...axisStyle(), title: {text: title}, range,
  type: scale === "log" ? "log" : "linear",
  ...(ticks ? {tickvals: ticks.map(tick => tick[0]), ticktext: ticks.map(tick => tick[1])}
    : scale === "log" ? {dtick: "D2", tickformat: "~g"} : {})});

// What is chosen; the axes that a chart does not use stand at the value of their select.
function chosen() {
  const value = id => Number(byId(id)?.value ?? 0);
  const view = views[value("view")], up = value("up"), measure = value("measure");
  const besides = used => axes.map((_, axis) => axis).filter(axis => !used.includes(axis));
  return {view, up, measure, group: measure ? 0 : value("group"),
    held: besides([view.along, view.lines]), mapHeld: besides([EXPOSURE, up])};
}
const selectOf = axis => document.querySelector(`[data-axis="${axis}"]`);
const standing = (rows, held) => rows.filter(({at}) => held.every(axis => at[axis] === Number(selectOf(axis)?.value ?? 0)));
const seriesOf = (model, {measure, group}) =>
  series.find(each => each.measure === measure && each.model === model && each.group === group) ?? {clean: null, rows: []};

function hover({at, y, low, high, n}, {measure}) {
  const interval = low === null || high === null ? "" : ` (95 %: ${low.toFixed(2)} to ${high.toFixed(2)})`;
  const [exposure, speed, ...setting] = axes.map(({texts}, axis) => texts[at[axis]]);
  return `${measures[measure].name} ${y.toFixed(3)}${interval}<br>exposure ${exposure}<br>`
    + `speed ${speed}, blur ${short(blurOf(at))} px<br>${setting.join(" · ")}<br>${n} ${measure ? "pictures" : "targets"}`;
}

function lineTraces(line, name, colour, now) {
  const {view} = now, x = line.map(p => xOf(view, p.at)), traces = [];
  const bounded = line.filter(p => p.low !== null && p.high !== null), ends = bounded.map(p => xOf(view, p.at));
  if (view.bands && bounded.length > 1) traces.push({x: [...ends, ...ends.toReversed()],
    y: [...bounded.map(p => p.low), ...bounded.map(p => p.high).reverse()],
    fill: "toself", fillcolor: colour + "26", line: {width: 0}, mode: "lines", hoverinfo: "skip"});
  traces.push({x, y: line.map(p => p.y), text: line.map(p => `${name}<br>${hover(p, now)}`),
    hovertemplate: "%{text}<extra></extra>", mode: view.joined ? "lines+markers" : "markers",
    marker: {color: colour, size: 6}, line: {color: colour, width: 2},
    error_y: {type: "data", visible: !view.bands && bounded.length > 0, symmetric: false, thickness: 0.8, width: 0, color: colour + "88",
      array: line.map(p => (p.high ?? p.y) - p.y), arrayminus: line.map(p => p.y - (p.low ?? p.y))}});
  return traces;
}

// Bars below zero: windows of each line, the intervals of their ends, and a tick at the exposure to use.
function windowBars(model, now) {
  const bars = [], ink = colour("ink"), ms = axes[EXPOSURE].x, [first, last] = [Math.min(...ms) / 1e3, Math.max(...ms) / 1e3];
  for (const [of, group, at, works, chosen, , windows] of run.windows) {
    const line = at[now.view.lines], y = -0.05 - 0.035 * line, colour = coloursOf(now.view.lines)[line];
    if (of !== model || group !== now.group || !standing([{at}], now.held).length) continue;
    const bar = (from, to, half, opacity) => bars.push({type: "rect", x0: 1e3 * from, x1: 1e3 * to, y0: y - half, y1: y + half,
      line: {width: 1, color: colour}, fillcolor: colour, opacity});
    for (const [low, high, ...bounds] of windows) {
      bar(low, high, 0.011, works ? 1 : 0.35);
      for (const [from, to] of bounds) if (from !== null || to !== null) bar(from ?? first, to ?? last, 0.002, 1);
    }
    if (chosen !== null) bars.push({type: "line", x0: 1e3 * chosen, x1: 1e3 * chosen, y0: y - 0.018, y1: y + 0.018, line: {width: 2, color: ink}});
  }
  return bars;
}

function drawCurve(panel, now) {
  const {view, measure} = now, {texts, count} = axes[view.lines], colours = coloursOf(view.lines), {clean, rows} = seriesOf(panel.model, now);
  const here = standing(rows, now.held), traces = [], shapes = [];
  const level = (y, dash) => shapes.push({type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: {color: colour("soft"), width: 1.2, dash}});
  if (!measure) level(run.threshold, "dash");
  if (clean !== null) level(clean, "dot");
  for (let index = 0; index < count; index++) {
    const line = here.filter(p => p.at[view.lines] === index).sort((a, b) => xOf(view, a.at) - xOf(view, b.at));
    if (line.length) traces.push(...lineTraces(line, texts[index], colours[index], now));
  }
  const bars = !measure && view.along === EXPOSURE ? count : 0, most = measures[measure].most;
  if (bars) shapes.push(...windowBars(panel.model, now));
  const yaxis = {...axisStyle(), showline: false, title: {text: measures[measure].name}, range: [(-0.05 - 0.035 * bars) * most, 1.05 * most],
    ...(measure ? {} : {tickvals: [0, 0.2, 0.4, 0.6, 0.8, 1]})};
  Plotly.react(panel.curve, traces, {...layout(), xaxis: xAxis(view), yaxis, shapes}, config);
}

// A heat map has a column per exposure of the grid and a row per value of another axis.
function drawMap(panel, now) {
  const {up, measure} = now, {name, better, most} = measures[measure];
  const tiles = standing(seriesOf(panel.model, now).rows, now.mapHeld).filter(({at}) => at[EXPOSURE] < axes[EXPOSURE].count);
  const t = Math.min(Math.max(run.threshold / most, 0.01), 0.99);
  const colorscale = !measure ? [[0, "#8c4a0b"], [t - 0.001, "#fbeedd"], [t, "#d5e5f1"], [1, "#1f5f99"]]
    : better === "lower" ? [[0, "#faf5ee"], [1, "#8c4a0b"]] : [[0, "#f1f5f9"], [1, "#1f5f99"]];
  // Cannot tell: the interval includes the criterion, or there is none.
  const unsure = p => !measure && (p.low === null || p.high === null || p.low < run.threshold && p.high >= run.threshold);
  const ticks = ({title, texts, count}, most) => {
    const shown = texts.slice(0, count).map((_, i) => i).filter(i => i % Math.ceil(count / most) === 0);
    return {...axisStyle(), title: {text: title, standoff: 8}, showgrid: false, range: [-0.5, count - 0.5], tickvals: shown, ticktext: shown.map(i => texts[i])};
  };
  Plotly.react(panel.map, [{type: "bar", x: tiles.map(({at}) => at[EXPOSURE]), width: 0.96, base: tiles.map(({at}) => at[up] - 0.5), y: tiles.map(() => 1),
    text: tiles.map(p => p.y.toFixed(2) + (unsure(p) ? "?" : "")), customdata: tiles.map(p => hover(p, now)),
    texttemplate: "%{text}", hovertemplate: "%{customdata}<extra></extra>", textposition: "inside", insidetextanchor: "middle", textangle: 0,
    marker: {color: tiles.map(p => p.y), colorscale, cmin: 0, cmax: most, line: {color: colour("paper"), width: 0.8}}}], {
    ...layout(), barmode: "overlay", uniformtext: {minsize: 10, mode: "hide"}, xaxis: ticks(axes[EXPOSURE], 8), yaxis: ticks(axes[up], 16)}, config);
}

function addPlot(parent, title, kind) {
  const figure = document.createElement("figure"), plot = document.createElement("div");
  if (title) figure.append(Object.assign(document.createElement("h3"), {textContent: title}));
  plot.className = `plot ${kind}`;
  figure.append(plot);
  parent.append(figure);
  return plot;
}

// A figure for each model, side by side.
const panels = [];
function layPanels() {
  const name = model => models.length > 1 ? models[model] : "";
  models.forEach((_, model) => panels.push({model, curve: addPlot(byId("curves"), name(model), "curve"), map: addPlot(byId("maps"), name(model), "map")}));
}

function layLegend({view}) {
  const {texts, count} = axes[view.lines], colours = coloursOf(view.lines);
  byId("legend").replaceChildren(...texts.slice(0, count).map((name, index) => {
    const entry = document.createElement("span"), chip = document.createElement("i");
    chip.style.background = colours[index];
    entry.append(chip, name);
    return entry;
  }));
}

function layWords({view, up, measure, held, mapHeld}) {
  const text = axesHeld => axesHeld.filter(axis => axis <= VELOCITY && several(axis)).map(axis => `, at ${axes[axis].texts[Number(selectOf(axis).value)]}`).join("");
  byId("reading").textContent = `One line per ${axes[view.lines].word}${text(held)}. ${view.reading} Dotted: the original pictures. `
    + (measure ? "Over all targets." : "Dashed: the criterion.");
  byId("map-axes").textContent = `exposure × ${axes[up].word}`;
  byId("colours").textContent = `${measures[measure].name} for the selection above, a column per exposure${text(mapHeld)}. ` + (measure ? "Darker is more."
    : `Blue: at or above the criterion ${run.threshold}; brown: below; “?”: cannot tell, as the 95 % interval includes the criterion or is missing.`);
  axes.forEach((_, axis) => {
    if (selectOf(axis)) selectOf(axis).parentElement.hidden = !held.includes(axis) && !mapHeld.includes(axis);
  });
  byId("group").disabled = measure > 0;
}

function draw() {
  const now = chosen();
  layLegend(now);
  layWords(now);
  for (const panel of panels) { drawCurve(panel, now); drawMap(panel, now); }
}

// The library of charts is packed in the page, which asks the network for nothing.
async function load() {
  const packed = Uint8Array.from(atob(byId("plotly").textContent), letter => letter.charCodeAt(0));
  const text = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  document.head.append(Object.assign(document.createElement("script"), {textContent: text}));
  layPanels();
  for (const select of document.querySelectorAll(".charts select")) select.addEventListener("change", draw);
  night.addEventListener("change", draw);
  draw();
}
const ready = load();  // tests wait for it
