"use strict";
const byId = id => document.getElementById(id);
const run = JSON.parse(byId("numbers").textContent);
const models = [...document.querySelectorAll("#model option:not([value=all])")].map(option => option.textContent);
const touch = matchMedia("(pointer: coarse)").matches, narrow = matchMedia("(max-width: 640px)").matches;
// Only buttons that work offline: the library would otherwise offer to upload the chart.
const config = {responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]]};
const common = {font: {family: "system-ui, sans-serif", size: 13, color: "#1d2329"}, paper_bgcolor: "#fff",
  plot_bgcolor: "#fff", hoverlabel: {align: "left"}, hovermode: "closest", showlegend: false,
  dragmode: touch ? false : "zoom"};
const axis = {gridcolor: "#e8ecef", zeroline: false, showline: true, linecolor: "#9aa4ad", automargin: true};
const blurOf = p => run.speeds_px_s[p.velocity] * run.exposures_ms[p.exposure] / 1e3;
const height = blur => blur < 1 ? blur : 1 + Math.log10(blur);  // blur is drawn linear below 1 px, logarithmic above
const blurTicks = [0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
const blurAxis = {tickvals: blurTicks.map(height), ticktext: blurTicks.map(String), title: {text: "Motion blur / px"}};
const short = (value, digits = 3) => String(Number(value.toPrecision(digits)));
const views = {
  exposure: {x: p => run.exposures_ms[p.exposure], line: "velocity", names: run.velocities,
    colours: run.velocity_colours, joined: true, axis: {title: {text: "Exposure / ms"}}, log: true,
    reading: "One line per speed. Along a line the exposure grows: light, noise and blur all change together."},
  blur: {x: p => height(blurOf(p)), line: "exposure", names: run.exposures, colours: run.exposure_colours,
    joined: run.joined, axis: blurAxis,
    reading: "One line per exposure. Along a line only the speed changes; from line to line the light per picture "
      + "changes too, so two lines at the same blur differ by noise."},
  speed: {x: p => run.speeds_px_s[p.velocity], line: "exposure", names: run.exposures, colours: run.exposure_colours,
    joined: run.joined, axis: {title: {text: "Speed / (px/s)"}},
    reading: "One line per exposure. Along a line the light is the same; only the speed, and with it the blur, changes."},
};
const hidden = new Set();  // lines that the reader has switched off
let panels = [];

// The library reads a few tags in labels; names are text.
function label(name) {
  const cut = [...name].length > 26 ? [...name].slice(0, 25).join("") + "…" : name;
  return cut.replace(/[&<>]/g, sign => ({"&": "&amp;", "<": "&lt;", ">": "&gt;"})[sign]);
}

function chosen() {
  const value = id => byId(id) ? byId(id).value : "0";
  const measure = value("measure") === "confidence" ? null : Number(value("measure"));
  return {view: views[document.querySelector("#views [aria-pressed=true]").dataset.view], measure,
    group: Number(value("group")), light: Number(value("light")), model: value("model"),
    name: measure === null ? "Mean confidence" : run.measures[measure].name};
}

function rowsOf(model, {measure, group, light}) {
  if (measure === null) return run.points.filter(p => p[0] === model && p[1] === group && p[2] === light)
    .map(([, , , velocity, exposure, y, low, high, n]) => ({velocity, exposure, y, low, high, count: `${n} targets`}));
  return run.scores.filter(p => p[0] === model && p[1] === light && p[5 + measure] !== null).map(p =>
    ({velocity: p[2], exposure: p[3], y: p[5 + measure], low: null, high: null, count: `${p[4]} pictures`}));
}

const cleanOf = (model, {measure, group}) => measure === null ? run.clean_confidence[model][group] : run.clean[model][measure];

// One scale for all models and lights: confidences as they are, other measures up to their largest value.
function largest({measure}) {
  if (measure === null) return 1;
  const values = [...run.scores.map(p => p[5 + measure]), ...run.clean.map(row => row[measure])];
  return values.reduce((most, value) => Math.max(most, value ?? 0), 0) || 1;
}

function hover(p, name) {
  const interval = p.low === null || p.high === null ? "" : ` (95 %: ${p.low.toFixed(2)} to ${p.high.toFixed(2)})`;
  return `${name} ${p.y.toFixed(3)}${interval}<br>exposure ${run.exposures[p.exposure]}<br>`
    + `speed ${run.velocities[p.velocity]}, blur ${short(blurOf(p))} px<br>${p.count}`;
}

function failureTrace(model, {group, light}) {
  const here = run.failures.filter(f => f[0] === model && f[1] === group && f[2] === light
    && f[4] !== null && !hidden.has(f[3]));
  const end = ([, , , , at, low, high, , last]) => high ?? (low === null ? at : last);
  const text = ([, , , exposure, at, low, high, returned]) => `${run.exposures[exposure]}: fails at ${short(at)} px`
    + (low === null ? "" : `<br>95 %: ${short(low)} px to ${high === null ? "beyond the range" : short(high) + " px"}`)
    + (returned ? "<br>non-monotonic: had been below and come back" : "");
  return {x: here.map(f => height(f[4])), y: here.map(() => run.threshold), text: here.map(text), mode: "markers",
    hovertemplate: "%{text}<extra></extra>", marker: {size: 11, color: here.map(f => run.exposure_colours[f[3]]),
      symbol: here.map(f => f[7] ? "diamond-open" : "diamond"), line: {width: 1.5, color: here.map(f => f[7] ? run.exposure_colours[f[3]] : "#fff")}},
    error_x: {type: "data", symmetric: false, array: here.map(f => height(end(f)) - height(f[4])), arrayminus: here.map(f => height(f[4]) - height(f[5] ?? f[4])),
      color: "#4a545d", thickness: 1, width: 3}};
}

// The line through the points: straight in px of blur, as failure points are read from it, hence bent on that axis.
function between(line, view) {
  if (view !== views.blur) return {x: line.map(view.x), y: line.map(p => p.y)};
  const dense = line.slice(1).flatMap((p, i) => Array.from({length: 12}, (_, k) => {
    const share = k / 12, q = line[i];
    return [height(blurOf(q) + share * (blurOf(p) - blurOf(q))), q.y + share * (p.y - q.y)];
  }));
  const last = line[line.length - 1];
  return {x: [...dense.map(at => at[0]), view.x(last)], y: [...dense.map(at => at[1]), last.y]};
}

function drawCurve(panel, now) {
  const {view, measure} = now, rows = rowsOf(panel.model, now), traces = [], shapes = [];
  const level = (y, dash) => ({type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: {color: "#444", width: 1.2, dash}});
  if (measure === null) shapes.push(level(run.threshold, "dash"));
  const clean = cleanOf(panel.model, now);
  if (clean !== null && clean !== undefined) shapes.push(level(clean, "dot"));
  view.names.forEach((name, index) => {
    const line = rows.filter(p => p[view.line] === index).sort((a, b) => view.x(a) - view.x(b));
    if (!line.length || hidden.has(index)) return;
    const colour = view.colours[index], bounded = line.filter(p => p.low !== null && p.high !== null);
    if (view.log && bounded.length > 1) traces.push({
      x: [...bounded.map(view.x), ...bounded.map(view.x).reverse()],
      y: [...bounded.map(p => p.low), ...bounded.map(p => p.high).reverse()],
      fill: "toself", fillcolor: colour + "26", line: {width: 0}, mode: "lines", hoverinfo: "skip"});
    if (view.joined) traces.push({...between(line, view), mode: "lines", line: {color: colour, width: 2}, hoverinfo: "skip"});
    traces.push({x: line.map(view.x), y: line.map(p => p.y), text: line.map(p => `${name}<br>${hover(p, now.name)}`),
      hovertemplate: "%{text}<extra></extra>", mode: "markers", marker: {color: colour, size: 6}});
  });
  if (measure === null && view === views.blur) traces.push(failureTrace(panel.model, now));
  const step = 0.035, bars = measure === null && view.log ? run.velocities.length : 0, most = largest(now);
  if (bars) run.windows.filter(w => w[0] === panel.model && w[1] === now.group && w[2] === now.light && !hidden.has(w[3]))
    .forEach(([, , , velocity, low, high]) => {
      const y = -0.05 - step * velocity, colour = view.colours[velocity];
      shapes.push({type: "rect", x0: 1e3 * low, x1: 1e3 * high, y0: y - 0.011, y1: y + 0.011, line: {width: 1, color: colour}, fillcolor: colour});
    });
  const ends = [run.exposures_ms[0], run.exposures_ms[run.exposures_ms.length - 1]].map(Math.log10);
  const xaxis = {...axis, ...view.axis};
  if (view.log) Object.assign(xaxis, {type: "log", range: [ends[0] - 0.07, ends[1] + 0.07], dtick: "D2", tickformat: "~g"});
  else xaxis.range = [-0.03, 1.03].map(share => share * Math.max(...allX(view)));
  const yaxis = {...axis, showline: false, title: {text: now.name}, range: [(-0.05 - step * bars) * most, 1.05 * most]};
  if (measure === null) yaxis.tickvals = [0, 0.2, 0.4, 0.6, 0.8, 1];
  Plotly.react(panel.curve, traces, {...common, xaxis, yaxis, shapes, margin: {l: 52, r: 12, t: 30, b: 44}}, config);
  panel.remark.textContent = remark(panel.model, now);
}

const allX = view => run.velocities.flatMap((_, velocity) => run.exposures.map((_, exposure) => view.x({velocity, exposure})));

function remark(model, {view, measure, group, light}) {
  if (measure !== null || view !== views.blur) return "";
  const back = run.failures.filter(f => f[0] === model && f[1] === group && f[2] === light && f[7]).map(f => run.exposures[f[3]]);
  return back.length ? `Non-monotonic at ${back.join(", ")}: below the threshold, and back again.` : "";
}

// Tiles of exposure × blur: a column per exposure, in it a tile around each tested blur.
function tiles(rows) {
  return run.exposures.flatMap((_, exposure) => {
    const atBlur = new Map();
    for (const p of rows.filter(p => p.exposure === exposure)) {
      const speed = run.speeds_px_s[p.velocity];
      atBlur.set(speed, [...(atBlur.get(speed) ?? []), p]);
    }
    const stack = [...atBlur.values()].sort((a, b) => blurOf(a[0]) - blurOf(b[0]));
    const at = stack.map(same => height(blurOf(same[0])));
    return stack.map((same, i) => {
      const down = i ? (at[i] - at[i - 1]) / 2 : 0, up = i + 1 < at.length ? (at[i + 1] - at[i]) / 2 : 0;
      const below = i ? down : Math.min(up || 0.25, 0.25), above = i + 1 < at.length ? up : Math.min(down || 0.25, 0.25);
      return {exposure, from: at[i] - below, tall: below + above, p: same[0],
        y: same.reduce((sum, p) => sum + p.y, 0) / same.length, several: same.length};
    });
  });
}

function drawMap(panel, now) {
  const found = tiles(rowsOf(panel.model, now)), most = largest(now);
  const t = Math.min(Math.max(run.threshold, 0.01), 0.99);
  const colorscale = now.measure === null ? [[0, "#8c4a0b"], [t - 0.001, "#fbeedd"], [t, "#d5e5f1"], [1, "#1f5f99"]]
    : run.measures[now.measure].more ? [[0, "#f1f5f9"], [1, "#1f5f99"]] : [[0, "#faf5ee"], [1, "#8c4a0b"]];
  const edges = found.flatMap(tile => [tile.from, tile.from + tile.tall]);
  const range = [Math.min(...edges), Math.max(...edges)], small = narrow || panels.length > 2;
  const roomPx = panel.map.clientHeight - 76, fits = tile => roomPx * tile.tall / (range[1] - range[0]) > (small ? 11 : 13)
    && panel.map.clientWidth / run.exposures.length > 30;
  const text = tile => (tile.several > 1 ? `mean of ${tile.several} directions: ${tile.y.toFixed(3)}<br>` : "") + hover(tile.p, now.name);
  const columns = run.exposures.map(exposure => exposure.replace(" ms", ""));
  Plotly.react(panel.map, [{type: "bar", x: found.map(tile => columns[tile.exposure]), base: found.map(tile => tile.from),
    y: found.map(tile => tile.tall), text: found.map(tile => fits(tile) ? tile.y.toFixed(2) : ""), customdata: found.map(text), width: 0.94,
    texttemplate: "%{text}", hovertemplate: "%{customdata}<extra></extra>", textposition: "inside", insidetextanchor: "middle",
    textangle: 0, constraintext: "none", insidetextfont: {size: small ? 10 : 12},
    marker: {color: found.map(tile => tile.y), colorscale, cmin: 0, cmax: most, line: {color: "#fff", width: found.length > 60 ? 0.4 : 1.5}}}], {
    ...common, barmode: "overlay",
    xaxis: {...axis, type: "category", categoryorder: "array", categoryarray: columns, title: {text: "Exposure / ms"}, showgrid: false},
    yaxis: {...axis, ...blurAxis, range, showgrid: false},
    margin: {l: 52, r: 12, t: 30, b: 46}}, config);
}

function drawTrades() {
  const most = Math.max(...run.trades.flatMap(trade => trade.points.map(p => p[2] ?? p[1])));
  const plots = run.trades.map(trade => addPanel(byId("trades"), trade.name, "trade").plot);  // all, then draw: widths
  run.trades.forEach((trade, index) => {
    const front = trade.points.filter(p => p[4]).sort((a, b) => a[1] - b[1]);
    const values = trade.points.map(p => p[3]), room = Math.max(0.02, 0.25 * (Math.max(...values) - Math.min(...values)));
    Plotly.newPlot(plots[index], [
      {x: front.map(p => p[1]), y: front.map(p => p[3]), mode: "lines", line: {color: "#9db7cd", width: 1.5}, hoverinfo: "skip"},
      {x: trade.points.map(p => p[1]), y: values, mode: "markers+text", cliponaxis: false,
        text: trade.points.map(p => label(models[p[0]])), textposition: "top center", textfont: {size: 12},
        customdata: trade.points.map(p => `${label(models[p[0]])}${p[4] ? " (Pareto front)" : ""}<br>${trade.name} ${p[3].toFixed(3)}<br>`
          + `median ${short(p[1])} ms` + (p[2] === null ? "" : `, 95th percentile ${short(p[2])} ms`)),
        hovertemplate: "%{customdata}<extra></extra>",
        error_x: {type: "data", symmetric: false, array: trade.points.map(p => (p[2] ?? p[1]) - p[1]), arrayminus: values.map(() => 0),
          color: "#7b8791", thickness: 1.2, width: 4},
        marker: {size: 11, color: trade.points.map(p => p[4] ? "#1f5f99" : "#fff"), line: {width: 2, color: trade.points.map(p => p[4] ? "#1f5f99" : "#7b8791")}}}],
      {...common, xaxis: {...axis, title: {text: "Latency / ms"}, range: [0, 1.2 * most]},
        yaxis: {...axis, title: {text: trade.name}, range: [Math.min(...values) - room, Math.max(...values) + 1.6 * room]},
        margin: {l: 56, r: 12, t: 30, b: 44}}, config);
  });
}

function addPanel(parent, title, kind) {
  const figure = document.createElement("figure"), plot = document.createElement("div"), remark = document.createElement("p");
  if (title) figure.append(Object.assign(document.createElement("h3"), {textContent: title}));
  plot.className = `plot ${kind}`;
  remark.className = "note";
  figure.append(plot, remark);
  parent.append(figure);
  return {plot, remark};
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

function layLegend(view) {
  byId("legend").replaceChildren(...view.names.map((name, index) => {
    const button = document.createElement("button"), chip = document.createElement("i");
    chip.style.background = view.colours[index];
    button.type = "button";
    button.setAttribute("aria-pressed", String(!hidden.has(index)));
    button.append(chip, name);
    button.addEventListener("click", () => { hidden.delete(index) || hidden.add(index); draw(); });
    return button;
  }));
}

function draw() {
  const now = chosen(), confidence = now.measure === null;
  layPanels(now.model);
  layLegend(now.view);
  byId("group").disabled = !confidence;
  byId("reading").textContent = now.view.reading + " Dotted: the untouched pictures."
    + (confidence ? " Dashed: the threshold." : " Of all targets together, without intervals.")
    + (confidence && now.view.log ? " Bars below zero are the exposure window at each speed." : "")
    + (confidence && now.view === views.blur ? " Diamonds: where a curve falls below the threshold for good, with the 95 % interval; hollow: non-monotonic." : "");
  byId("colours").textContent = `${now.name}, for the choice above: a column per exposure, a tile around each tested blur. `
    + (confidence ? `Blue: at or above the threshold ${run.threshold}; brown: below.` : run.measures[now.measure].more ? "Darker is better." : "Darker is worse.");
  for (const panel of panels) { drawCurve(panel, now); drawMap(panel, now); }
}

if (run.trades.length) drawTrades();
if (byId("curves")) {
  for (const id of ["model", "measure", "group", "light"]) byId(id)?.addEventListener("change", draw);
  for (const button of document.querySelectorAll("#views button")) button.addEventListener("click", () => {
    for (const other of document.querySelectorAll("#views button")) other.setAttribute("aria-pressed", String(other === button));
    hidden.clear();
    draw();
  });
  draw();
}
byId("seen-by")?.addEventListener("change", event => {
  for (const figure of document.querySelectorAll(".pictures figure"))
    figure.hidden = event.target.value !== "all" && figure.dataset.model !== event.target.value;
});
