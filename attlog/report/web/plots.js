// Figures from the page's data: traces and axes come from Python, here they get colours, size, and what is in sight.
// printed whole, or two beside each other on a page that sums up
let fits = 1; // share of their height that figures keep on a page that sums up
const summed = () => printing && root.dataset.print !== 'all' && document.querySelector('.summary');
const beside = () => summed() && document.querySelectorAll('.summary').length > 1;
const width = (id) => (printing ? (beside() ? PRINT_WIDTH / 2 - 8 : PRINT_WIDTH) : Math.max(260, $(id).clientWidth));
const narrow = (id) => width(id) < 520;
const tall = (id) => Math.round(+$(id).dataset.height * (summed() ? 0.44 * fits : printing ? 0.55 : 1)) + (moded(D.figures[id]) ? MODE_PX : 0);
// height of the flight modes below a figure over time
const MODE_PX = 14;
const moded = (f) => f.timed && f.phases && D.marks.modes.length > 0;
// rows that the legend hides, and of a figure with a focus all others
const hidden = new Set();
let focus = null;
const off = (r) => hidden.has(r) || (focus !== null && !focus.includes(r));
const CONFIG = { responsive: false, displaylogo: false, displayModeBar: false, doubleClick: false, scrollZoom: false };

function axis(title, more) {
  const muted = css('--mu'), border = css('--bd'), size = summed() ? 9 : 12;
  return Object.assign({
    title: { text: title, font: { size, color: muted }, standoff: 6 }, gridcolor: border, zerolinecolor: muted,
    zerolinewidth: 1, linecolor: border, tickfont: { size, color: muted }, automargin: false, exponentformat: 'none',
    ticklabeloverflow: 'allow', // else plotly measures every label
  }, more || {});
}

function layout(id, more) {
  const text = css('--tx'), small = narrow(id);
  return Object.assign({
    width: width(id), height: tall(id), paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', barmode: 'overlay',
    font: { family: 'system-ui,-apple-system,Segoe UI,Roboto,Arial,sans-serif', size: 12, color: text }, showlegend: false,
    margin: { l: small ? 50 : 64, r: small ? 8 : 14, t: 22, b: 40 }, hovermode: 'x',
    hoverlabel: { bgcolor: css('--bg'), bordercolor: css('--bd'), font: { size: 12, color: text }, namelength: 40 },
    dragmode: small ? false : 'zoom', shapes: [], annotations: [],
  }, more || {});
}

// figures of other pages, by their kind
const draws = {};

const band = (a, b, fill) => ({ type: 'rect', xref: 'x', yref: 'paper', x0: a, x1: b, y0: 0, y1: 1, fillcolor: fill, line: { width: 0 }, layer: 'below' });
const bar = (x, color, dash) => ({ type: 'line', xref: 'x', yref: 'paper', x0: x, x1: x, y0: 0, y1: 1, line: { color, width: 1.2, dash }, layer: 'below' });
const note = (x, text, more) => Object.assign({ x, y: 1, xref: 'x', yref: 'paper', yanchor: 'bottom', text, showarrow: false, font: { size: 12, color: css('--mu') } }, more || {});
const plain = (text, color, x, y, more) => Object.assign({
  type: 'scatter', mode: 'lines', x, y, meta: null, name: text, line: { color, width: 1.3 }, hoverinfo: 'none', say: '', digits: 2, at: ' s', own: {},
}, more || {});

