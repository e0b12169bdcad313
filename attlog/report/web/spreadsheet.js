// A text as a cell that a spreadsheet shows and does not run, as attlog/spreadsheet.py makes it; quoted.
function spreadsheetCell(text) {
  const formula = /^[\s"]*[=+@＝＋－＠-].|^[\t\n]./s, number = /^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$/;
  const whole = String(text).replace(/\r\n?/g, '\n');
  const parts = whole.split(/([;\t\n])/).map((part, i) => (formula.test(i ? part : whole) && !number.test(part.trim()) ? "'" + part : part));
  return '"' + parts.join('').replace(/"/g, '""') + '"';
}

// The numbers of a figure as a table: of what is shown, all that is stored; head, then lines.
function tableOf(id) {
  const f = shownOf(id), head = D.figures[id].table;
  if (!head) return ofTraces($(id));
  if (Array.isArray(head[0])) return head;
  focus = f.focus || null;
  return [head, ...f.traces.filter((s) => drawn(id, f, s.meta) && !hidden.has(s.meta.row)).flatMap((s) => {
    const m = s.meta, columns = m.columns || (m.quantity ? { [m.quantity]: [s.y, m.unit] } : {});
    return Object.entries(columns).flatMap(([quantity, [y, unit]]) => linesOf(f, s, quantity, y, unit, head));
  })];
}

function linesOf(f, s, quantity, stored, unit, head) {
  const m = s.meta, x = array(m.t || s.base || s.x), end = s.base ? x.map((v, i) => v + s.x[i]) : x, bars = s.error_y, dots = head[0] === 'filter';
  const y = m.text || (dots ? (m.value === undefined ? s.x : [m.value]) : array(m.value || stored));
  const value = (i) => (m.cut === undefined ? y[i] : ((y[i] % 360) + 360) % 360), low = m.low && array(m.low), high = m.high && array(m.high);
  const lower = (i) => (dots ? m.ci && m.ci[0] : bars ? y[i] - bars.arrayminus[i] : low && low[i]), upper = (i) => (dots ? m.ci && m.ci[1] : bars ? y[i] + bars.array[i] : high && high[i]);
  const cells = { filter: () => (m.row === undefined ? s.name : D.rows[m.row].name), quantity: () => quantity, unit: () => unit, value, lower, upper, p10: lower, p90: upper, n: () => m.n || 1, end_s: (i) => end[i] };
  const seen = (i) => !(f.timed || f.follows) || (x[i] >= range[0] && x[i] <= range[1]) || (end[i] >= range[0] && x[i] <= range[1]);
  return indices(y.length, (i) => (m.text || Number.isFinite(y[i])) && seen(i)).map((i) => head.map((key) => (cells[key] ? cells[key](i) : x[i] * (f.scale || 1))));
}

// a figure of another page: its lines as they are drawn
function ofTraces(gd) {
  const out = [['x', 'line', 'quantity', 'value']];
  for (const t of gd.data) {
    if (t.visible === false || t.arrow || t.fill === 'toself') continue;
    const ax = gd.layout['yaxis' + (t.yaxis || 'y').slice(1)], title = (ax && ax.title && ax.title.text) || '';
    for (let i = 0; i < t.x.length; i++) if (Number.isFinite(t.y[i]) && t.x[i] !== null) out.push([t.x[i], t.name || '', title, t.y[i]]);
  }
  return out;
}

function csv(table) {
  const cell = (v) => (v === null || v === undefined ? '' : typeof v === 'number' ? (Number.isFinite(v) ? +v.toPrecision(9) : '') : spreadsheetCell(v));
  const head = (v) => (/^\w+$/.test(v) ? v : cell(v));
  return table.map((row, i) => row.map(i ? cell : head).join(',')).join('\n') + '\n';
}
