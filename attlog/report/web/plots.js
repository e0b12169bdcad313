// What all figures share: layout, axes, shaded phases, lines.
// printed whole, or two beside each other on a page that sums up
const summed = () => printing && root.dataset.print !== 'all' && document.querySelector('.summary');
const width = (id) => (printing ? (summed() ? PRINT_WIDTH / 2 - 8 : PRINT_WIDTH) : Math.max(260, $(id).clientWidth));
const narrow = (id) => width(id) < 520;
const tall = (id) => Math.round(+$(id).dataset.height * (summed() ? 0.44 : printing ? 0.55 : 1));
// rows that the legend hides, and of a figure with a focus all others
const hidden = new Set();
let focus = null;
const off = (r) => hidden.has(r) || (focus !== null && !focus.includes(r));
const CONFIG = { responsive: false, displaylogo: false, displayModeBar: false, doubleClick: false, scrollZoom: false };

function axis(title, more) {
  const muted = css('--mu'), border = css('--bd');
  return Object.assign({
    title: { text: title, font: { size: 12, color: muted }, standoff: 6 }, gridcolor: border, zerolinecolor: muted,
    zerolinewidth: 1, linecolor: border, tickfont: { size: 12, color: muted }, automargin: false, exponentformat: 'none',
    ticklabeloverflow: 'allow', // else plotly measures every label
  }, more || {});
}

function layout(id, more) {
  const text = css('--tx'), small = narrow(id);
  return Object.assign({
    width: width(id), height: tall(id), paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
    font: { family: 'system-ui,-apple-system,Segoe UI,Roboto,Arial,sans-serif', size: 12, color: text }, showlegend: false,
    margin: { l: small ? 50 : 64, r: small ? 8 : 14, t: 22, b: 40 }, hovermode: 'x',
    hoverlabel: { bgcolor: css('--bg'), bordercolor: css('--bd'), font: { size: 12, color: text }, namelength: 40 },
    dragmode: small ? false : 'zoom', shapes: [], annotations: [],
  }, more || {});
}

const band = (a, b, fill) => ({ type: 'rect', xref: 'x', yref: 'paper', x0: a, x1: b, y0: 0, y1: 1, fillcolor: fill, line: { width: 0 }, layer: 'below' });
const bar = (x, color, dash) => ({ type: 'line', xref: 'x', yref: 'paper', x0: x, x1: x, y0: 0, y1: 1, line: { color, width: 1.2, dash }, layer: 'below' });
const note = (x, text, more) => Object.assign({ x, y: 1, xref: 'x', yref: 'paper', yanchor: 'bottom', text, showarrow: false, font: { size: 12, color: css('--mu') } }, more || {});
const MANY_MARKS = 80;
// too many to be seen singly are not drawn until the figure is zoomed
const few = (marks, range) => { const here = marks.filter((m) => (m.length > 2 ? m[1] : m[0]) >= range[0] && m[0] <= range[1]); return here.length > MANY_MARKS ? [] : here; };

// rest, airborne, impact, gaps and resets behind a figure with flight time
function phases(L, named) {
  const M = D.marks, range = L.xaxis.range, seen = (a, b) => b >= range[0] && a <= range[1];
  for (const [a, b] of M.airborne) L.shapes.push(band(a, b, css('--arm')));
  for (const [a, b] of few(M.rest, range)) L.shapes.push(band(a, b, css('--rest')));
  for (const [a, b] of M.impact) L.shapes.push(band(a, Math.max(b, a), css('--crash')), bar(a, css('--bad'), 'solid'));
  for (const [a, b] of few(M.gaps, range)) L.shapes.push(band(a, b, css('--gap')), bar(a, css('--edge'), 'solid'), bar(b, css('--edge'), 'solid'));
  for (const [t] of few(M.resets, range)) L.shapes.push(bar(t, css('--bad'), 'dot'));
  if (!named) return;
  const share = (a, b) => (Math.min(b, range[1]) - Math.max(a, range[0])) / (range[1] - range[0]);
  const label = (spans, text, least) => {
    for (const [a, b] of spans) {
      const middle = (Math.max(a, range[0]) + Math.min(b, range[1])) / 2, crowded = M.impact.some(([t]) => Math.abs(t - middle) < 1.3 * 50 / L.width * (range[1] - range[0]));
      if (seen(a, b) && share(a, b) > least && !crowded) L.annotations.push(note(middle, text));
    }
  };
  const least = 50 / L.width;
  label(M.rest, 'rest', least);
  label(M.airborne, 'in the air', 1.6 * least);
  for (const [a] of M.impact) if (seen(a, a)) L.annotations.push(note(a, 'impact', { font: { size: 12, color: css('--bad') } }));
}

