const hidden = new Set();  // lines that the reader has switched off

const ofGroup = (rows, model, group) => rows.filter(p => p.model === model && p.group === group);

function rowsOf(model, {measure, group}) {
  if (measure === null) return ofGroup(run.points, model, group);
  return run.scores.filter(p => p.model === model && p.y[measure] !== null)
    .map(p => ({...p, y: p.y[measure], low: p.y_low[measure], high: p.y_high[measure]}));
}

const cleanOf = (model, {measure, group}) => measure === null ? run.clean_confidence[model][group] : run.clean[model][measure];

// One scale for all models and settings, up to the largest value; what is asked for: at least to 1.
function largest({measure}) {
  if (measure === null) return run.highest;
  return [...run.scores.map(p => p.y), ...run.clean].reduce((most, values) => Math.max(most, values[measure] ?? 0), 0) || 1;
}

function hover(p, {name, measure}) {
  const interval = p.low === null || p.high === null ? "" : ` (95 %: ${p.low.toFixed(2)} to ${p.high.toFixed(2)})`;
  const [exposure, speed, ...setting] = run.axes.map(({texts}, along) => texts[p.at[along]]);
  return `${name} ${p.y.toFixed(3)}${interval}<br>exposure ${exposure}<br>`
    + `speed ${speed}, blur ${short(blurOf(p))} px<br>${setting.join(" · ")}<br>${p.n} ${measure === null ? "targets" : "pictures"}`;
}

// Failure points lie on curves over blur, with no speed of their own; windows on curves over exposure.
const onLines = (rows, model, {group, lines, fixed}) => standing(ofGroup(rows, model, group), fixed).map(p => ({...p, line: p.at[lines]}));

function failureTrace(model, now) {
  const here = onLines(run.failures, model, now).filter(f => f.x !== null && !hidden.has(f.line));
  const {texts, colours} = run.axes[now.lines];
  const end = ({x, low, high, last}) => high ?? (low === null ? x : last);
  const text = ({line, x, low, high, returned}) => `${texts[line]}: fails at ${short(x)} px`
    + (low === null ? "" : `<br>95 %: ${short(low)} px to ${high === null ? "beyond the range" : short(high) + " px"}`)
    + (returned ? "<br>non-monotonic: had been below and come back" : "");
  return {x: here.map(f => height(f.x)), y: here.map(() => run.threshold), text: here.map(text), mode: "markers",
    hovertemplate: "%{text}<extra></extra>", marker: {size: 11, color: here.map(f => colours[f.line]),
      symbol: here.map(f => f.returned ? "diamond-open" : "diamond"), line: {width: 1.5, color: here.map(f => f.returned ? colours[f.line] : "#fff")}},
    error_x: {type: "data", symmetric: false, array: here.map(f => height(end(f)) - height(f.x)), arrayminus: here.map(f => height(f.x) - height(f.low ?? f.x)),
      color: colour("soft"), thickness: 1, width: 3}};
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
  const {view, lines, measure} = now, rows = standing(rowsOf(panel.model, now), now.fixed), traces = [], shapes = [];
  const {texts, colours} = run.axes[lines], overExposure = view === views.exposure;
  const level = (y, dash) => ({type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: {color: colour("soft"), width: 1.2, dash}});
  if (measure === null) shapes.push(level(run.threshold, "dash"));
  const clean = cleanOf(panel.model, now);
  if (clean !== null && clean !== undefined) shapes.push(level(clean, "dot"));
  texts.forEach((name, index) => {
    const line = rows.filter(p => p.at[lines] === index).sort((a, b) => view.x(a) - view.x(b));
    if (!line.length || hidden.has(index)) return;
    const colour = colours[index], bounded = line.filter(p => p.low !== null && p.high !== null);
    if (overExposure && bounded.length > 1) traces.push({
      x: [...bounded.map(view.x), ...bounded.map(view.x).reverse()],
      y: [...bounded.map(p => p.low), ...bounded.map(p => p.high).reverse()],
      fill: "toself", fillcolor: colour + "26", line: {width: 0}, mode: "lines", hoverinfo: "skip"});
    if (view.joined) traces.push({...between(line, view), mode: "lines", line: {color: colour, width: 2}, hoverinfo: "skip"});
    traces.push({x: line.map(view.x), y: line.map(p => p.y), text: line.map(p => `${name}<br>${hover(p, now)}`),
      hovertemplate: "%{text}<extra></extra>", mode: "markers",
      marker: {color: colour, size: 6, opacity: run.predicted && view.joined ? 0 : 1},
      ...(overExposure || !bounded.length ? {} : {error_y: {type: "data", symmetric: false, thickness: 0.8, width: 0, color: colour + "88",
        array: line.map(p => (p.high ?? p.y) - p.y), arrayminus: line.map(p => p.y - (p.low ?? p.y))}})});
  });
  if (measure === null && view === views.blur) traces.push(failureTrace(panel.model, now));
  const step = 0.035, bars = measure === null && overExposure ? texts.length : 0, most = largest(now);
  if (bars) onLines(run.windows, panel.model, now).filter(({line}) => !hidden.has(line)).forEach(({line, low, high, sure, bounds}) => {
    const y = -0.05 - step * line, colour = colours[line];
    const bar = (from, to, half, opacity) => shapes.push({type: "rect", x0: 1e3 * from, x1: 1e3 * to, y0: y - half, y1: y + half,
      line: {width: 1, color: colour}, fillcolor: colour, opacity});
    bar(low, high, 0.011, sure ? 1 : 0.35);
    const [first, last] = [run.exposures_ms[0] / 1e3, run.exposures_ms[run.exposures_ms.length - 1] / 1e3];
    for (const [from, to] of bounds) if (from !== null || to !== null) bar(from ?? first, to ?? last, 0.002, 1);
  });
  const xaxis = {...axis, ...view.axis, range: view.range};
  const yaxis = {...axis, showline: false, title: {text: now.name}, range: [(-0.05 - step * bars) * most, 1.05 * most]};
  if (measure === null) yaxis.tickvals = [0, 0.2, 0.4, 0.6, 0.8, 1];
  Plotly.react(panel.curve, traces, {...common, xaxis, yaxis, shapes, margin: {l: 52, r: 12, t: 30, b: 44}}, config);
  panel.remark.textContent = remark(panel.model, now);
}