// a figure for a range of flight time
function plotted(id, f, range) {
  const L = layout(id, f.hover ? { hovermode: f.hover } : {}), p = { traces: [], layout: L };
  Object.assign(L.margin, f.margin || {});
  if (f.axes.yaxis.type === 'log') L.margin.l += 10;
  for (const key of Object.keys(f.axes)) L[key] = styled(id, f.axes[key], L);
  if (f.timed) L.xaxis.range = range.slice();
  L.shapes.push(...f.shapes.map(coloured));
  for (const n of f.notes) { const c = coloured(n); L.annotations.push(Object.assign(c, { showarrow: false, font: Object.assign({ size: 12 }, c.font) })); }
  for (const s of f.traces) if (drawn(id, f, s.meta)) p.traces.push(...made(id, f, s, range, L));
  if (f.equal) equalScales(p, f.equal);
  for (const key of Object.keys(f.axes)) if (f.axes[key].fit) L[key].range = fitted(p.traces, key.replace('axis', ''), f.axes[key].fit, L.xaxis.range);
  for (const key of Object.keys(f.axes)) if (f.axes[key].heading) Object.assign(L[key], headings(...L[key].range, narrow(id)));
  leaving(p);
  p.traces.push(...p.traces.flatMap((t) => arrows(t, L)));
  for (const t of p.traces) if (t.own.edge) t.y = t.y.map(() => L.yaxis.range[0] + t.own.edge * (L.yaxis.range[1] - L.yaxis.range[0]));
  if (f.phases) phases(L, f.phases === 'named');
  if (moded(f)) modes(L);
  if (f.alarms) for (const [t] of D.marks.texts.filter((m) => m[1] === 2 && m[0] >= range[0] && m[0] <= range[1]).slice(0, 60)) L.shapes.push(bar(t, css('--bad'), 'dash'));
  if (f.labels === 'head') headed(id, p, f.phases === 'named');
  if (f.labels === 'end') ended(id, p);
  if (f.labels === 'panels') paneled(id, p, Object.keys(f.axes));
  return p;
}

// whether a trace belongs to what is chosen: a row in focus, the band of one row
function drawn(id, f, m) {
  const row = m.row === undefined ? m.band : m.row;
  if (m.band !== undefined && (m.band !== (banded[id] === undefined ? f.band : banded[id]) || hidden.has(row))) return false;
  return row === undefined || focus === null || focus.includes(row);
}

const SPARSE_S = 1.5;
function made(id, f, s, range, L) {
  const m = s.meta, t = Object.assign({ type: 'scatter' }, coloured(s)), row = m.row === undefined ? null : m.row;
  Object.assign(t, { own: m, meta: row, visible: row === null || !hidden.has(row), digits: m.digits === undefined ? 2 : m.digits, at: f.at || ' s' });
  if (t.hoverinfo === undefined && !t.hovertemplate) t.hoverinfo = m.silent || m.quiet ? 'skip' : 'none';
  t.say = m.silent || m.quiet || t.hovertemplate ? undefined : m.say;
  if (t.type === 'bar') return [clipped(t, range, L)];
  let x = array(s.x), y = array(s.y);
  if (m.time && t.mode === 'lines') {
    const seen = f.timed ? range : L.xaxis.range;
    // more than 1.5 s in a pixel: nobody can see steps, lines would be a carpet
    if (f.timed && row !== null && (range[1] - range[0]) / width(id) > SPARSE_S) {
      const e = enveloped(x, y, range, width(id), m.wraps);
      const fill = Object.assign({}, t, { x: e.bandX, y: e.bandY, fill: 'toself', fillcolor: faded(t.line.color, 0.08), line: { color: t.line.color, width: 0 }, hoverinfo: 'skip', say: undefined });
      return [fill, Object.assign(t, { x: e.X, y: e.Y, line: Object.assign({}, t.line, { width: 1.1 }) })];
    }
    [x, y] = reduced(x, y, seen, width(id), m.wraps);
  } else if (m.t) {
    const at = array(m.t), kept = indices(at.length, (i) => at[i] >= range[0] && at[i] <= range[1]), pick = (a) => kept.map((i) => a[i]);
    [x, y] = [pick(x), pick(y)];
    if (t.customdata) t.customdata = pick(t.customdata);
    if (m.angle) t.angle = pick(array(m.angle));
  }
  const place = row !== null && places(f.axes['yaxis' + (t.yaxis || 'y').slice(1)], row);
  t.x = Array.from(x, finite);
  t.y = Array.from(y, (v) => (place || place === 0 ? v + place : finite(v)));
  if (t.error_y && t.mode === 'lines') {
    const up = t.error_y.array, down = t.error_y.arrayminus, text = (v) => v.toPrecision(2);
    t.also = t.y.map((v, i) => (up[i] ? ' [' + text(v - down[i]) + ' to ' + text(v + up[i]) + ']' : ''));
    delete t.error_y;
  }
  return [t];
}
const finite = (v) => (Number.isFinite(v) ? v : null);
const indices = (n, keep) => Array.from({ length: n }, (_, i) => i).filter(keep);