const line = (r, w) => ({ color: colour(r), width: w || (D.rows[r].onboard ? 2.2 : 1.5), dash: D.rows[r].dash });
const trace = (r, x, y, more) => Object.assign({
  type: 'scatter', mode: 'lines', x, y, meta: r, name: name(r), line: line(r), hoverinfo: 'none', say: '°', digits: 2, at: ' s', visible: !off(r),
}, more || {});
const plain = (text, color, x, y, more) => Object.assign({
  type: 'scatter', mode: 'lines', x, y, meta: null, name: text, line: { color, width: 1.3 }, hoverinfo: 'none', say: '', digits: 2, at: ' s',
}, more || {});
const faded = (color, share) => 'rgba(' + [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16)).join(',') + ',' + share + ')';
const SPARSE_S = 1.5;

// the gyro alone below all, then onboard and reference, then the filters
const depth = (r) => (D.rows[r].slot === 9 ? 0 : D.rows[r].onboard ? 1 : 2);
const ordered = (series) => series.slice().sort((a, b) => depth(a.r) - depth(b.r));

// stacked panels that share the time axis
function panels(id, f, columns, options) {
  const range = options.range, traces = [], L = layout(id, options.layout);
  const gap = 0.035, height = (1 - gap * (columns.length - 1)) / columns.length;
  for (const s of ordered(f.series)) columns.forEach(([key, , opt], i) => {
    if (!s.y[key] || (focus && off(s.r))) return;
    let y = values(s.y[key]);
    if (opt && opt.map) y = y.map(opt.map);
    const own = Object.assign({ yaxis: i ? 'y' + (i + 1) : 'y' }, options.trace);
    // more than 1.5 s in a pixel: nobody can see steps, lines would be a carpet
    if ((range[1] - range[0]) / width(id) > SPARSE_S) {
      const e = enveloped(times(s.t), y, range, width(id), opt && opt.wraps);
      traces.push(trace(s.r, e.bandX, e.bandY, Object.assign({}, own, { fill: 'toself', fillcolor: faded(colour(s.r), 0.08), line: { color: colour(s.r), width: 0 }, hoverinfo: 'skip', say: undefined })));
      traces.push(trace(s.r, e.X, e.Y, Object.assign({}, own, { line: line(s.r, 1.1) })));
      return;
    }
    const [X, Y] = reduced(times(s.t), y, range, width(id), opt && opt.wraps);
    traces.push(trace(s.r, X, Y, own));
  });
  const last = columns.length > 1 ? 'y' + columns.length : 'y';
  L.xaxis = axis(options.time || 'time, s', { range: range.slice(), anchor: last, hoverformat: '.2f', showspikes: true, spikemode: 'across', spikethickness: 1, spikecolor: css('--mu'), spikedash: 'dot' });
  columns.forEach(([, title, opt], i) => {
    const top = 1 - i * (height + gap), own = 'y' + (i || '' ? i + 1 : '');
    L['yaxis' + (i ? i + 1 : '')] = axis(title, Object.assign({ domain: [Math.max(top - height, 0), top], nticks: 5, range: fitted(traces, i ? own : 'y', opt && opt.least || 0.2, options.calm, options.from, options.to), zeroline: !(opt && opt.map) }, opt && opt.axis));
  });
  if (options.phases) phases(L, options.phases === 'named');
  return leaving({ traces, layout: L });
}

