// Drawings made here and not by plotly: they follow every key of a filter, and ten thousand points are one path.
const quantile = (sorted, p) => { const at = p * (sorted.length - 1), k = Math.floor(at); return k + 1 < sorted.length ? sorted[k] + (at - k) * (sorted[k + 1] - sorted[k]) : sorted[k]; };
const ascending = (values) => Float64Array.from(values).sort();

const WIDE = 180, HIGH = 40, FOOT = 36;
// a flight: height or tilt over the log, a bar where it was in the air, serious events with what happened
function thumbnail(i) {
  const found = D.thumb[i];
  if (!found) return '';
  const [at, t0, t1, said, air, marks] = found, n = D.points;
  const x = (j) => (WIDE * j / n).toFixed(1), s = (t) => +(WIDE * Math.max(0, Math.min(1, (t - t0) / (t1 - t0)))).toFixed(1);
  let area = 'M0 ' + FOOT;
  for (let j = 0; j < n; j++) {
    const v = blob[at + j], y = (FOOT - (v === 255 ? 0 : v / 254) * (FOOT - 2)).toFixed(1);
    area += 'L' + x(j) + ' ' + y + 'L' + x(j + 1) + ' ' + y;
  }
  const words = [said, ...marks.map((m) => m[1])].join('; ');
  return svg('svg', { class: 'th', viewBox: '0 0 ' + WIDE + ' ' + HIGH, preserveAspectRatio: 'none', role: 'img', 'aria-label': words },
    svg('title', {}, said), svg('path', { class: said.startsWith('Tilt') ? 'area tilt' : 'area', d: area + 'L' + WIDE + ' ' + FOOT + 'Z' }),
    ...air.map(([a, b]) => svg('rect', { class: 'air', x: s(a), y: FOOT + 1, width: Math.max(0.5, s(b) - s(a)), height: 3 })),
    ...marks.map(([t, text]) => svg('g', { class: 'mark' }, svg('title', {}, text),
      svg('line', { x1: s(t), x2: s(t), y1: 0, y2: HIGH }), svg('rect', { x: s(t) - 6, y: 0, width: 12, height: HIGH }))));
}

