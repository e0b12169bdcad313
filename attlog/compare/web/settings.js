// Figures of settings: cells of two parameters, values along one, everything a search has tried.
const channels = (color) => (color.length < 7 ? [...color.slice(1)].map((c) => parseInt(c + c, 16)) : [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16)));
const mixed = (a, b, share) => { const [x, y] = [channels(a), channels(b)]; return '#' + x.map((v, i) => Math.round(v + (y[i] - v) * share).toString(16).padStart(2, '0')).join(''); };
// relative luminance of WCAG 2.2: of black and white one always stands out by 4.5 and more
const luminance = (color) => channels(color).reduce((sum, v, i) => sum + [0.2126, 0.7152, 0.0722][i] * (v <= 10 ? v / 3294.6 : ((v / 255 + 0.055) / 1.055) ** 2.4), 0);
const contrast = (a, b) => { const [x, y] = [luminance(a), luminance(b)]; return (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05); };
const readable = (fill) => (contrast('#000000', fill) > contrast('#ffffff', fill) ? '#000000' : '#ffffff');
const label = (d) => safe(short(d, 160));
const LETTER = 6.6, LABEL = 14, CELL = 40, CORNER = 8;
const longest = (texts) => Math.max(1, ...texts.map((t) => Math.min(t.length, LABEL)));
// labels of values that stand side by side: every second or third where all of them have no room
const thinned = (texts, room) => { const every = Math.max(1, Math.ceil(texts.length * (LETTER * longest(texts) + 10) / room)); return texts.map((t, i) => (i % every ? '' : safe(short(t, LABEL)))); };

draws.cells = (id, f) => {
  const L = layout(id, { hovermode: 'closest', barmode: 'overlay', bargap: 0, dragmode: false }), places = (n) => Array.from({ length: n }, (_, i) => i);
  L.margin.l = 40 + LETTER * longest(f.down);
  const wide = (L.width - L.margin.l - L.margin.r) / f.across.length, high = (L.height - L.margin.t - L.margin.b) / f.down.length, best = f.cells.filter((c) => c.best);
  const fills = f.cells.map((c) => (c.share === null ? css('--bg') : mixed(css('--pn'), css('--ac'), 0.04 + 0.96 * c.share)));
  const traces = [{
    type: 'bar', x: f.cells.map((c) => c.i), y: f.cells.map(() => 1), base: f.cells.map((c) => c.j - 0.5), width: 1, text: f.cells.map((c) => (wide < CELL ? '' : c.text)),
    textposition: 'inside', insidetextanchor: 'middle', textangle: 0, constraintext: 'none', textfont: { size: 12, color: fills.map(readable) },
    marker: { color: fills, line: { color: css('--bg'), width: 1 } }, customdata: f.cells.map((c) => label(c.say)), hovertemplate: '%{customdata}<extra></extra>',
  }];
  const near = f.cells.map((c, i) => [c, fills[i]]).filter(([c]) => c.near);
  traces.push({ type: 'scatter', mode: 'markers', x: near.map(([c]) => c.i - 0.5 + CORNER / wide), y: near.map(([c]) => c.j + 0.5 - CORNER / high), marker: { size: 5, color: near.map(([, fill]) => readable(fill)) }, hoverinfo: 'skip' });
  for (const c of best) L.shapes.push({ type: 'rect', x0: c.i - 0.5, x1: c.i + 0.5, y0: c.j - 0.5, y1: c.j + 0.5, line: { color: css('--bad'), width: 3 } });
  L.xaxis = axis(safe(f.x), { range: [-0.5, f.across.length - 0.5], tickangle: 0, tickvals: places(f.across.length), ticktext: thinned(f.across, wide * f.across.length), showgrid: false, zeroline: false, fixedrange: true });
  L.yaxis = axis(safe(f.y), { range: [-0.5, f.down.length - 0.5], tickvals: places(f.down.length), ticktext: f.down.map((t) => safe(short(t, LABEL))), showgrid: false, zeroline: false, fixedrange: true });
  return { traces, layout: L };
};

// dots of settings: red the best, filled what does not differ significantly from it
const dots = (f, x, y, best, filled, more) => Object.assign({
  type: 'scatter', mode: 'markers', x, y, cliponaxis: false, customdata: f.say.map(label), hovertemplate: '%{customdata}<extra></extra>',
  marker: { size: best.map((b) => (b ? 11 : 8)), symbol: filled.map((b) => (b ? 'circle' : 'circle-open')), color: best.map((b) => (b ? css('--bad') : css('--ac'))), line: { width: 1.6 } },
}, more || {});

