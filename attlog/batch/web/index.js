// The page: filters, sorts, shows rows as far as they are asked for, keeps its state in the address.
const PAGE = 25, STEP = 200;
const SAID = { crash: 'Crash', attitude: 'Wrong attitude', serious: 'Serious', ground: 'Not in flight', look: 'Look', failed: 'Failed', unjudged: 'Not judged', none: 'No trouble' };
const ALWAYS = ['', 'crash', 'attitude', 'serious', 'failed'];  // tiles that stand there even when they count nothing
const KIND = { gate: 'Gate failed', attitude: 'Attitude', crash: 'Crash', reset: 'Attitude jumped', filter: 'Filters lost', sensor: 'Sensor', log: 'Recording' };
const NUMBERS = 5;
const QUESTIONS = ['Accuracy', 'Noise', 'Lag', 'Yaw drift'];
const state = { q: '', level: '', kind: '', firmware: '', vehicle: '', row: '', metric: '', by: 'firmware', sort: '', down: '' };
let LEVELS = [], shownRows = PAGE, list = [], hay = [], opened = new Set();

const hasKind = (i, k) => D.reasons[i].some((r) => r[0] === k);
const hasGate = (i) => hasKind(i, 0);
const toSet = (i) => D.sensors[i][2];
const isIn = (i, level) => !level || (level === 'gates' ? hasGate(i) : level === 'set' ? toSet(i).length > 0 : LEVELS[D.level[i]] === level);
const column = (title) => D.columns.find((c) => c.title === title);
// one column of each question, agreement with onboard apart from errors: noise at rest, where it is known, and not noise in hover as well
const inTable = () => { const found = D.columns.filter((c) => c.values[state.row]); return found.filter((c, k) => found.findIndex((d) => d.metric === c.metric && d.agreement === c.agreement) === k).slice(0, NUMBERS); };

function matches(i) {
  if (!isIn(i, state.level)) return false;
  if (state.kind && !hasKind(i, D.kinds.indexOf(state.kind))) return false;
  if (state.firmware && D.firmware.words[D.firmware.at[i]] !== state.firmware) return false;
  if (state.vehicle && D.vehicle.words[D.vehicle.at[i]] !== state.vehicle) return false;
  return words.every((w) => hay[i].includes(w));
}
let words = [];

// what a click on a heading sorts by; strings as they are, numbers by size, what is missing last
const KEYS = { name: (i) => D.name[i].toLowerCase(), date: (i) => D.date[i], air: (i) => D.air[i] };
function sorted(found) {
  const c = column(state.sort), values = c && c.values[state.row];
  const key = values ? (i) => (values[i] === null ? null : Math.abs(values[i])) : KEYS[state.sort];
  if (!key) return found;
  const sign = state.down ? -1 : 1, of = new Map(found.map((i) => [i, key(i)]));
  return found.sort((a, b) => {
    const x = of.get(a), y = of.get(b);
    if (x === null || y === null) return (x === null) - (y === null) || a - b;
    return (x < y ? -1 : x > y ? 1 : 0) * sign || a - b;
  });
}

function apply() {
  words = state.q.toLowerCase().split(/\s+/).filter(Boolean);
  list = [];
  for (let i = 0; i < D.name.length; i++) if (matches(i)) list.push(i);
  const filtered = list.slice();
  list = sorted(list);
  shownRows = PAGE;
  tiles();
  rows();
  later(() => { charts(filtered.filter((i) => D.href[i])); root.dataset.drawn = String(list.length); });
  keep();
}

let waiting;
function later(what) { clearTimeout(waiting); waiting = setTimeout(what, 0); }

function tiles() {
  const count = (level) => { let n = 0; for (let i = 0; i < D.name.length; i++) if (isIn(i, level)) n++; return n; };
  if (!$('tiles').children.length) {
    for (const [level, text] of [['', 'logs'], ...Object.entries(D.levels), ['gates', 'failed a gate'], ['set', 'with a setting to change']]) {
      const n = count(level);
      if (!n && !ALWAYS.includes(level)) continue;
      const tile = el('button', { type: 'button', class: 'tile ' + (n ? level : 'zero'), 'data-level': level }, el('b', {}, n.toLocaleString('en')), el('span', {}, n === 1 && !level ? 'log' : text));
      tile.addEventListener('click', () => { state.level = state.level === level ? '' : level; apply(); });
      $('tiles').append(tile);
    }
  }
  for (const tile of $('tiles').children) tile.setAttribute('aria-pressed', String(tile.dataset.level === state.level));
}