// the lines' names in their colours, where few are drawn: above a figure with flight time, else at their ends
const LABELLED = 4;
const STROKES = { solid: '— ', dash: '– – ', dot: '··· ' };
function named(traces) {
  const found = new Map();
  for (const t of traces) if (t.mode === 'lines' && t.visible !== false && t.line.width && t.name && !found.has(t.name)) found.set(t.name, t);
  return found.size && found.size <= LABELLED ? [...found.values()] : [];
}

function headed(id, p) {
  const lines = named(p.traces), texts = lines.map((t) => (STROKES[t.line.dash || 'solid'] || '') + t.name);
  if (!lines.length || texts.reduce((sum, t) => sum + 12 * (0.56 * t.length + 1.2), 0) > width(id) - p.layout.margin.l) return p;
  p.layout.margin.t += 14;
  p.layout.annotations.push(...letters(id, texts, lines.map((t) => t.line.color)).map((a) => Object.assign(a, { yshift: 15 })));
  return p;
}

function ended(id, p) {
  const L = p.layout, log = L.yaxis.type === 'log', to = log ? Math.log10 : (v) => v, lines = named(p.traces.filter((t) => (t.yaxis || 'y') === 'y'));
  if (!lines.length || narrow(id)) return p;
  const all = lines.flatMap((t) => t.y.filter((v) => v !== null && (!log || v > 0)).map(to)), [low, high] = L.yaxis.range || [Math.min(...all), Math.max(...all)];
  const share = L.yaxis.domain ? L.yaxis.domain[1] - L.yaxis.domain[0] : 1, step = 14 * (high - low) / ((L.height - L.margin.t - L.margin.b) * share);
  const ends = lines.map((t) => { const i = t.y.findLastIndex((v) => v !== null); return { t, y: Math.min(Math.max(to(t.y[i]), low), high) }; }).sort((a, b) => a.y - b.y);
  ends.forEach((e, i) => { if (i) e.y = Math.max(e.y, ends[i - 1].y + step); });
  const over = Math.max(0, ends[ends.length - 1].y - high);
  L.margin.r += 8 + 6.6 * Math.max(...lines.map((t) => Math.min(t.name.length, 22)));
  for (const { t, y } of ends) L.annotations.push({ x: 1, xref: 'paper', xanchor: 'left', y: y - over, yref: 'y', yanchor: 'middle', text: ' ' + short(t.name, 22), showarrow: false, font: { size: 12, color: t.line.color } });
  return p;
}

const MOSTLY = 0.05;
// an arrow at the edge where a line leaves the figure
function leaving(p) {
  const found = [], within = p.layout.xaxis.range;
  for (const t of p.traces) {
    const key = t.yaxis || 'y', ax = p.layout['yaxis' + key.slice(1)];
    if (t.meta == null || t.fill || t.mode !== 'lines' || !ax || !ax.range || ax.type === 'log') continue;
    for (const [edge, beyond, symbol] of [[ax.range[1], (v) => v > ax.range[1], 'triangle-up'], [ax.range[0], (v) => v < ax.range[0], 'triangle-down']]) {
      const inside = (v, k) => v !== null && beyond(v) && (!within || (t.x[k] >= within[0] && t.x[k] <= within[1])), i = t.y.findIndex(inside);
      if (t.y.filter(inside).length > MOSTLY * t.y.length) t.opacity = 0.35;
      if (i >= 0) found.push({
        type: 'scatter', mode: 'markers', x: [t.x[i]], y: [edge], yaxis: key, meta: t.meta, name: t.name, visible: t.visible, cliponaxis: false, arrow: true, hoverinfo: 'skip',
        marker: { symbol, size: 11, color: colour(t.meta), line: { color: css('--bg'), width: 1 } },
      });
    }
  }
  p.traces.push(...found);
  return p;
}