function remark(model, now) {
  if (now.measure !== null || now.view !== views.blur) return "";
  const back = onLines(run.failures, model, now).filter(f => f.returned).map(f => run.axes[now.lines].texts[f.line]);
  return back.length ? `Non-monotonic at ${back.join(", ")}: below the threshold, and back again.` : "";
}

function layLegend({lines}) {
  byId("legend").replaceChildren(...run.axes[lines].texts.map((name, index) => {
    const button = document.createElement("button"), chip = document.createElement("i");
    chip.style.background = run.axes[lines].colours[index];
    button.type = "button";
    button.setAttribute("aria-pressed", String(!hidden.has(index)));
    button.append(chip, name);
    button.addEventListener("click", () => { hidden.delete(index) || hidden.add(index); draw(); });
    return button;
  }));
}

// What the curves show, in words.
function readingOf({view, lines, measure, fixed}) {
  const confidence = measure === null, {word} = run.axes[lines], parts = [`One line per ${word}${heldText(fixed)}.`];
  if (view !== views.blur) parts.push(view.reading);
  else parts.push(view.reading + (lines === EXPOSURE
    ? "; from line to line the light per picture changes too, so two lines at the same blur differ by noise." : "."));
  parts.push("Dotted: the untouched pictures.", confidence ? "Dashed: the threshold." : "Of all targets together, without intervals.");
  if (confidence && view === views.exposure) parts.push(`Bars below zero are the exposure window at each ${word}, pale where the pictures cannot tell; thin: the intervals of its ends.`);
  if (confidence && view === views.blur)
    parts.push("Diamonds: where a curve falls below the threshold for good, with the 95 % interval; hollow: non-monotonic.");
  return parts.join(" ");
}
