// The vehicle's parameters: a table that is searched. Rows are made when it is first opened.
function parameters() {
  const place = $('parameters');
  if (!place || !(D.parameters || []).length) return;
  const body = place.querySelector('tbody'), search = $('parameter-search'), kind = $('parameter-kind');
  let rows = null;
  const cell = (tag, text, kids) => { const made = document.createElement(tag); made.textContent = text; made.append(...(kids || [])); return made; };
  const dim = (text) => { const made = cell('span', text); made.className = 'mu'; return made; };
  const during = ([t, moment, value, flying]) => {
    const link = cell('a', moment);
    link.href = '#part-flight';
    link.dataset.t = t;
    const line = cell('span', '', [link, ': ', cell('b', value), flying ? ' in the air' : '']);
    line.className = 'set';
    return line;
  };
  const row = ([name, value, usual, remark, , changes, more]) => {
    const head = cell('th', name), made = document.createElement('tr');
    head.scope = 'row';
    head.className = 'mono';
    const rest = more ? [dim('and ' + more + (more > 1 ? ' changes' : ' change') + ' more, see the JSON result')] : [];
    made.append(head, cell('td', value, remark ? [' ', dim(remark)] : []), cell('td', usual), cell('td', '', [...changes.map(during), ...rest]));
    return made;
  };
  const shown = () => {
    rows = rows || D.parameters.map(row);
    const words = search.value.toUpperCase().split(/\s+/).filter(Boolean), all = D.parameters;
    const fits = ([name, , , , origin, changes]) => words.every((w) => name.toUpperCase().includes(w)) && (!kind.value || (kind.value === 'set' ? origin === 'set' || origin === 'airframe' : changes.length));
    const kept = rows.filter((_, i) => fits(all[i]));
    body.replaceChildren(...kept);
    $('parameter-count').textContent = kept.length + ' of ' + all.length;
  };
  place.querySelector('.ctl').hidden = false;
  place.addEventListener('toggle', () => { if (place.open && !rows) shown(); });
  search.addEventListener('input', shown);
  kind.addEventListener('change', shown);
  if (place.open) shown();
}

// Any signals of the log in one figure, on two axes by unit. Their samples are unpacked when the picker is first opened.
const MOST_DRAWN = 8, MOST_LISTED = 60;
let signals = null, drawnSignals = [];

function picker() {
  const place = $('picker');
  if (!place || !D.picker) return;
  place.hidden = false;
  place.addEventListener('toggle', () => { if (place.open) loaded().then(() => { if (drawnSignals.length) draw('signals'); }); });
  $('signal-search').addEventListener('input', listed);
  if (place.open) loaded();
}

async function loaded() {
  if (signals) return;
  const { messages, left } = await more('samples');
  if (signals) return;
  signals = messages.flatMap((m) => m.fields.map(([field, unit, y]) => ({ name: m.name + '.' + field, message: m, unit, y })));
  signals.left = left;
  listed();
}

const found = (text) => { const words = text.toLowerCase().split(/\s+/).filter(Boolean); return (s) => words.every((w) => s.toLowerCase().includes(w)); };

function listed() {
  if (!signals) return;
  const fits = found($('signal-search').value), all = signals.filter((s) => fits(s.name + ' ' + s.unit)), shown = all.slice(0, MOST_LISTED);
  const others = signals.left.filter(fits).length;
  $('signal-list').replaceChildren(...shown.map((s) => {
    const item = document.createElement('li'), label = document.createElement('label'), box = document.createElement('input'), name = document.createElement('span'), unit = document.createElement('span');
    box.type = 'checkbox';
    box.checked = drawnSignals.some((d) => d.signal === s);
    box.addEventListener('change', () => {
      if (box.checked) addSignal(s); else removeSignal(s);
      $('signal-list').querySelectorAll('input')[shown.indexOf(s)].focus(); // the list may be new
    });
    name.textContent = s.name;
    unit.textContent = s.unit;
    unit.className = 'mu';
    label.append(box, name, unit);
    item.append(label);
    return item;
  }));
  $('signal-count').textContent = (all.length > shown.length ? 'first ' + shown.length + ' of ' : '') + all.length + (all.length === 1 ? ' signal' : ' signals') + (others && !all.length ? '; ' + others + ' with --signals all' : '');
}

// the axis of the same unit, else the empty one, else the left
function axisFor(signal) {
  const own = drawnSignals.find((d) => d.signal.unit === signal.unit && (signal.unit || comparable(d.signal, signal)));
  if (own) return own.right;
  return drawnSignals.some((d) => !d.right) && !drawnSignals.some((d) => d.right);
}
// without a unit, ranges that differ by more than ten are no common axis
const extent = (s) => values(s.y).reduce((m, v) => (Math.abs(v) > m ? Math.abs(v) : m), 0);
function comparable(a, b) { const [x, y] = [extent(a), extent(b)]; return Math.max(x, y) <= 10 * Math.min(x, y) || x === y; }

function addSignal(signal) {
  if (drawnSignals.length >= MOST_DRAWN) {
    listed();
    $('signal-count').textContent = 'At most ' + MOST_DRAWN + ' at once: remove one first.';
    return;
  }
  const slots = drawnSignals.map((d) => d.slot), slot = [1, 2, 3, 4, 5, 6, 7, 8].find((k) => !slots.includes(k));
  drawnSignals.push({ signal, right: axisFor(signal), slot });
  redrawSignals();
}

