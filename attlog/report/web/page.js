// The page: draws figures when they come near, links zoom, legend, table, theme, print.
const picked = {}, banded = {};
let full = [0, 1], home = [0, 1], range = [0, 1], busy = false;
const waiting = new Set(), failures = [];
const ids = () => Object.keys(D.figures);
const shownOf = (id) => Object.assign({}, D.figures[id], (D.figures[id].views || [])[picked[id] || 0]);
const timed = (id) => D.figures[id].timed, inTime = (id) => timed(id) || D.figures[id].follows;

function draw(id) {
  waiting.delete(id);
  const f = shownOf(id);
  focus = f.focus || null;
  stored = points = 0;
  try {
    $(id).style.height = tall(id) + 'px';
    const p = (draws[f.kind] || plotted)(id, f, range);
    Plotly.react($(id), p.traces, p.layout, CONFIG);
  } catch (error) {
    failures.push(id);
    $(id).textContent = 'This figure could not be drawn.';
    throw error;
  }
  if (id === 'attitude') $('ratio').textContent = 'The attitude figure now draws ' + points.toLocaleString('en') + ' of ' + stored.toLocaleString('en') + ' points.';
  if ($(id).dataset.ready) return;
  $(id).dataset.ready = '1';
  reachable(id);
  if (timed(id)) {
    $(id).on('plotly_relayout', (e) => { if (!busy && 'xaxis.range[0]' in e) zoom([+e['xaxis.range[0]'], +e['xaxis.range[1]']]); });
    $(id).on('plotly_doubleclick', () => { zoom(home); return false; });
  } else $(id).on('plotly_doubleclick', () => { draw(id); return false; });
}

function zoom(to) {
  const cut = [Math.max(to[0], full[0]), Math.min(to[1], full[1])];
  range = cut[1] - cut[0] > 1e-4 ? cut : full;
  redraw(inTime);
}

function redraw(which) {
  busy = true;
  for (const id of ids()) if (!waiting.has(id) && (!which || which(id))) draw(id);
  busy = false;
}

// hidden rows vanish from every figure; those not drawn yet know it when they are
function toggled() {
  // who asks for a filter wants to see it, in figures with a focus too
  for (const id of ids()) if (!picked[id] && (D.figures[id].views || []).some((v) => v.focus)) chosen(id, 1);
  document.querySelectorAll('.lg input').forEach((box) => { const r = +box.dataset.row; if (box.checked) hidden.delete(r); else hidden.add(r); });
  busy = true;
  for (const id of ids()) if (!waiting.has(id)) draw(id);
  busy = false;
}

function legend() {
  const boxes = [...document.querySelectorAll('.lg input')];
  boxes.forEach((box) => { box.checked = D.rows[+box.dataset.row].shown; if (!box.checked) hidden.add(+box.dataset.row); box.addEventListener('change', toggled); });
  document.querySelectorAll('.lg').forEach((label) => label.addEventListener('dblclick', (e) => {
    e.preventDefault();
    const one = label.querySelector('input');
    boxes.forEach((box) => { box.checked = box === one || D.rows[+box.dataset.row].onboard; });
    toggled();
  }));
  $('all').addEventListener('click', () => { boxes.forEach((box) => { box.checked = true; }); toggled(); });
  $('reset').addEventListener('click', () => { pointed = null; zoom(full); });
  const bar = document.querySelector('.legend'), below = () => { root.style.scrollPaddingTop = bar.offsetHeight + 10 + 'px'; };
  bar.hidden = false;
  below(); // what a link leads to must not lie under the bar
  addEventListener('resize', below);
}

// the view of a figure, and its select element
function chosen(id, view) {
  picked[id] = view;
  document.querySelector('select[data-figure=' + id + ']').value = view;
}