// one line per row: a value with its interval, filled at rest, hollow in the air
function dotted(id, all, title, unit) {
  const dots = all.filter((d) => !off(d.r)), rows = [...new Set(dots.map((d) => d.r))], L = layout(id, { hovermode: 'closest' }), traces = [];
  const place = (r) => rows.length - 1 - rows.indexOf(r), ends = spanOf(dots);
  const count = new Map();
  for (const d of dots.filter((d) => d.v !== null)) {
    const i = count.get(d.r) || 0, n = dots.filter((o) => o.r === d.r).length;
    count.set(d.r, i + 1);
    const y = place(d.r) + (n > 1 ? 0.28 - (0.56 * i) / (n - 1) : 0), full = !d.where || d.where === 'at rest' || d.where === 'against truth';
    const out = d.v < ends[0] ? -1 : d.v > ends[1] ? 1 : 0;
    traces.push({
      type: 'scatter', mode: 'markers', x: [out < 0 ? ends[0] : out ? ends[1] : d.v], y: [y], meta: d.r, visible: !off(d.r), name: name(d.r), cliponaxis: !out,
      error_x: out ? undefined : d.ci ? { type: 'data', symmetric: false, array: [d.ci[1] - d.v], arrayminus: [d.v - d.ci[0]], color: colour(d.r), thickness: 2, width: 4 } : undefined,
      marker: { size: 9, symbol: out ? (out < 0 ? 'triangle-left' : 'triangle-right') : SYMBOLS[d.where] || 'circle', color: full && d.ok !== false ? colour(d.r) : css('--bg'), line: { color: colour(d.r), width: 2 } },
      hovertemplate: name(d.r) + (d.where ? ', ' + safe(short(d.where, 110)) : '') + ': ' + minus(d.v.toFixed(2)) + unit + (d.ci ? ' [' + minus(d.ci[0].toFixed(2)) + ' to ' + minus(d.ci[1].toFixed(2)) + ']' : '') + '<extra></extra>',
    });
  }
  const longest = Math.max(1, ...rows.map((r) => Math.min(D.rows[r].name.length, 22)));
  L.margin.l = Math.min(24 + 6.6 * longest, width(id) * 0.42);
  L.xaxis = axis(title, { zerolinewidth: 2, range: ends });
  L.yaxis = axis('', { tickvals: rows.map((r) => place(r)), ticktext: rows.map((r) => short(name(r), 22)), range: [-0.6, rows.length - 0.4], fixedrange: true, zeroline: false });
  return { traces, layout: L, place };
}

// fitted to what is ranked, else to the middle: values far beyond it and intervals far wider run out of the figure
function spanOf(dots) {
  const values = (some) => some.flatMap((d) => [...(d.v === null ? [] : [d.v]), ...(d.single || [])]);
  const sound = dots.filter((d) => d.ok !== false && !D.rows[d.r].lost), best = sound.length ? sound : dots;
  const core = best.filter((d) => d.v !== null).map((d) => Math.abs(d.v)).sort((a, b) => a - b);
  const most = Math.max(1e-3, sound.length ? core[core.length - 1] || 0 : core[core.length >> 1] || 0);
  const near = (v) => Math.abs(v) < 4 * most, all = [...values(best).filter(near), ...values(dots).filter(near), ...best.flatMap((d) => d.ci || []).filter(near)];
  const low = Math.min(0, ...all), high = Math.max(0, ...all), pad = (high - low) * 0.08 || 1;
  return [low - pad, high + pad];
}

// 1, 2, 5 of every decade as ticks of a log axis
function decades(all, most) {
  const good = all.filter((v) => v > 0);
  if (!good.length) return {};
  const low = Math.log10(Math.min(...good)), high = Math.log10(Math.max(...good)), ticks = [];
  for (let d = Math.floor(low); d <= high; d++) for (const m of high - low > 2 ? [1] : [1, 2, 5]) ticks.push(m * 10 ** d);
  const thin = ticks.length > 2 * most ? ticks.filter((_, i) => i % 2 === 0) : ticks;
  return { tickvals: thin, ticktext: thin.map((v) => String(+v.toPrecision(1))) };
}

// ticks of a heading axis with little range: numbers of the compass
function numbered(low, high) {
  const step = [1, 2, 5, 10, 20, 45].find((s) => (high - low) / s < 6) || 90, ticks = [];
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) ticks.push(v);
  return { tickvals: ticks, ticktext: ticks.map((v) => String(((v % 360) + 360) % 360)) };
}