function styled(id, a, L) {
  const { title, fit, rows, named, heading, narrow: few, ...more } = a, made = axis(safe(title), more);
  if (few && narrow(id)) made.ticktext = few;
  if (more.side === 'right') L.margin.r += 40;
  if (summed() && more.domain) made.nticks = 3;
  if (rows) {
    const here = rows.filter((r) => !off(r)), longest = Math.max(1, ...here.map((r) => Math.min(D.rows[r].name.length, 22)));
    L.margin.l = Math.min(24 + 6.6 * longest, width(id) * 0.42);
    Object.assign(made, { tickvals: here.map((r) => places(a, r)), ticktext: here.map((r) => short(name(r), 22)), range: [-0.6, here.length - 0.4] });
  }
  return made;
}

// the line of a row, from the top down, of those that are shown
function places(a, row) {
  const here = a && a.rows && a.rows.filter((r) => !off(r));
  return here ? here.length - 1 - here.indexOf(row) : false;
}

// bars of time cut to the range, their names where they fit
function clipped(t, [low, high], L) {
  const pixels = (L.width - L.margin.l - L.margin.r) / (high - low), kept = indices(t.x.length, (i) => t.base[i] + t.x[i] >= low && t.base[i] <= high);
  const pick = (a) => (Array.isArray(a) ? kept.map((i) => a[i]) : a), ends = kept.map((i) => [Math.max(t.base[i], low), Math.min(t.base[i] + t.x[i], high)]);
  const text = pick(t.text).map((s, k) => ((ends[k][1] - ends[k][0]) * pixels > 7 * s.length + 8 ? s : ''));
  return Object.assign(t, { base: ends.map((e) => e[0]), x: ends.map((e) => e[1] - e[0]), y: pick(t.y), text, customdata: pick(t.customdata), marker: Object.assign({}, t.marker, { color: pick(t.marker.color) }), textfont: { size: 12, color: css('--tx') } });
}

// a metre is as long on both axes
function equalScales(p, least) {
  const L = p.layout, lines = p.traces.filter((t) => !t.own.free), w = L.width - L.margin.l - L.margin.r, h = L.height - L.margin.t - L.margin.b;
  const sides = ['x', 'y'].map((k) => { const all = lines.flatMap((t) => t[k].filter((v, i) => v !== null && t.y[i] !== null)); return all.length ? [share(all, 0.002), share(all, 0.998)] : [0, 0]; });
  const scale = 1.15 * Math.max((sides[0][1] - sides[0][0]) / w, (sides[1][1] - sides[1][0]) / h, least / h);
  [['xaxis', w], ['yaxis', h]].forEach(([key, pixels], i) => { const middle = (sides[i][0] + sides[i][1]) / 2; L[key].range = [middle - scale * pixels / 2, middle + scale * pixels / 2]; });
}

const MOST_ARROWS = 160;
// arrows along a line, by the distance along it: the line becomes their shafts, their heads are turned to the screen
function arrows(t, L) {
  if (!t.own.arrow) return [];
  const long = t.own.arrow * (L.yaxis.range[1] - L.yaxis.range[0]) / (L.height - L.margin.t - L.margin.b), at = [];
  let way = Infinity, before = null;
  t.x.forEach((x, i) => {
    if (!Number.isFinite(t.angle[i]) || t.y[i] === null) return;
    if (before !== null) way += Math.hypot(x - t.x[before], t.y[i] - t.y[before]);
    if (way > 1.1 * long) { at.push(i); way = 0; }
    before = i;
  });
  const thin = at.filter((_, k) => k % Math.ceil(at.length / MOST_ARROWS) === 0), turn = (i) => t.angle[i] * Math.PI / 180;
  const tips = thin.map((i) => [t.x[i] + long * Math.sin(turn(i)), t.y[i] + long * Math.cos(turn(i))]);
  const heads = plain(t.name, t.line.color, tips.map((c) => c[0]), tips.map((c) => c[1]), { mode: 'markers', arrow: true, hoverinfo: 'skip', say: undefined, marker: { symbol: 'triangle-up', size: 7, color: t.line.color, angle: thin.map((i) => t.angle[i]) } });
  [t.x, t.y] = [0, 1].map((k) => thin.flatMap((i, j) => [k ? t.y[i] : t.x[i], tips[j][k], null]));
  return [heads];
}