function removeSignal(signal) {
  drawnSignals = drawnSignals.filter((d) => d.signal !== signal);
  if (drawnSignals.length && drawnSignals.every((d) => d.right)) drawnSignals.forEach((d) => { d.right = false; });
  redrawSignals();
  listed();
}

// free part at the ends of an axis: small signals fill it, labels of a constant differ in their first digits
function room(right) {
  let low = Infinity, high = -Infinity;
  for (const d of drawnSignals) if (d.right === right) for (const v of values(d.signal.y)) { if (v < low) low = v; if (v > high) high = v; }
  return { least_pad: high > low ? 0.06 * (high - low) : high === low && high ? 0.1 * Math.abs(high) : 1 };
}

const DASHES = ['solid', 'solid', 'solid', 'solid', 'dash', 'dash', 'dash', 'dash'];
function redrawSignals() {
  if (!$('signals')) {
    $('signal-place').append($('signal-figure').content.cloneNode(true));
    D.figures.signals = D.picker;
    savable($('fig-signals').querySelector('.out'));
  }
  const view = D.figures.signals.views[0], units = (right) => [...new Set(drawnSignals.filter((d) => d.right === right).map((d) => d.signal.unit).filter(Boolean))].join(', ');
  view.traces = drawnSignals.map(({ signal, right, slot }) => ({
    mode: 'lines', ...broken(signal), yaxis: right ? 'y2' : 'y', name: safe(signal.name), line: { color: 'e' + slot, width: 1.3, dash: DASHES[slot - 1] },
    meta: { time: true, unit: signal.unit, say: signal.unit ? (/^[°%]/.test(signal.unit) ? '' : ' ') + signal.unit : '', digits: decimalsOf(signal), quantity: signal.name },
  }));
  view.axes.yaxis.fit = room(false);
  view.axes.yaxis2.fit = room(true);
  view.axes.yaxis.title = units(false);
  view.axes.yaxis2.title = units(true);
  view.axes.yaxis2.visible = drawnSignals.some((d) => d.right);
  if (!view.axes.yaxis2.visible) delete view.axes.yaxis2.side; else view.axes.yaxis2.side = 'right';
  $('fig-signals').hidden = !drawnSignals.length;
  if (drawnSignals.length) draw('signals');
  chips();
}

// a line breaks where the logger paused
function broken(signal) {
  const t = times(signal.message.t), y = values(signal.y), x = [], v = [];
  const gaps = D.marks.gaps.filter(([a, b]) => b - a > 1);
  if (!gaps.length) return { x: t, y };
  for (let i = 0, k = 0; i < t.length; i++) {
    while (k < gaps.length && gaps[k][1] < t[i]) { if (i && t[i - 1] <= gaps[k][0] + 0.5) { x.push(gaps[k][0]); v.push(NaN); } k++; }
    x.push(t[i]); v.push(y[i]);
  }
  return { x: Float64Array.from(x), y: Float64Array.from(v) };
}

// decimals that resolve a thousandth of what a signal spans
function decimalsOf(signal) {
  let low = Infinity, high = -Infinity;
  for (const v of values(signal.y)) { if (v < low) low = v; if (v > high) high = v; }
  return high > low ? Math.min(Math.max(2 - Math.floor(Math.log10(high - low)), 0), 8) : Number.isInteger(low) ? 0 : 3;
}

function chips() {
  $('signal-chosen').replaceChildren(...drawnSignals.map((d) => {
    const place = document.createElement('span'), off = document.createElement('button'), side = document.createElement('button'), swatch = document.createElementNS('http://www.w3.org/2000/svg', 'svg'), line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
    for (const [key, value] of Object.entries({ x1: 1, y1: 5, x2: 25, y2: 5, class: 'l' + d.slot + ' ' + DASHES[d.slot - 1] })) line.setAttribute(key, value);
    for (const [key, value] of Object.entries({ class: 'sw', viewBox: '0 0 26 10', 'aria-hidden': 'true', focusable: 'false' })) swatch.setAttribute(key, value);
    swatch.append(line);
    for (const button of [off, side]) { button.type = 'button'; button.className = 'btn'; }
    off.textContent = d.signal.name + ' ×';
    off.setAttribute('aria-label', 'Remove ' + d.signal.name);
    off.addEventListener('click', () => { removeSignal(d.signal); $('signal-search').focus(); });
    side.textContent = d.right ? 'right axis' : 'left axis';
    side.setAttribute('aria-label', d.signal.name + ' on the ' + side.textContent + ': change');
    side.addEventListener('click', () => { d.right = !d.right; const i = drawnSignals.indexOf(d); redrawSignals(); $('signal-chosen').children[i].lastChild.focus(); });
    place.append(swatch, off, ' ', side);
    return place;
  }));
  const log = $('picker').dataset.log, texts = new Map();
  for (const { signal: { message: m } } of drawnSignals) {
    const n = times(m.t).length, each = m.records / n;
    texts.set(m.name, each > 1.01 ? m.name + ': drawn from 1 in ' + (each < 9.95 ? each.toFixed(1) : Math.round(each)) + ' samples, the smallest and largest of each ' + Math.round(2 * each) + "; all of them: attlog extract '" + log + "' '" + m.name + "'" : m.name + ': all ' + m.records.toLocaleString('en') + ' records');
  }
  $('signal-notes').replaceChildren(...[...texts.values()].map((text) => { const item = document.createElement('li'); item.textContent = text; return item; }));
}