draws.along = (id, f) => {
  const L = layout(id, { hovermode: 'closest' }), own = { hoverinfo: 'skip', say: undefined }, known = [f.y, ...f.logs.map((l) => l.y)].flat().filter((v) => v !== null);
  const traces = f.logs.map((l) => plain(name_of(l.name), faded(css('--mu'), 0.5), f.x, l.y, { line: { color: faded(css('--mu'), 0.5), width: 1 }, hoverinfo: 'none', hovertemplate: label(l.name) + ': %{y:.4~g}<extra></extra>', say: undefined }));
  traces.push(plain(f.logs.length ? 'mean over the logs' : '', css('--ac'), f.x, f.y, Object.assign({ line: { color: css('--ac'), width: 2.5 } }, own)));
  traces.push(dots(f, f.x, f.y, f.x.map((_, i) => i === f.best), f.near));
  const top = Math.max(...known), low = Math.min(...known), from = low < 0.5 * top ? 0 : low - 0.2 * (top - low), to = f.log ? Math.log10 : (v) => v;
  const at = f.x.map(to), pad = 0.06 * (Math.max(...at) - Math.min(...at)) || 0.5;
  L.xaxis = axis(safe(f.axis), { type: f.log ? 'log' : 'linear', range: [Math.min(...at) - pad, Math.max(...at) + pad], tickangle: 0, tickvals: f.x, ticktext: thinned(f.ticks, L.width - L.margin.l - L.margin.r), zeroline: false });
  L.yaxis = axis(safe(f.title), { range: [from, (top + 0.06 * (top - from)) || 1], nticks: 6, zeroline: false });
  // settings that are not significantly worse, half of the way to their neighbours
  const order = at.map((_, i) => i).sort((a, b) => at[a] - at[b]), back = f.log ? (v) => 10 ** v : (v) => v;
  const edge = (k) => back(k < 0 ? at[order[0]] - pad : k + 1 === order.length ? at[order[k]] + pad : (at[order[k]] + at[order[k + 1]]) / 2);
  order.forEach((i, k) => {
    if (!f.near[i] || f.near[order[k - 1]]) return;
    let last = k;
    while (f.near[order[last + 1]]) last += 1;
    L.shapes.push(band(edge(k - 1), edge(last), css('--good')));
  });
  return { traces, layout: L };
};
const name_of = (text) => safe(short(text, 40));

draws.tried = (id, f) => {
  const L = layout(id, { hovermode: 'closest' }), low = Math.min(...f.y), edge = 0.05 * (f.top - low), inside = (v) => Math.min(v, f.top), order = f.x.map((_, i) => i).sort((a, b) => f.y[b] - f.y[a]), pick = (a) => order.map((i) => a[i]);
  const shown = { say: pick(f.say) }, best = pick(f.best), over = pick(f.y).map((v) => v > f.top), to = f.log ? Math.log10 : (v) => v, ends = f.range.map(to), pad = 0.03 * (ends[1] - ends[0]);
  const t = dots(shown, pick(f.x), pick(f.y).map(inside), best, best);
  t.marker.symbol = best.map((b, i) => (over[i] ? 'triangle-up-open' : b ? 'circle' : 'circle-open'));
  t.marker.size = best.map((b) => (b ? 11 : 7));
  L.xaxis = axis(safe(f.axis), Object.assign({ type: f.log ? 'log' : 'linear', range: [ends[0] - pad, ends[1] + pad], zeroline: false }, f.log ? decades(f.range, narrow(id) ? 4 : 8) : { nticks: 7 }));
  L.yaxis = axis(safe(f.title), { range: [low - edge, f.top + edge], nticks: 6 });
  L.shapes.push(band(f.band[0], f.band[1], css('--good')));
  return { traces: [t], layout: L };
};

// every table can be saved
document.querySelectorAll('button.csv').forEach((button) => {
  button.hidden = false;
  button.onclick = () => {
    const rows = [...document.getElementById(button.dataset.table).rows].map((row) => [...row.cells].map((cell) => spreadsheetCell(cell.textContent)).join(','));
    save(new Blob([rows.join('\n') + '\n'], { type: 'text/csv' }), button.dataset.name + '.csv');
  };
});