// the span that a link of a finding points at
let pointed = null;
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
  if (pointed && seen(...pointed)) L.shapes.push(band(...pointed, faded(css('--ac'), 0.14)), bar(pointed[0], css('--ac'), 'solid'), bar(pointed[1], css('--ac'), 'solid'));
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

// flight modes between the axis of time and its numbers, in the colours of the strip, with their names where they fit
function modes(L) {
  const [low, high] = L.xaxis.range, pixels = (L.width - L.margin.l - L.margin.r) / (high - low), names = [...new Set(D.marks.modes.map((m) => m[2]))];
  L.margin.b += MODE_PX;
  Object.assign(L.xaxis, { ticks: 'outside', ticklen: MODE_PX, tickcolor: 'rgba(0,0,0,0)' });
  for (const [a, b, text] of D.marks.modes) {
    const from = Math.max(a, low), to = Math.min(b, high);
    if ((to - from) * pixels < 1) continue;
    L.shapes.push({ type: 'rect', xref: 'x', yref: 'paper', x0: from, x1: to, ysizemode: 'pixel', yanchor: 0, y0: -1, y1: -MODE_PX, fillcolor: css('--m' + names.indexOf(text) % 4), line: { width: 0 }, layer: 'below' });
    if ((to - from) * pixels > 6.6 * text.length + 6) L.annotations.push({ x: from, y: 0, xref: 'x', yref: 'paper', xanchor: 'left', yanchor: 'middle', yshift: -(MODE_PX + 1) / 2, text: safe(text), showarrow: false, font: { size: 11, color: css('--tx') } });
  }
}

// the lines' names in their colours, where few are drawn: above the figure, or at their ends
const LABELLED = 4;
const STROKES = { solid: '— ', dash: '– – ', dot: '··· ' };
function named(traces) {
  const found = new Map();
  for (const t of traces) if (t.mode === 'lines' && t.visible !== false && t.line.width && t.name && !t.own.keyless && !found.has(t.name)) found.set(t.name, t);
  const lines = [...found.values()], alone = lines.every((t) => t.meta === null);
  return lines.length && (alone ? lines.length > 1 : lines.length <= LABELLED) ? lines : [];
}

function headed(id, p, above) {
  const lines = named(p.traces), strokes = lines.some((t) => t.meta !== null), inside = width(id) - (narrow(id) ? 58 : 78);
  const texts = lines.map((t) => (strokes ? STROKES[t.line.dash || 'solid'] || '' : '') + t.name), wide = texts.map((t) => 12 * (0.56 * t.length + 1.2));
  if (!lines.length || wide.reduce((a, b) => a + b, 0) > width(id) - p.layout.margin.l) return;
  if (above) p.layout.margin.t += 14;
  lines.forEach((t, i) => p.layout.annotations.push({
    x: wide.slice(0, i).reduce((a, b) => a + b, 0) / inside, y: 1, xref: 'paper', yref: 'paper', xanchor: 'left', yanchor: 'bottom', yshift: above ? 15 : 0, text: texts[i], showarrow: false, font: { size: 12, color: t.line.color },
  }));
}

// the lines' names in their colours above each panel, as many as have room
function paneled(id, p, keys) {
  const L = p.layout, inside = L.width - L.margin.l - L.margin.r;
  for (const key of keys.filter((k) => k[0] === 'y')) {
    const own = p.traces.filter((t) => 'yaxis' + (t.yaxis || 'y').slice(1) === key && t.mode === 'lines' && t.name && !t.own.keyless).sort((a, b) => !!a.line.dash - !!b.line.dash), top = (L[key].domain || [0, 1])[1];
    // without what stands in brackets where the whole names have no room
    const full = (t) => (STROKES[t.line.dash || 'solid'] || '') + t.name, room = (text) => 6.6 * text.length + 12;
    const crowded = own.reduce((sum, t) => sum + room(full(t)), 0) > inside;
    let x = 0;
    for (const t of own) {
      const text = crowded ? full(t).replace(/ \(.*\)$/, '') : full(t);
      if (x + room(text) > inside) break;
      L.annotations.push({ x: x / inside, y: top, xref: 'paper', yref: 'paper', xanchor: 'left', yanchor: 'bottom', text, showarrow: false, font: { size: 12, color: t.line.color } });
      x += room(text);
    }
  }
}