function head() {
  const numbers = inTable();
  const columns = [['log', 'Log'], ['why', 'What happened'], ['flight', 'Flight'], ['date', 'Date'], ['air', 'In the air'], ...numbers.map((c) => [c.title, c.title, c.sign])];
  const cells = columns.map(([key, text, sign]) => {
    const number = sign !== undefined || key === 'air';
    if (key === 'why' || key === 'flight') return el('th', { scope: 'col', role: 'columnheader' }, text);
    const by = key === 'log' ? 'name' : key, now = state.sort === by;
    const button = el('button', { type: 'button' }, el('span', {}, sign ? text + ', ' + sign : text));
    button.addEventListener('click', () => {
      const first = number || key === 'date' ? '1' : '';  // the largest, the latest
      if (state.sort !== by) { state.sort = by; state.down = first; } else if (state.down === first) state.down = first ? '' : '1'; else { state.sort = ''; state.down = ''; }
      apply();
      const again = [...$('table').tHead.querySelectorAll('button')].find((b) => b.textContent === button.textContent);
      if (again) again.focus();
    });
    return el('th', { scope: 'col', role: 'columnheader', class: number ? 'n' : null, 'aria-sort': now ? (state.down ? 'descending' : 'ascending') : 'none' }, button);
  });
  $('table').tHead.replaceChildren(el('tr', { role: 'row' }, ...cells));
}

function rows() {
  head();
  const body = $('table').tBodies[0];
  body.replaceChildren();
  append(0, Math.min(shownRows, list.length));
  const all = D.name.length, n = list.length;
  $('h-logs').textContent = state.sort ? 'Logs' : 'Logs, worst first';
  $('count').textContent = n === all ? '' : n.toLocaleString('en') + ' of ' + counted(all, 'log');
  $('table').setAttribute('aria-rowcount', n + 1);
  if (!n) body.append(el('tr', { role: 'row' }, el('td', { role: 'cell', colspan: 12 }, D.name.length ? 'No log matches. Clear the filters to see all.' : 'There is no log in this batch.')));
}

function append(from, to) {
  const numbers = inTable(), made = document.createDocumentFragment();
  const first = !state.sort && list.length === D.name.length && D.top < list.length ? D.top : 0;
  for (let k = from; k < to; k++) {
    if (first && k === 0) made.append(divider('Open first'));
    if (first && k === first) made.append(divider('All others'));
    made.append(line(list[k], k, numbers)); if (opened.has(list[k])) made.append(details(list[k]));
  }
  $('table').tBodies[0].append(made);
  shownRows = to;
  const left = list.length - to;
  $('more').hidden = left <= 0;
  $('more').textContent = 'Show ' + Math.min(STEP, left).toLocaleString('en') + ' more of ' + left.toLocaleString('en');
}

const divider = (text) => el('tr', { role: 'row', class: 'divider' }, el('td', { role: 'cell', colspan: 12 }, text));

function line(i, k, numbers) {
  const level = LEVELS[D.level[i]], text = D.text[i] || 'It could not be analysed.';
  const title = D.short[i] === D.name[i] ? null : D.name[i];
  const name = el(D.href[i] ? 'a' : 'b', { href: D.href[i] || null, title }, ...D.short[i].split(/(?<=[_.-])/).flatMap((word) => [word, el('wbr')]));
  const why = D.reasons[i].find((r) => D.kinds[r[0]] !== 'crash' && r[1] !== text);  // the headline tells a crash
  const open = el('button', { type: 'button', class: 'open', 'aria-expanded': String(opened.has(i)) }, 'Details', el('span', { class: 'vh' }, ' of ' + D.name[i]));
  open.addEventListener('click', () => {
    const row = open.closest('tr');
    if (opened.delete(i)) row.nextElementSibling.remove(); else { opened.add(i); row.after(details(i)); }
    open.setAttribute('aria-expanded', String(opened.has(i)));
  });
  return el('tr', { role: 'row', 'aria-rowindex': k + 2, 'data-log': i },
    el('th', { scope: 'row', role: 'rowheader' }, name, el('small', {}, folder(D.log[i]).slice(above.length)), open),
    el('td', { role: 'cell', class: 'why' }, el('span', { class: 'clamp' }, el('span', { class: 'chip ' + level }, SAID[level]), text), why ? el('small', {}, why[1]) : ''),
    el('td', { role: 'cell' }, thumbnail(i)),
    el('td', { role: 'cell', class: 'd' }, day(D.date[i])),
    el('td', { role: 'cell', class: 'n', 'data-title': 'In the air' }, D.air[i] === 0 ? '0 s' : duration(D.air[i])),
    ...numbers.map((c) => el('td', { role: 'cell', class: 'n', 'data-title': c.title }, number(c.values[state.row][i], c.unit))));
}

