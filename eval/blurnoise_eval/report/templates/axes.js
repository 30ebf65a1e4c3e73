// A row p has a place on every axis of the run: p.at = [exposure, velocity, light, ...]. What can be drawn against
// (a view) goes along one of them; the other axes stand where their selects say, but for that of the lines.
const EXPOSURE = 0, VELOCITY = 1;
const speedOf = p => run.speeds_px_s[p.at[VELOCITY]];
const blurOf = p => speedOf(p) * run.exposures_ms[p.at[EXPOSURE]] / 1e3;
const height = blur => blur < 1 ? blur : 1 + Math.log10(blur);  // blur is drawn linear below 1 px, logarithmic above
const blurTicks = [0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
const blurAxis = {tickvals: blurTicks.map(height), ticktext: blurTicks.map(String), title: {text: "Motion blur / px"}};
const titled = along => ({title: {text: run.axes[along].title}});
const spread = (values, most) => values.filter((_, i) => i % Math.ceil(values.length / most) === 0);

// along: the axis; x: where a point stands, in the units of the axis; range: of x, logarithms where the axis has them.
const views = {
  exposure: {along: EXPOSURE, x: p => run.exposures_ms[p.at[EXPOSURE]], joined: true,
    axis: {...titled(EXPOSURE), type: "log", dtick: "D2", tickformat: "~g"},
    range: ends(run.exposures_ms.map(Math.log10), 0.07),
    reading: "Along a line the exposure grows: light, noise and blur all change together."},
  blur: {along: VELOCITY, x: p => height(blurOf(p)), joined: run.joined, axis: blurAxis, range: fromZero(p => height(blurOf(p))),
    reading: "Along a line only the speed changes"},
  speed: {along: VELOCITY, x: speedOf, joined: run.joined, axis: titled(VELOCITY), range: fromZero(speedOf),
    reading: "Along a line the light is the same; only the speed, and with it the blur, changes."},
};
run.axes.forEach(({word, values, logarithmic, named, texts}, along) => {
  if (along > VELOCITY && values.length > 1) views[word] = {along, x: p => values[p.at[along]], joined: true,
    axis: {...titled(along), type: logarithmic ? "log" : "linear", tickvals: spread(values, 10), ticktext: named ? texts : spread(values, 10).map(value => short(value, 6))},
    range: logarithmic ? ends(values.map(Math.log10)) : ends(values),
    reading: `Along a line only the ${word} changes.`};
});

function ends(values, room = 0.05 * (Math.max(...values) - Math.min(...values))) {
  return [Math.min(...values) - room, Math.max(...values) + room];
}

function fromZero(x) {
  const most = Math.max(...run.speeds_px_s.flatMap((_, velocity) => run.exposures_ms.map((_, exposure) => x({at: [exposure, velocity]}))));
  return [-0.03 * most, 1.03 * most];
}

const several = along => run.axes[along].texts.length > 1;
const selectOf = along => document.querySelector(`[data-axis="${along}"]`);
const stands = along => Number(selectOf(along)?.value ?? 0);

// The axes that a chart does not use, which must stand somewhere, and the rows that stand there.
const fixedBut = used => run.axes.map((_, along) => along).filter(along => !used.includes(along));
const standing = (rows, fixed) => rows.filter(p => fixed.every(along => p.at[along] === stands(along)));

// What lines can be drawn over a view: of every axis but its own; exposures first, over exposure the speeds.
function linesOver(view) {
  const usual = view.along === EXPOSURE ? VELOCITY : EXPOSURE;
  const others = run.axes.map((_, along) => along).filter(along => several(along) && along !== usual && along !== view.along);
  return [usual, ...others];
}

// Exposure and speed are said where they are held: their selects are not always there. Light and others always are.
function heldText(fixed) {
  const held = fixed.filter(along => along <= VELOCITY && several(along)).map(along => run.axes[along].texts[stands(along)]);
  return held.length ? `, at ${held.join(" and ")}` : "";
}