function ended(id, p) {
  const L = p.layout, log = L.yaxis.type === 'log', to = log ? Math.log10 : (v) => v, lines = named(p.traces.filter((t) => (t.yaxis || 'y') === 'y'));
  if (!lines.length || narrow(id)) return;
  const all = lines.flatMap((t) => t.y.filter((v) => v !== null && (!log || v > 0)).map(to)), [low, high] = L.yaxis.range || [Math.min(...all), Math.max(...all)];
  const share = L.yaxis.domain ? L.yaxis.domain[1] - L.yaxis.domain[0] : 1, step = 14 * (high - low) / ((L.height - L.margin.t - L.margin.b) * share);
  const ends = lines.map((t) => { const i = t.y.findLastIndex((v) => v !== null); return { t, y: Math.min(Math.max(to(t.y[i]), low), high) }; }).sort((a, b) => a.y - b.y);
  ends.forEach((e, i) => { if (i) e.y = Math.max(e.y, ends[i - 1].y + step); });
  const over = Math.max(0, ends[ends.length - 1].y - high);
  L.margin.r += 8 + 6.6 * Math.max(...lines.map((t) => Math.min(t.name.length, 22)));
  for (const { t, y } of ends) L.annotations.push({ x: 1, xref: 'paper', xanchor: 'left', y: y - over, yref: 'y', yanchor: 'middle', text: ' ' + short(t.name, 22), showarrow: false, font: { size: 12, color: t.line.color } });
}

const MOSTLY = 0.05;
// an arrow at the edge where a line leaves the figure
function leaving(p) {
  const found = [], within = p.layout.xaxis.range;
  for (const t of p.traces) {
    const key = t.yaxis || 'y', ax = p.layout['yaxis' + key.slice(1)];
    if (!((t.meta !== null && !t.fill) || t.own.beyond) || t.mode !== 'lines' || !ax || !ax.range || ax.type === 'log' || p.layout.xaxis.type === 'log') continue;
    for (const [edge, beyond, symbol] of [[ax.range[1], (v) => v > ax.range[1], 'triangle-up'], [ax.range[0], (v) => v < ax.range[0], 'triangle-down']]) {
      const out = t.y.map((v, k) => v !== null && beyond(v) && (!within || (t.x[k] >= within[0] && t.x[k] <= within[1])));
      const starts = indices(out.length, (k) => out[k] && !out[k - 1]), at = t.own.beyond ? starts : starts.slice(0, 1);
      if (t.meta !== null && out.filter(Boolean).length > MOSTLY * t.y.length) t.opacity = 0.35;
      if (at.length) found.push({
        type: 'scatter', mode: 'markers', x: at.map((k) => t.x[k]), y: at.map(() => edge), yaxis: key, meta: t.meta, own: {}, name: t.name, visible: t.visible, cliponaxis: false, arrow: true, hoverinfo: 'skip',
        marker: { symbol, size: t.own.beyond ? 8 : 11, color: t.line.color, line: { color: css('--bg'), width: 1 } },
      });
    }
  }
  p.traces.push(...found);
}

const COMPASS = { 0: 'N', 90: 'E', 180: 'S', 270: 'W' };
// ticks of a heading axis: directions, or with little range numbers of the compass
function headings(low, high, small) {
  const step = high - low > 150 ? 90 : [1, 2, 5, 10, 20, 45].find((s) => (high - low) / s < 6) || 90, ticks = [];
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) ticks.push(v);
  const text = (h) => (step < 90 ? String(h) : small ? COMPASS[h] || String(h) : (COMPASS[h] || '') + ' ' + h);
  return { tickvals: ticks, ticktext: ticks.map((v) => text(((v % 360) + 360) % 360)) };
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
