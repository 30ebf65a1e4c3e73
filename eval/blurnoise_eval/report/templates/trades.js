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