function selectors() {
  document.querySelectorAll('select[data-figure]').forEach((select) => {
    const id = select.dataset.figure;
    select.parentNode.hidden = false;
    select.addEventListener('change', () => { chosen(id, +select.value); if (!waiting.has(id)) draw(id); });
  });
  document.querySelectorAll('select[data-band]').forEach((select) => {
    const id = select.dataset.band;
    select.closest('p').hidden = false;
    select.value = D.figures[id].band;
    select.addEventListener('change', () => { banded[id] = +select.value; if (!waiting.has(id)) draw(id); });
  });
}

function sortable(table) {
  const body = table.tBodies[0], home = [...body.rows], heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => head.querySelector('button').addEventListener('click', () => {
    const down = head.getAttribute('aria-sort') === 'ascending';
    heads.forEach((h) => h.setAttribute('aria-sort', 'none'));
    head.setAttribute('aria-sort', down ? 'descending' : 'ascending');
    const key = (row) => (column ? (row.cells[column].dataset.s === '' ? null : +row.cells[column].dataset.s) : row.cells[0].textContent);
    home.slice().sort((a, b) => {
      const x = key(a), y = key(b);
      if (x === null || y === null) return (x === null) - (y === null);
      return (column ? x - y : x.localeCompare(y)) * (down ? -1 : 1);
    }).forEach((row) => body.append(row));
  }));
}

function themes() {
  const button = $('theme'), say = () => { button.textContent = isDark() ? 'Light' : 'Dark'; };
  button.hidden = false;
  button.addEventListener('click', () => { root.dataset.theme = isDark() ? 'light' : 'dark'; say(); if (D) redraw(); });
  wantsDark.addEventListener('change', () => { say(); if (D) redraw(); });
  document.querySelectorAll('button[data-print]').forEach((b) => { b.hidden = false; b.addEventListener('click', () => { root.dataset.print = b.dataset.print; window.print(); }); });
  say();
}

// A4 less its margins at 96 px per inch, and the smallest share of a figure that still shows its lines
const PAPER = [703, 1028], LEAST = 0.85;
// what sums up is laid out as it will be printed, measured, and made to fit one page: figures shrink first, then all
function onePage() {
  const rules = [...document.styleSheets].flatMap((s) => [...s.cssRules]).filter((r) => r.media && /^(print|\(max-width: ?900px\))$/.test(r.media.mediaText)), media = rules.map((r) => r.media.mediaText);
  const body = document.body, shown = ids().filter((id) => $(id).closest('.summary')), high = () => body.scrollHeight;
  rules.forEach((r) => { r.media.mediaText = 'all'; });
  Object.assign(body.style, { width: PAPER[0] + 'px', height: 'max-content' });
  const over = high() - PAPER[1], figures = Math.max(0, ...shown.map(tall));
  if (over > 0 && figures) {
    fits = Math.max(LEAST, 1 - over / figures);
    redraw((id) => shown.includes(id));
  }
  for (let i = 0, zoom = 1; i < 3 && zoom * high() > PAPER[1]; i++) {
    zoom *= PAPER[1] / (zoom * high());
    Object.assign(body.style, { zoom, width: PAPER[0] / zoom + 'px' });
  }
  Object.assign(body.style, { width: '', height: '' });
  rules.forEach((r, i) => { r.media.mediaText = media[i]; });
}

function printed() {
  let theme, opened = [];
  addEventListener('beforeprint', () => {
    theme = root.dataset.theme; printing = true; root.dataset.theme = 'light';
    const whole = !summed();
    opened = whole ? [...document.querySelectorAll('details.inprint:not([open])')] : [];
    opened.forEach((d) => { d.open = true; });
    waiting.clear();
    redraw(whole ? null : (id) => $(id).closest('.summary'));
    if (summed()) onePage();
  });
  addEventListener('afterprint', () => {
    printing = false;
    fits = 1;
    document.body.style.zoom = '';
    delete root.dataset.print;
    if (theme) root.dataset.theme = theme; else delete root.dataset.theme;
    opened.forEach((d) => { d.open = false; });
    redraw();
  });
}