// where a log lies, without its name, which stands above, and without the folder that all logs share
let above = '';
function shared() {
  above = D.log.length > 1 ? folder(D.log[0]) + '/' : folder(D.log[0] || '');
  for (const log of D.log) while (above && !(folder(log) + '/').startsWith(above)) above = above.slice(0, above.lastIndexOf('/', above.length - 2) + 1);
}
function folder(log) { const at = Math.max(log.lastIndexOf('/'), log.lastIndexOf('\\')); return at > 0 ? log.slice(0, at) : ''; }

function details(i) {
  const said = D.reasons[i].map(([k, text, t]) => el('li', {}, el('b', {}, KIND[D.kinds[k]] + ': '), text, t !== null && !text.includes(' ' + t + ' s') ? ' (at ' + clockTime(t) + ')' : ''));
  const facts = [['Log', D.log[i]], ['Recorded', [minute(D.date[i]), duration(D.seconds[i]) + ' long'].filter(Boolean).join(', ')], ['Vehicle', [D.vehicle.words[D.vehicle.at[i]], D.firmware.words[D.firmware.at[i]]].filter(Boolean).join(', ')], ['Board', D.board.words[D.board.at[i]]],
    ['Compared with', { truth: 'the logged truth', smoother: 'the smoother', onboard: 'the onboard attitude (agreement, not truth)', none: 'nothing' }[D.reference.words[D.reference.at[i]]]],
    ['Sensors', sensors(i)], ['To set', toSet(i).join(', ')],
    ...D.says[i].map((s, k) => [QUESTIONS[k], s])].filter(([, v]) => v);
  const parts = [];
  if (said.length) parts.push(el('ul', {}, ...said));
  if (D.href[i]) parts.push(el('p', {}, el('a', { href: D.href[i] }, 'Open the report')));
  parts.push(el('dl', {}, ...(D.href[i] ? facts : facts.slice(0, 1)).flatMap(([k, v]) => [el('dt', {}, k), el('dd', {}, v)])));
  return el('tr', { role: 'row', class: 'more' }, el('td', { role: 'cell', colspan: 12 }, ...parts));
}

function sensors(i) {
  const [faults, warnings] = D.sensors[i];
  return [faults ? counted(faults, 'fault') : '', warnings ? counted(warnings, 'warning') : ''].filter(Boolean).join(', ');
}

function charts(filtered) {
  const c = column(state.metric), values = c && c.values[state.row];
  const groups = state.by === 'level' ? { words: LEVELS.map((l) => SAID[l]), at: D.level } : D[state.by];
  $('h-spread').textContent = (c ? c.title + (D.rows[state.row] ? ', ' + D.rows[state.row] : '') + ', ' : '') + 'by ' + $('by').selectedOptions[0].text.toLowerCase();
  $('h-trend').textContent = c ? c.title + (D.rows[state.row] ? ', ' + D.rows[state.row] : '') + ', over date' : '';
  spread(filtered, c, values, groups);
  trend(filtered, c, values);
}

// the filters stand in the address, so that a view can be kept and sent
function keep() {
  const query = new URLSearchParams();
  for (const key in state) if (state[key] && state[key] !== DEFAULT[key]) query.set(key, state[key]);
  const text = query.toString();
  try { history.replaceState(null, '', text ? '#' + text : location.pathname + location.search); } catch { /* an address that may not change: the view is not kept */ }
}
const DEFAULT = {};

function selects() {
  const words = (coded) => coded.words.map((w) => [w, w]);
  const present = D.kinds.filter((_, k) => D.reasons.some((list) => list.some((r) => r[0] === k)));
  options($('kind'), [['', 'any'], ...present.map((k) => [k, KIND[k] + ' (' + D.name.filter((_, i) => hasKind(i, D.kinds.indexOf(k))).length.toLocaleString('en') + ')'])], state.kind);
  options($('firmware'), [['', 'any'], ...words(D.firmware)], state.firmware);
  options($('vehicle'), [['', 'any'], ...words(D.vehicle)], state.vehicle);
  options($('row'), Object.entries(D.rows), state.row);
  options($('metric'), D.columns.filter((c) => c.values[state.row]).map((c) => [c.title, c.title]), state.metric);
  options($('by'), [['firmware', 'Firmware'], ['vehicle', 'Vehicle'], ['board', 'Board'], ['reference', 'Compared with'], ['level', 'Trouble']], state.by);
  $('q').value = state.q;
  $('row').parentNode.hidden = $('metric').parentNode.hidden = !D.columns.length;
}

