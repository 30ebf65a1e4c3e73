"use strict";
// Every condition has its places on the axes, exposure first; the original pictures have none. A model's codes hold, by condition
// and target, twice the confidence in thousandths, and 1 more where the target is found.
const NONE = 0xFFFF, AT_ONCE = 48;
const byId = id => document.getElementById(id);
const run = JSON.parse(byId("failures").textContent);
const {axes, conditions, pictures, crops} = run;
const models = run.models.map(model => ({...model, codes: new Uint16Array(Uint8Array.from(atob(model.codes), letter => letter.charCodeAt(0)).buffer)}));
const value = id => Number(byId(id)?.value ?? 0);
const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};
const fill = (select, options, chosen) => {
  select.replaceChildren(...options.map(([text, value]) => element("option", {textContent: text, value, selected: text === chosen})));
};
const exposureText = condition => conditions[condition] ? axes[0][conditions[condition][0]] : "original picture";
const codeAt = (target, condition) => models[value("model")].codes[condition * models[value("model")].targets.length + target];
const confidence = code => (code >> 1) / 1000;

// The exposures of the light, speed and what else is chosen; those that were compared stay where they can.
function layExposures() {
  const held = axes.map((_, axis) => axis && value(`axis-${axis}`));
  const here = conditions.flatMap((at, place) => !at || at.every((of, axis) => !axis || of === held[axis]) ? [[exposureText(place), place]] : []);
  for (const id of ["a", "b"]) {
    const before = byId(id).selectedOptions[0]?.textContent;
    fill(byId(id), here, here.some(([text]) => text === before) ? before : here.at(id === "a" ? 1 : -1)?.[0]);
  }
}

function layModel() {
  const {labels, groups} = models[value("model")];
  for (const [id, names] of [["label", labels], ["group", groups]]) {
    fill(byId(id), [["all", -1], ...names.map((name, place) => [name, place])], byId(id).selectedOptions[0]?.textContent);
  }
}

// Places of targets by what was found, the greatest change first: at A alone, at B alone, at both, at neither.
function compared() {
  const {targets} = models[value("model")], [a, b, label, group, size] = ["a", "b", "label", "group", "size"].map(value);
  const part = byId("name").value.trim().toLowerCase(), kinds = [[], [], [], []], changes = new Map();
  targets.forEach(([picture, ofGroup, ofLabel, x0, y0, x1, y1], target) => {
    const [first, second] = [codeAt(target, a), codeAt(target, b)], side = Math.sqrt((x1 - x0) * (y1 - y0));
    if (first === NONE || second === NONE || label >= 0 && ofLabel !== label || group >= 0 && ofGroup !== group) return;
    if (size && size !== (side < 32 ? 1 : side < 96 ? 2 : 3) || part && !pictures[picture][0].toLowerCase().includes(part)) return;
    kinds[first & 1 ? (second & 1 ? 2 : 0) : (second & 1 ? 1 : 3)].push(target);
    changes.set(target, Math.abs(first - second));
  });
  for (const kind of kinds) kind.sort((one, other) => changes.get(other) - changes.get(one));
  return kinds;
}

// A picture with a box on it, in % of its sides.
function shot(jpeg, [left, top, width, height], kind, text, ratio) {
  const picture = jpeg ? element("img", {src: `data:image/jpeg;base64,${jpeg}`, alt: text, loading: "lazy"})
    : element("div", {className: "missing", textContent: "no picture"});
  const box = element("i", {className: kind});
  Object.assign(box.style, {left: `${left}%`, top: `${top}%`, width: `${width}%`, height: `${height}%`});
  const frame = element("div", {className: "shot"}, picture, box);
  frame.style.aspectRatio = ratio ?? "auto";
  return element("figure", {}, frame, element("figcaption", {textContent: text}));
}

function card(target) {
  const model = value("model"), [a, b] = [value("a"), value("b")], {targets, labels, groups} = models[model];
  const [picture, group, label, x0, y0, x1, y1] = targets[target], [name, width, height, jpeg] = pictures[picture];
  const place = [100 * x0 / width, 100 * y0 / height, 100 * (x1 - x0) / width, 100 * (y1 - y0) / height];
  const at = (letter, condition) => {
    const code = codeAt(target, condition), crop = crops[`${model}:${target}:${condition}`];
    const text = `${letter}, ${exposureText(condition)}: ${confidence(code).toFixed(2)}`, kind = code & 1 ? "found" : "missed";
    return {text, kind, figure: crop && shot(crop[0], crop.slice(1), kind, text)};
  };
  const found = [at("A", a), at("B", b)], drawn = found.filter(each => each.figure);
  const said = element("p", {}, element("strong", {textContent: labels[label]}), ` ${Math.round(x1 - x0)} × ${Math.round(y1 - y0)} px, ${groups[group]}`);
  for (const {text, kind} of drawn.length === 2 ? [] : found) said.append(element("br"), element("span", {className: `key ${kind}`}), text);
  const pair = drawn.length === 2 ? [element("div", {className: "pair"}, ...drawn.map(each => each.figure))] : [];
  return element("article", {}, ...pair, shot(jpeg, place, "other", name, `${width} / ${height}`), said);
}

let shown = [];
function more() {
  const from = byId("targets").childElementCount;
  byId("targets").append(...shown.slice(from, from + AT_ONCE).map(card));
  byId("more").hidden = byId("targets").childElementCount >= shown.length;
}

function draw() {
  const kinds = compared(), names = ["found at A, missed at B", "missed at A, found at B", "found at both", "missed at both"];
  names.forEach((name, kind) => { byId("kind").options[kind].textContent = `${name} (${kinds[kind].length})`; });
  const total = kinds.reduce((sum, kind) => sum + kind.length, 0), chosen = value("kind");
  byId("counts").textContent = `${kinds[chosen].length} of ${total} targets are ${names[chosen]} (A: ${exposureText(value("a"))}, B: ${exposureText(value("b"))}).`;
  shown = kinds[chosen];
  byId("targets").replaceChildren();
  more();
}

function open() {
  const [model, a, b] = run.opening ?? [0, 0, 0];
  byId("model").value = model;
  conditions[a]?.forEach((place, axis) => { if (axis) byId(`axis-${axis}`).value = place; });
  layModel();
  layExposures();
  byId("a").value = a;
  byId("b").value = b;
  for (const select of document.querySelectorAll("select")) select.addEventListener("change", () => {
    if (select.id === "model") layModel();
    if (select.id.startsWith("axis")) layExposures();
    draw();
  });
  byId("name").addEventListener("input", draw);
  byId("more").addEventListener("click", more);
  draw();
}
open();
