// Reading a figure: values under the pointer or under a cursor moved by keys, and zoom by keys.
const KEYS = '← → move, + − zoom, Home shows all, Shift with ← → reads values';
const STEP = 0.01, PAN = 0.25;
const cursors = {};

// the values at a time, with their panel; the nearest line comes first and is drawn thick
function readout(id, e) {
  const points = e.points.filter((p) => p.data.say !== undefined), axes = Object.keys($(id)._fullLayout).filter((k) => /^yaxis\d*$/.test(k) && !$(id)._fullLayout[k].overlaying);
  if (!points.length) return;
  const x = points[0].x, digits = Math.abs(x) < 10 ? 2 : Math.abs(x) < 1000 ? 1 : 0;
  const pointer = e.event && Number.isFinite(e.event.clientY) ? e.event.clientY - $(id).getBoundingClientRect().top : null;
  const away = (p) => Math.abs(p.yaxis._offset + p.yaxis.d2p(p.y) - pointer);
  const lines = points.filter((p) => p.data.mode === 'lines'), near = pointer === null || !lines.length ? null : lines.reduce((a, b) => (away(b) < away(a) ? b : a));
  const say = (p) => p.data.name + ' ' + minus(p.y.toFixed(p.data.digits)) + p.data.say + (p.data.also ? p.data.also[p.pointIndex] : '');
  const panel = (p) => (axes.length > 1 && p.yaxis.title.text ? p.yaxis.title.text.split(',')[0] + ' ' : '');
  const groups = new Map(), nearest = document.createElement('b'), rest = near && say(near);
  for (const p of near ? [near, ...points] : points) groups.set(panel(p), (groups.get(panel(p)) || new Set()).add(say(p)));
  const [first, ...others] = [...groups].map(([title, said]) => title + [...said].filter((text) => text !== rest).join(' · '));
  nearest.textContent = near ? panel(near) + rest : '';
  const beside = near ? first.slice(panel(near).length) : first;
  $(id + '-read').replaceChildren(minus((+x).toFixed(digits)) + points[0].data.at + modeAt(id, x) + ': ', nearest, [(near && beside ? ' · ' : '') + beside, ...others].filter(Boolean).join('; '));
  thicken(id, near);
}

// the flight mode at a time, in brackets
function modeAt(id, x) {
  const mode = moded(D.figures[id]) && D.marks.modes.find(([a, b]) => a <= x && x < b);
  return mode ? ' (' + mode[2] + ')' : '';
}

function thicken(id, near) {
  $(id).querySelectorAll('.near').forEach((line) => line.classList.remove('near'));
  const found = near && $(id).calcdata.find((c) => c[0] && c[0].trace.index === near.curveNumber);
  if (found && found[0].node3) found[0].node3.node().classList.add('near');
}

function unread(id) {
  const line = $(id).parentNode.querySelector('.cursor');
  if (line) line.remove();
  $(id + '-read').textContent = '';
  thicken(id, null);
}

// a range after a key: half or twice as long about its middle, or moved; null for other keys
function moved(key, [a, b]) {
  const middle = (a + b) / 2, half = (b - a) / 2, scale = { '+': 0.5, '=': 0.5, '-': 2, _: 2 }[key], way = { ArrowLeft: -PAN, ArrowRight: PAN }[key];
  return scale ? [middle - scale * half, middle + scale * half] : way ? [a + 2 * way * half, b + 2 * way * half] : null;
}

function keyed(id, e) {
  const box = $(id), L = box._fullLayout;
  if (e.target !== box || e.ctrlKey || e.metaKey || e.altKey || !L) return;
  const whole = e.key === 'Home' || e.key === '0', axes = Object.keys(L).filter((k) => /^xaxis\d*$/.test(k));
  if (e.shiftKey && e.key.startsWith('Arrow')) cursor(id, { ArrowLeft: -STEP, ArrowRight: STEP }[e.key] || 0);
  else if (timed(id)) {
    let to = whole ? home : moved(e.key, range);
    if (!to) return;
    // at an end of the log the range keeps its length
    const over = Math.max(0, full[0] - to[0]) - Math.max(0, to[1] - full[1]);
    if (e.key.startsWith('Arrow')) to = to.map((t) => t + over);
    zoom(to);
  } else if (whole) draw(id);
  else if (moved(e.key, [0, 1])) Plotly.relayout(box, Object.fromEntries(axes.map((k) => [k + '.range', moved(e.key, L[k].range.map(Number))])));
  else return;
  if (!e.shiftKey && box.parentNode.querySelector('.cursor')) cursor(id, 0);
  e.preventDefault();
}

// reads what all panels show at a cursor that keys move, kept as a share of the range
function cursor(id, way) {
  const box = $(id), L = box._fullLayout, at = cursors[id] = Math.min(Math.max((cursors[id] === undefined ? 0.5 : cursors[id]) + way, 0), 1);
  const [a, b] = L.xaxis.range.map(Number), log = L.xaxis.type === 'log', x = log ? 10 ** (a + at * (b - a)) : a + at * (b - a);
  const points = box.data.filter((t) => t.say !== undefined && t.visible !== false && t.x).map((t) => {
    const i = t.x.reduce((best, v, k) => (v !== null && t.y[k] !== null && (best < 0 || Math.abs(v - x) < Math.abs(t.x[best] - x)) ? k : best), -1);
    return i < 0 ? null : { data: t, x, y: +t.y[i], pointIndex: i, yaxis: L['yaxis' + (t.yaxis || 'y').slice(1)] };
  }).filter((p) => p && Number.isFinite(p.y));
  $(id + '-read').setAttribute('aria-hidden', 'false');
  readout(id, { points });
  const line = box.parentNode.querySelector('.cursor') || box.parentNode.appendChild(Object.assign(document.createElement('i'), { className: 'cursor' }));
  Object.assign(line.style, { left: L.xaxis._offset + at * L.xaxis._length + 'px', top: box.offsetTop + 'px', height: box.offsetHeight + 'px' });
}

// a figure that is drawn can be reached by Tab and read and zoomed by keys
function reachable(id) {
  const box = $(id), read = $(id + '-read');
  box.tabIndex = 0;
  box.setAttribute('aria-keyshortcuts', '+ - ArrowLeft ArrowRight Home Shift+ArrowLeft Shift+ArrowRight');
  read.setAttribute('aria-live', 'polite');
  box.addEventListener('keydown', (e) => keyed(id, e));
  box.addEventListener('focus', () => { if (box.matches(':focus-visible')) read.textContent = KEYS; });
  box.addEventListener('blur', () => { unread(id); read.setAttribute('aria-hidden', 'true'); });
  box.on('plotly_hover', (e) => readout(id, e));
  box.on('plotly_unhover', () => unread(id));
}
