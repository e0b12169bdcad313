// A text as a cell that a spreadsheet shows and does not run, as attlog/spreadsheet.py makes it; quoted.
function spreadsheetCell(text) {
  const formula = /^[\s"]*[=+@＝＋－＠-].|^[\t\n]./s, number = /^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$/;
  const whole = String(text).replace(/\r\n?/g, '\n');
  const parts = whole.split(/([;\t\n])/).map((part, i) => (formula.test(i ? part : whole) && !number.test(part.trim()) ? "'" + part : part));
  return '"' + parts.join('').replace(/"/g, '""') + '"';
}

// The numbers of each kind of figure as a table: of what is shown, all that is stored; head, then lines.
const ASCII = { '°/s/√Hz': 'deg/s/sqrt(Hz)', 'm/s²/√Hz': 'm/s^2/sqrt(Hz)', 'm/s²': 'm/s^2', 'µT': 'uT' };
const called = (r) => D.rows[r].name;
const drawnOf = (some) => some.filter((s) => !off(s.r));
const finite = (v) => v !== null && v !== undefined && Number.isFinite(v);
const inside = (range) => (t) => !range || (t >= range[0] && t <= range[1]);

// one line per sample and column: [t, ...before, quantity, value, unit]
function samples(t, columns, unit, range, before = []) {
  const keep = inside(range), out = [];
  for (const [quantity, y] of Object.entries(columns)) for (let i = 0; i < t.length; i++) if (finite(y[i]) && keep(t[i])) out.push([t[i], ...before, quantity, y[i], unit]);
  return out;
}

const renamed = (columns, word) => Object.fromEntries(Object.entries(columns).map(([k, y]) => [word(k), y]));
const unpacked = (y) => Object.fromEntries(Object.entries(y).map(([k, a]) => [k, values(a)]));
const ofRows = (series, unit, range, word = (k) => k) => drawnOf(series).flatMap((s) => samples(times(s.t), renamed(unpacked(s.y), word), unit, range, [called(s.r)]));
const ofDots = (rows, quantity, unit) => drawnOf(rows).filter((d) => finite(d.v)).map((d) => [called(d.r), quantity(d), d.v, d.ci ? d.ci[0] : null, d.ci ? d.ci[1] : null, d.n, unit]);
const FILTERED = ['time_s', 'filter', 'quantity', 'value', 'unit'], SENSED = ['time_s', 'quantity', 'value', 'unit'];
const BOUNDED = ['filter', 'quantity', 'value', 'lower', 'upper', 'n', 'unit'];

const tables = {
  strip(f, range) {
    const M = D.marks, span = (what, some) => some.filter((s) => s[1] >= range[0] && s[0] <= range[1]).map((s) => [s[0], s[1], what, s[2] || '']);
    const texts = M.texts.filter((m) => inside(range)(m[0])).map((m) => [m[0], m[0], ['message', 'warning', 'alarm'][m[1]], m[2]]);
    return [['time_s', 'end_s', 'quantity', 'value'], ...span('mode', M.modes), ...span('armed', M.armed), ...span('in the air', M.airborne), ...texts];
  },
  attitude: (f, range) => [FILTERED, ...ofRows(f.series, 'deg', range), ...(f.demand ? samples(times(f.demand.t), unpacked(f.demand.y), 'deg', range, ['set-point']) : [])],
  difference: (f, range) => [FILTERED, ...ofRows(f.series, 'deg', range), ...(f.sigma ? samples(times(f.sigma.t), renamed(unpacked(f.sigma.y), (k) => 'sigma of ' + k), 'deg', range, ['reference']) : [])],
  bias: (f, range) => [FILTERED, ...ofRows(f.series, 'deg/s', range), ...(f.rests ? samples(f.rests.t, { x: f.rests.x, y: f.rests.y, z: f.rests.z }, 'deg/s', range, ['gyro at rest']) : [])],
  rest: (f) => [FILTERED, ...ofRows(f.series, 'deg')],
  drift: (f, range, view) => [FILTERED, ...ofRows(f.series, 'deg', null, (k) => (k === 'line' ? 'fitted line' : 'heading error') + (view && ', ' + view))],
  setpoint: (f) => [FILTERED, ...ofRows(f.series, '1')],
  spread: (f) => [['angle_deg', 'filter', 'quantity', 'value', 'unit'], ...drawnOf(f.shares).flatMap((s) => samples(f.x, { 'share of samples': s.y }, '%', null, [called(s.r)]))],
  allan: (f, range, view) => [['tau_s', 'filter', 'quantity', 'value', 'lower', 'upper', 'unit'], ...drawnOf(f.curves).flatMap((c) => c.tau.map((tau, i) => [tau, called(c.r), 'Allan deviation' + (view && ' of ' + view), c.deviation[i], (c.low || [])[i], (c.high || [])[i], 'deg']))],
  step(f) {
    const one = (l, own) => samples(times(l.t), own, 'deg', null, [called(l.r)]), longest = f.lines.reduce((a, b) => (b.t.n > a.t.n ? b : a)), axis = f.axis + ' change';
    const common = (who, y) => (y ? samples(times(longest.t), { [axis]: values(y) }, 'deg', null, [who]) : []);
    return [FILTERED, ...drawnOf(f.lines).flatMap((l) => { const est = values(l.y.est), ref = values(l.y.ref); return one(l, { [axis]: est, [axis + ' minus reference']: est.map((v, i) => v - ref[i]) }); }), ...common('reference', longest.y.ref), ...common('set-point', longest.y.set)];
  },
  steps: (f, range, view) => [['time_s', 'filter', 'quantity', 'value', 'p10', 'p90', 'unit'], ...drawnOf(f.lines).flatMap((l) => f.x.map((ms, i) => [ms / 1e3, called(l.r), 'median error' + (view && ', ' + view), l.median[i], l.low[i], l.high[i], '% of the step']).filter((row) => finite(row[3])))],
  lag: (f) => [BOUNDED, ...ofDots(f.rows, () => 'lag', 'ms'), ...drawnOf(f.rows).flatMap((d) => d.single.map((v) => [called(d.r), 'lag of one step', v, null, null, 1, 'ms']))],
  drifts: (f) => [BOUNDED, ...ofDots(f.rows, (d) => 'drift ' + d.where, 'deg/min')],
  track: (f, range) => [SENSED, ...[['north', 'm'], ['east', 'm'], ['heading', 'deg'], ['course', 'deg'], ['speed', 'm/s']].flatMap(([k, unit]) => samples(f.t, { [k]: f[k] }, unit, range))],
  compass: (f, range, view) => [SENSED, ...samples(times(f.t), renamed(unpacked(f.y), (k) => (view && view + ' ') + k.slice(-1) + ' ' + (k.slice(0, -2) || 'measured')), 'uT', range)],
  interference: (f) => [['drive_' + (f.unit === '%' ? 'pct' : f.unit.toLowerCase()), 'quantity', 'value', 'unit'], ...samples(f.x, { residual: f.y, 'fitted line': f.x.map((x) => f.line[0] + f.line[1] * x) }, 'uT')],
  vibration: (f, range, view) => [SENSED, ...samples(f.t, f.level ? { [view || 'level']: f.level } : renamed(f.axes, (k) => 'standard deviation of ' + k), 'm/s^2', range), ...samples(f.clipped.map((c) => c[0]), { 'clipped samples': f.clipped.map((c) => c[1]) }, '1', range)],
  spectrum: (f, range, view) => [['frequency_hz', 'quantity', 'value', 'unit'], ...samples(f.x, renamed(f.axes, (k) => (view && view + ' ') + k), ASCII[f.unit] || f.unit)],
  ratios: (f, range) => [SENSED, ...f.lines.flatMap((l) => samples(times(l.t), { [l.aid + ' test ratio']: values(l.y.ratio) }, '1', range))],
  size: (f, range) => [SENSED, ...samples(f.t, { smallest: f.low, mean: f.mean, largest: f.high }, ASCII[f.unit] || f.unit, range), ...(f.throttle ? samples(f.throttle[0], { throttle: f.throttle[1] }, '%', range) : [])],
};
// the same lines again in every view are named by what is chosen
const viewOf = (id) => { const select = document.querySelector('select[data-figure=' + id + ']'); return select && select.options.length > 1 ? select.selectedOptions[0].textContent.replace(/ \(.*/, '') : ''; };

function tableOf(id) {
  const f = shownOf(id), kind = D.figures[id].kind;
  if (D.figures[id].table) return D.figures[id].table;
  focus = f.focus || null;
  return tables[kind] ? tables[kind](f, range, viewOf(id)) : ofTraces($(id));
}

// a figure of another page: its lines as they are drawn
function ofTraces(gd) {
  const out = [['x', 'line', 'quantity', 'value']];
  for (const t of gd.data) {
    if (t.visible === false || t.arrow || t.fill === 'toself') continue;
    const ax = gd.layout['yaxis' + (t.yaxis || 'y').slice(1)], title = (ax && ax.title && ax.title.text) || '';
    for (let i = 0; i < t.x.length; i++) if (finite(t.y[i]) && t.x[i] !== null) out.push([t.x[i], t.name || '', title, t.y[i]]);
  }
  return out;
}

function csv(table) {
  const cell = (v) => (v === null || v === undefined ? '' : typeof v === 'number' ? (Number.isFinite(v) ? +v.toPrecision(9) : '') : spreadsheetCell(v));
  const head = (v) => (/^\w+$/.test(v) ? v : cell(v));
  return table.map((row, i) => row.map(i ? cell : head).join(',')).join('\n') + '\n';
}
