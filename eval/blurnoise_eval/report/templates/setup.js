"use strict";
const byId = id => document.getElementById(id);
const run = JSON.parse(byId("numbers").textContent);
for (const name of ["points", "scores", "windows", "failures"]) {
  const {columns, rows} = run[name];
  run[name] = rows.map(row => Object.fromEntries(columns.map((column, place) => [column, row[place]])));
}
const models = [...document.querySelectorAll("#model option:not([value=all])")].map(option => option.textContent);
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const dark = matchMedia("(prefers-color-scheme: dark)").matches;
// Dark lines would not be seen on a dark page.
const lighter = hex => "#" + [1, 3, 5].map(at => Math.round(0.55 * parseInt(hex.slice(at, at + 2), 16) + 0.45 * 255).toString(16).padStart(2, "0")).join("");
if (dark) for (const each of run.axes ?? []) each.colours = each.colours?.map(lighter);
const touch = matchMedia("(pointer: coarse)").matches, narrow = matchMedia("(max-width: 640px)").matches;
// Only buttons that work offline: the library would otherwise offer to upload the chart.
const config = {responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]]};
const common = {font: {family: "system-ui, sans-serif", size: 13, color: colour("ink")}, paper_bgcolor: colour("paper"),
  plot_bgcolor: colour("paper"), hoverlabel: {align: "left"}, hovermode: "closest", showlegend: false,
  dragmode: touch ? false : "zoom"};
const axis = {gridcolor: colour("line"), zeroline: false, showline: true, linecolor: colour("soft"), automargin: true};
const short = (value, digits = 3) => String(Number(value.toPrecision(digits)));

function addPanel(parent, title, kind) {
  const figure = document.createElement("figure"), plot = document.createElement("div"), remark = document.createElement("p");
  if (title) figure.append(Object.assign(document.createElement("h3"), {textContent: title}));
  plot.className = `plot ${kind}`;
  remark.className = "note";
  figure.append(plot, remark);
  parent.append(figure);
  return {plot, remark};
}