function listen() {
  let typing;
  $('q').addEventListener('input', () => { clearTimeout(typing); typing = setTimeout(() => { state.q = $('q').value; apply(); }, 60); });
  for (const id of ['kind', 'firmware', 'vehicle', 'by', 'metric']) $(id).addEventListener('change', () => { state[id] = $(id).value; apply(); });
  $('row').addEventListener('change', () => { state.row = $('row').value; settle(); selects(); apply(); });
  $('filters').addEventListener('submit', (event) => event.preventDefault());
  if (state.kind || state.firmware || state.vehicle) $('fold').setAttribute('aria-expanded', 'true');
  $('fold').addEventListener('click', () => $('fold').setAttribute('aria-expanded', String($('fold').getAttribute('aria-expanded') === 'false')));
  $('clear').addEventListener('click', () => { Object.assign(state, DEFAULT); settle(); selects(); apply(); $('q').focus(); });
  $('more').addEventListener('click', () => { const k = shownRows; append(k, Math.min(k + STEP, list.length)); const row = $('table').tBodies[0].querySelector('[aria-rowindex="' + (k + 2) + '"] .open'); if (row) row.focus({ preventScroll: true }); });
  $('trend').addEventListener('pointermove', (event) => {
    const p = nearest(event), ring = $('trend').querySelector('.here'), c = column(state.metric);
    if (!ring) return;
    ring.setAttribute('cx', p ? p[0] : -20); ring.setAttribute('cy', p ? p[1] : -20);
    $('near').textContent = p ? D.name[p[2]] + ', ' + day(D.date[p[2]]) + ': ' + withUnit(c.values[state.row][p[2]], c) : '';
  });
  $('trend').addEventListener('click', (event) => { const p = nearest(event); if (p) find(p[2]); });
}

// shows one log: its row, opened, wherever it stands in the list
function find(i) {
  opened.add(i);
  if (list.indexOf(i) < 0) { Object.assign(state, DEFAULT); settle(); selects(); apply(); }
  const k = list.indexOf(i);
  rows();
  append(shownRows, Math.max(shownRows, Math.min(k + 10, list.length)));
  const row = $('table').querySelector('[data-log="' + i + '"]');
  row.scrollIntoView({ block: 'center' });
  row.querySelector('.open').focus({ preventScroll: true });
}

// a row or number that is not there gives way to the first that is
function settle() {
  if (!(state.row in D.rows)) state.row = D.first;
  if (!column(state.metric) || !column(state.metric).values[state.row]) state.metric = (D.columns.find((c) => c.values[state.row]) || { title: '' }).title;
  if (!['firmware', 'vehicle', 'board', 'reference', 'level'].includes(state.by)) state.by = 'firmware';
  if (state.sort && !KEYS[state.sort] && !column(state.sort)) state.sort = state.down = '';
}

function themes() {
  const button = $('theme'), say = () => { button.textContent = isDark() ? 'Light' : 'Dark'; };
  button.hidden = false;
  button.addEventListener('click', () => { root.dataset.theme = isDark() ? 'light' : 'dark'; say(); });
  wantsDark.addEventListener('change', say);
  say();
}

async function start() {
  themes();
  if (!('DecompressionStream' in window)) throw new Error('this browser is too old (it lacks DecompressionStream)');
  await startData();
  LEVELS = Object.keys(D.levels);
  state.row = D.first;
  settle();
  Object.assign(DEFAULT, state);
  for (const [key, value] of new URLSearchParams(location.hash.slice(1))) if (key in state) state[key] = value;
  settle();
  hay = D.name.map((_, i) => [D.name[i], D.log[i], D.text[i], D.message[i], D.firmware.words[D.firmware.at[i]], D.vehicle.words[D.vehicle.at[i]], D.board.words[D.board.at[i]], day(D.date[i]), ...D.reasons[i].map((r) => KIND[D.kinds[r[0]]] + ' ' + r[1])].join(' ').toLowerCase());
  $('key').hidden = !D.thumb.some(Boolean);
  shared(); selects(); listen();
  $('filters').hidden = $('numbers').hidden = !D.name.length;
  apply();
}
start().catch((error) => { $('problem').hidden = false; $('problem').textContent = 'This page could not be shown: ' + error.message + '.'; root.dataset.drawn = 'failed'; throw error; });
