// One line per log and below them all together; several configurations side by side on a line.
draws.forest = (id, f) => {
  const L = layout(id, { hovermode: 'closest' }), rows = [...new Set(f.items.filter((d) => !off(d.r)).map((d) => d.r))], traces = [], to = f.log ? Math.log10 : (v) => v, from = f.log ? (v) => 10 ** v : (v) => v;
  const lines = f.lines.length, wide = (d) => [d.v, ...(d.ci || [])].filter((v) => v !== null && (!f.log || v > 0)).map(to), values = f.items.flatMap((d) => [to(d.v)]), zero = 0;
  const most = Math.max(f.log ? 0.02 : 1e-6, ...values.map(Math.abs)), ends = f.items.flatMap(wide).filter((v) => Math.abs(v) < 4 * most);
  const low = Math.min(zero, ...values, ...ends), high = Math.max(zero, ...values, ...ends), pad = 0.06 * (high - low), range = [low - pad, high + pad];
  for (const r of rows) {
    const own = f.items.filter((d) => d.r === r), at = (d) => lines - 1 - d.line + (rows.length > 1 ? 0.25 - (0.5 * rows.indexOf(r)) / (rows.length - 1) : 0);
    for (const all of [false, true]) {
      const some = own.filter((d) => d.all === all), inside = (v) => Math.min(Math.max(v, from(range[0])), from(range[1]));
      if (some.length) traces.push({
        type: 'scatter', mode: 'markers', meta: r, name: name(r) + (all ? ', all logs' : ''), x: some.map((d) => d.v), y: some.map(at),
        error_x: { type: 'data', symmetric: false, array: some.map((d) => (d.ci ? inside(d.ci[1]) - d.v : 0)), arrayminus: some.map((d) => (d.ci ? d.v - inside(d.ci[0]) : 0)), color: colour(r), thickness: all ? 3 : 1.6, width: all ? 6 : 3 },
        marker: { size: all ? 13 : 8, symbol: all ? 'diamond' : some.map((d) => (d.significant ? 'circle' : 'circle-open')), color: colour(r), line: { color: colour(r), width: 1.6 } },
        customdata: some.map((d) => safe(short(d.say, 160))), hovertemplate: '%{customdata}<extra></extra>',
      });
    }
  }
  const longest = Math.max(1, ...f.lines.map((t) => Math.min(t.length, 28)));
  L.margin.l = Math.min(24 + 6.6 * longest, width(id) * 0.42);
  L.xaxis = axis(safe(short(f.axis, 110)), { range, type: f.log ? 'log' : 'linear', zeroline: false });
  if (f.log) { const t = ratios(from(range[0]), from(range[1]), narrow(id) ? 5 : 9); L.xaxis.tickvals = t; L.xaxis.ticktext = t.map((v) => minus((v < 1 ? '-' : v > 1 ? '+' : '') + Math.round(Math.abs(v - 1) * 100) + ' %')); }
  L.yaxis = axis('', { tickvals: f.lines.map((_, i) => lines - 1 - i), ticktext: f.lines.map((t) => safe(short(t, 28))), range: [-0.6, lines - 0.4], fixedrange: true, zeroline: false });
  L.shapes.push({ type: 'line', xref: 'x', yref: 'paper', x0: f.log ? 1 : 0, x1: f.log ? 1 : 0, y0: 0, y1: 1, line: { color: css('--tx'), width: 1.3 } });
  if (f.all) L.shapes.push({ type: 'line', xref: 'paper', yref: 'y', x0: 0, x1: 1, y0: 0.5, y1: 0.5, line: { color: css('--bd'), width: 1 } });
  for (const [x, text, anchor] of [[0, '← nearer to perfect', 'left'], [1, 'farther →', 'right']]) L.annotations.push({ x, y: 1, xref: 'paper', yref: 'paper', xanchor: anchor, yanchor: 'bottom', text, showarrow: false, font: { size: 12, color: css('--mu') } });
  return { traces, layout: L };
};
const ratios = (low, high, most) => { const t = [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.1, 1.25, 1.5, 2, 3, 5, 10, 20].filter((v) => v >= low && v <= high); return t.length > most ? t.filter((v) => v === 1 || [0.1, 0.2, 0.5, 0.7, 1.5, 2, 5, 10].includes(v)) : t; };

// A figure that was drawn while folded has no width of its own yet.
document.querySelectorAll('details').forEach((d) => d.addEventListener('toggle', () => {
  if (d.open && !printing) d.querySelectorAll('.plot[data-ready]').forEach((p) => draw(p.id));
}));