// a finding, event or check shows the figure behind it around its time, which is shaded; folded places open
function jumps() {
  document.addEventListener('click', (e) => {
    const link = e.target.closest('a[href^="#"]');
    if (!link) return;
    const place = document.getElementById(link.hash.slice(1));
    if (place && place.tagName === 'DETAILS') place.open = true;
    const id = link.hash.slice(5);
    if (link.dataset.view !== undefined) {
      chosen(id, +link.dataset.view);
      if (!waiting.has(id)) draw(id);
    }
    if (link.dataset.t === undefined) {
      if (waiting.has(id)) draw(id);
      return;
    }
    const t = +link.dataset.t, end = Math.max(+(link.dataset.end || t), t), around = Math.max(5, (full[1] - full[0]) / 60, 0.5 * (end - t));
    pointed = [t, end];
    zoom([t - around, end + around]);
    if (waiting.has(id)) draw(id);
  });
}

function copies() {
  document.querySelectorAll('.copy').forEach((button) => button.addEventListener('click', () => {
    const chosen = document.createRange(), selection = getSelection();
    chosen.selectNodeContents($(button.dataset.copy));
    selection.removeAllRanges();
    selection.addRange(chosen);
    button.nextElementSibling.textContent = document.execCommand('copy') ? 'Copied' : 'Selected: press Ctrl+C';
  }));
  $('save').hidden = false;
  $('save').addEventListener('click', async () => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([await gunzip('result')], { type: 'application/json' }));
    link.download = (D.log || 'attlog') + '_result.json';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
}

function resized() {
  let timer, last = innerWidth;
  addEventListener('resize', () => {
    if (printing || innerWidth === last) return;
    last = innerWidth;
    clearTimeout(timer);
    timer = setTimeout(redraw, 150);
  });
}

const idle = () => new Promise((done) => setTimeout(done, 0));
const painted = () => new Promise((done) => { requestAnimationFrame(() => setTimeout(done, 0)); setTimeout(done, 300); });

// draws what waits and is near; a figure that fails does not keep the others from being drawn
const NEAR_PX = 600;
function near() {
  const places = [...waiting].map((id) => [id, $(id).getBoundingClientRect()]); // all before any is drawn: one layout
  for (const [id, at] of places) {
    if (at.height && at.bottom > -NEAR_PX && at.top < innerHeight + NEAR_PX) try { draw(id); } catch (error) { setTimeout(() => { throw error; }, 0); }
  }
}

// figures in view first, those near when they come near, the rest when nothing else is to be done; flight data near only
async function drawAll() {
  for (const id of ids()) { $(id).style.height = tall(id) + 'px'; waiting.add(id); }
  const watch = new IntersectionObserver((seen) => {
    if (seen.some((s) => s.isIntersecting)) near();
  }, { rootMargin: NEAR_PX + 'px' });
  ids().forEach((id) => watch.observe($(id)));
  // an observer reports changes alone: what a shift of the page moved in and out meanwhile is near without one
  addEventListener('scroll', near, { passive: true });
  await idle();
  for (const id of ids()) { if (waiting.has(id) && !D.figures[id].lazy) { await idle(); if (waiting.has(id)) draw(id); } }
  root.dataset.drawn = failures.length ? 'failed ' + failures.join(' ') : 'all';
}

async function start() {
  themes();
  document.querySelectorAll('#numbers, table.sortable').forEach(sortable);
  await painted();
  if (!('DecompressionStream' in window)) throw new Error('this browser is too old (it lacks DecompressionStream)');
  await startData();
  full = D.marks.range; home = range = D.marks.first || full;
  legend(); selectors(); copies(); parameters(); picker();
  await startPlotly();
  if (!window.Plotly) throw new Error('plotly.js could not be loaded; it has to lie beside this file');
  printed(); resized(); jumps(); exports();
  await drawAll();
}
start().catch((error) => { $('failed').hidden = false; $('failed').textContent = 'Figures are missing: ' + error.message + '. Verdicts, tables and everything below do not need them.'; root.dataset.drawn = 'failed'; throw error; });