const GROUPS = 14, GRAVE = 4;  // levels of serious trouble
// a line for each group: how many, how many in serious trouble, quartiles, and where they lie
function spread(list, column, values, groups) {
  const found = new Map();
  for (const i of list) {
    const g = groups.at[i], place = found.get(g) || found.set(g, { g, all: 0, bad: 0, v: [] }).get(g);
    place.all++;
    if (D.level[i] < GRAVE) place.bad++;
    if (values && values[i] !== null) place.v.push(values[i]);
  }
  const size = (p) => (values ? p.v.length : 0) * 1e6 + p.all;
  let lines = [...found.values()].sort((a, b) => size(b) - size(a));
  const left = lines.slice(GROUPS);
  lines = lines.slice(0, GROUPS).sort((a, b) => a.g - b.g);
  if (left.length) lines.push(left.reduce((a, b) => ({ g: -2, all: a.all + b.all, bad: a.bad + b.bad, v: a.v.concat(b.v), of: left.length }), { all: 0, bad: 0, v: [] }));
  const every = ascending(lines.flatMap((p) => p.v));
  let low = 0, high = 1;
  if (every.length) { low = Math.min(0, quantile(every, 0.02)); high = Math.max(0, quantile(every, 0.98)); if (high <= low) high = low + 1; }
  const x = (v) => 1000 * Math.max(0, Math.min(1, (v - low) / (high - low)));
  const name = (p) => (p.g === -2 ? counted(p.of, 'other') : p.g < 0 ? 'unknown' : groups.words[p.g]);
  const row = (p) => {
    const v = ascending(p.v), cells = [el('th', { scope: 'row' }, name(p)), el('td', {}, p.all.toLocaleString('en')), el('td', {}, Math.round(100 * p.bad / p.all) + ' %')];
    if (!v.length) return el('tr', {}, ...cells, el('td', { class: 'na' }, column ? 'no value' : ''), el('td'), el('td'));
    const q = [0.05, 0.25, 0.5, 0.75, 0.95].map((p) => quantile(v, p));
    const strip = svg('svg', { viewBox: '0 0 1000 18', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
      svg('line', { class: 'whisker', x1: x(q[0]), x2: x(q[4]), y1: 9, y2: 9 }),
      svg('rect', { class: 'box', x: x(q[1]), width: Math.max(1, x(q[3]) - x(q[1])), y: 3, height: 12 }),
      svg('line', { class: 'median', x1: x(q[2]), x2: x(q[2]), y1: 1, y2: 17 }));
    return el('tr', {}, ...cells, el('td', {}, number(q[2], column.unit), el('small', {}, v.length < p.all ? 'of ' + v.length.toLocaleString('en') : '')),
      el('td', {}, v.length > 1 ? number(q[1], column.unit) + ' to ' + number(q[3], column.unit) : ''), el('td', { class: 's' }, strip));
  };
  const unit = column && column.sign ? ' ' + column.sign : '';
  const head = ['', 'Logs', 'Serious', 'Median' + unit, 'Middle half' + unit, ''];
  $('spread').replaceChildren(
    el('thead', {}, el('tr', {}, ...head.map((h, k) => (h ? el('th', { scope: 'col' }, h) : el(k ? 'td' : 'th', k ? {} : { scope: 'col' }, k ? '' : $('by').selectedOptions[0].text))))),
    el('tbody', {}, ...lines.map(row)));
  $('spread-cap').textContent = every.length ? 'Box: middle half of the logs, thick line: median, thin line: 5 to 95 %; from ' + withUnit(low, column) + ' to ' + withUnit(high, column) + '.' : '';
}

const BINS = 24, LEAST_IN_BIN = 3, TALL = 320, EDGE = { l: 56, r: 12, t: 12, b: 30 };
let dots = [], wide = 640;
// every log a dot at its date, the median and the middle half over equal parts of the time
function trend(list, column, values) {
  const at = list.filter((i) => D.date[i] !== null && values && values[i] !== null);
  dots = [];
  wide = Math.max(300, $('trend').clientWidth);
  $('near').textContent = '';
  if (!at.length) {
    $('trend').replaceChildren();
    $('trend-cap').textContent = !list.length ? '' : list.some((i) => D.date[i] !== null) ? 'No log of these has both a date and this number.' : 'None of these logs has a date: it had no GNSS time.';
    return;
  }
  let from = Infinity, to = -Infinity;
  for (const i of at) { from = Math.min(from, D.date[i]); to = Math.max(to, D.date[i]); }
  if (to - from < 86400) { from -= 43200; to += 43200; }
  const every = ascending(at.map((i) => values[i]));
  let low = Math.min(0, quantile(every, 0.01)), high = Math.max(0, quantile(every, 0.99));
  if (high <= low) high = low + 1;
  const x = (s) => EDGE.l + (wide - EDGE.l - EDGE.r) * (s - from) / (to - from);
  const y = (v) => EDGE.t + (TALL - EDGE.t - EDGE.b) * (1 - Math.max(0, Math.min(1, (v - low) / (high - low))));
  const grid = [0, 1, 2, 3, 4].map((k) => low + (high - low) * k / 4).map((v) => svg('g', {},
    svg('line', { class: 'grid', x1: EDGE.l, x2: wide - EDGE.r, y1: y(v), y2: y(v) }), svg('text', { x: EDGE.l - 6, y: y(v) + 4, 'text-anchor': 'end' }, number(v, column.unit))));
  const steps = wide < 480 ? 2 : 3, at0 = (k) => from + (to - from) * k / steps;
  const ticks = Array.from({ length: steps + 1 }, (_, k) => svg('text', { x: x(at0(k)), y: TALL - 8, 'text-anchor': k === 0 ? 'start' : k === steps ? 'end' : 'middle' }, day(at0(k))));
  const paths = [['dots', (i) => D.level[i] >= GRAVE], ['dots bad', (i) => D.level[i] < GRAVE]].map(([name, wanted]) => {
    let d = '';
    for (const i of at) if (wanted(i)) { const p = [x(D.date[i]), y(values[i]), i]; dots.push(p); d += 'M' + p[0].toFixed(1) + ' ' + p[1].toFixed(1) + 'h0'; }
    return svg('path', { class: name, d, 'stroke-width': at.length > 3000 ? 3 : at.length > 300 ? 4 : 6 });
  });
  const bins = Array.from({ length: BINS }, () => []);
  for (const i of at) bins[Math.min(BINS - 1, Math.floor(BINS * (D.date[i] - from) / (to - from)))].push(values[i]);
  const middle = [], above = [], below = [];
  bins.forEach((bin, k) => {
    if (bin.length < LEAST_IN_BIN) return;
    const v = ascending(bin), place = x(from + (to - from) * (k + 0.5) / BINS).toFixed(1);
    middle.push(place + ' ' + y(quantile(v, 0.5)).toFixed(1)); above.push(place + ' ' + y(quantile(v, 0.75)).toFixed(1)); below.unshift(place + ' ' + y(quantile(v, 0.25)).toFixed(1));
  });
  const lines = middle.length > 1 ? [svg('path', { class: 'band', d: 'M' + [...above, ...below].join('L') + 'Z' }), ...paths, svg('path', { class: 'line', d: 'M' + middle.join('L') })] : paths;
  const v = every, said = at.length + ' logs from ' + day(from) + ' to ' + day(to) + ', median ' + withUnit(quantile(v, 0.5), column);
  $('trend').replaceChildren(svg('svg', { viewBox: '0 0 ' + wide + ' ' + TALL, role: 'img', 'aria-label': said }, ...grid, ...ticks, ...lines, svg('circle', { class: 'here', r: 6, cx: -20, cy: -20 })));
  $('trend-cap').textContent = 'Each dot is a log, red: serious trouble. ' + (middle.length > 1 ? 'Line: median, band: middle half. ' : '') + 'Click a dot to find its log. ' + counted(list.length - at.length, 'log') + ' without date or number left out.';
}

function nearest(event) {
  const drawing = $('trend').querySelector('svg');
  if (!drawing) return null;
  const box = drawing.getBoundingClientRect(), scale = wide / box.width;
  const px = (event.clientX - box.left) * scale, py = (event.clientY - box.top) * scale;
  let best = null, least = 24 * 24;
  for (const p of dots) { const d = (p[0] - px) ** 2 + (p[1] - py) ** 2; if (d < least) { least = d; best = p; } }
  return best;
}
