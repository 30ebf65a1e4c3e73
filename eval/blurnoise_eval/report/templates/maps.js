// A map's axis is a row of tested values, or blur, which is no grid: a tile around each tested blur.
const speeds = [...new Set(run.speeds_px_s)].sort((a, b) => a - b);

function scaleOf(name) {
  const view = views[name];
  if (name === "blur") return {key: p => blurOf(p).toPrecision(9), axis: blurAxis};
  const place = name === "speed" ? p => speeds.indexOf(speedOf(p)) : p => p.at[view.along];
  const {texts, unit, values} = run.axes[view.along];
  const labels = name === "speed" ? speeds.map(speed => short(speed, 6))
    : values ? values.map(value => short(value, 6)) : texts.map(text => text.replace(` ${unit}`, ""));
  const shown = spread(labels.map((_, index) => index), narrow ? 8 : 16);
  return {key: place, place, count: labels.length, range: [-0.5, labels.length - 0.5],
    axis: {...titled(view.along), tickvals: shown, ticktext: shown.map(index => labels[index])}};
}

function grouped(rows, key) {
  const found = new Map();
  for (const p of rows) found.set(key(p), [...(found.get(key(p)) ?? []), p]);
  return [...found.values()];
}

// From where to where each of the tiles reaches on this scale; they share their place on the other one.
function extents(scale, tiles) {
  if (scale.place) return tiles.map(([p]) => [scale.place(p) - 0.47, scale.place(p) + 0.47]);
  const at = tiles.map(([p]) => height(blurOf(p))), order = at.map((_, i) => i).sort((a, b) => at[a] - at[b]), found = [];
  order.forEach((i, rank) => {
    const down = rank ? (at[i] - at[order[rank - 1]]) / 2 : 0, up = rank + 1 < order.length ? (at[order[rank + 1]] - at[i]) / 2 : 0;
    const below = rank ? down : Math.min(up || 0.25, 0.25), above = rank + 1 < order.length ? up : Math.min(down || 0.25, 0.25);
    found[i] = [at[i] - below, at[i] + above];
  });
  return found;
}

function tilesOf(rows, across, up) {
  const tiles = grouped(rows, p => `${across.key(p)}|${up.key(p)}`), found = [];
  for (const column of grouped(tiles, ([p]) => across.place ? across.key(p) : up.key(p))) {
    const wide = extents(across, column), tall = extents(up, column);
    column.forEach((same, i) => found.push({wide: wide[i], tall: tall[i], p: same[0], several: same.length,
      value: same.reduce((sum, p) => sum + p.y, 0) / same.length}));
  }
  return found;
}

const mapUses = (across, up) => [views[across].along, views[up].along,
  ...([across, up].includes("blur") && [across, up].includes("speed") ? [EXPOSURE] : [])];

function drawMap(panel, now) {
  const across = scaleOf(now.across), up = scaleOf(now.up), most = largest(now);
  const found = tilesOf(standing(rowsOf(panel.model, now), now.mapFixed), across, up);
  const t = Math.min(Math.max(run.threshold / run.highest, 0.01), 0.99);
  const colorscale = now.measure === null ? [[0, "#8c4a0b"], [t - 0.001, "#fbeedd"], [t, "#d5e5f1"], [1, "#1f5f99"]]
    : run.measures[now.measure].more ? [[0, "#f1f5f9"], [1, "#1f5f99"]] : [[0, "#faf5ee"], [1, "#8c4a0b"]];
  const xRange = across.range ?? ends(found.flatMap(tile => tile.wide), 0), yRange = up.range ?? ends(found.flatMap(tile => tile.tall), 0);
  const small = narrow || panels.length > 2;
  const px = (extent, range, room) => room * (extent[1] - extent[0]) / (range[1] - range[0]);
  const fits = tile => px(tile.tall, yRange, panel.map.clientHeight - 76) > (small ? 11 : 13)
    && px(tile.wide, xRange, panel.map.clientWidth - 64) > 26;
  const text = tile => (tile.several > 1 ? `mean of ${tile.several} conditions: ${tile.value.toFixed(3)}<br>` : "") + hover(tile.p, now);
  Plotly.react(panel.map, [{type: "bar", x: found.map(({wide}) => (wide[0] + wide[1]) / 2), width: found.map(({wide}) => wide[1] - wide[0]),
    base: found.map(({tall}) => tall[0]), y: found.map(({tall}) => tall[1] - tall[0]),
    text: found.map(tile => fits(tile) ? tile.value.toFixed(2) + (untold(tile, now) ? "?" : "") : ""), customdata: found.map(text),
    texttemplate: "%{text}", hovertemplate: "%{customdata}<extra></extra>", textposition: "inside", insidetextanchor: "middle",
    textangle: 0, constraintext: "none", insidetextfont: {size: small ? 10 : 12},
    marker: {color: found.map(tile => tile.value), colorscale, cmin: 0, cmax: most, line: {color: "#fff", width: found.length > 60 ? 0.4 : 1.5}}}], {
    ...common, barmode: "overlay",
    xaxis: {...axis, ...across.axis, range: xRange, showgrid: false}, yaxis: {...axis, ...up.axis, range: yRange, showgrid: false},
    margin: {l: 52, r: 12, t: 30, b: 46}}, config);
}

// Whether the interval of a tile holds the threshold, or there is none.
const untold = ({p, several}, {measure}) =>
  measure === null && several === 1 && (p.low === null || p.high === null || p.low < run.threshold && p.high >= run.threshold);

// What the maps show, in words.
function coloursOf({across, up, measure, name, mapFixed}) {
  const tiles = across === "blur" || up === "blur"
    ? `a ${across === "blur" ? "row" : "column"} per ${across === "blur" ? up : across}, a tile around each tested blur`
    : `a column per ${across}, a row per ${up}`;
  return `${name}, for the choice above: ${tiles}${heldText(mapFixed)}. ` + (measure === null
    ? `Blue: at or above the threshold ${run.threshold}; brown: below; “?”: its 95 % interval holds the threshold, or there is none.` : run.measures[measure].more ? "Darker is better." : "Darker is worse.");
}
