// The page: draws figures when they come near, links zoom, legend, table, theme, print.
const choices = [];
let event = 0, full = [0, 1], range = [0, 1], busy = false;
const waiting = new Set(), failures = [];
const ids = () => Object.keys(D.figures);
const timed = (id) => TIMED.includes(D.figures[id].kind);

function draw(id) {
  waiting.delete(id);
  const f = D.figures[id];
  stored = drawn = 0;
  try {
    const p = draws[f.kind](id, f, range);
    Plotly.react($(id), p.traces, p.layout, CONFIG);
  } catch (error) {
    failures.push(id);
    $(id).textContent = 'This figure could not be drawn.';
    throw error;
  }
  if (f.kind === 'attitude') $('ratio').textContent = 'The attitude figure now draws ' + drawn.toLocaleString('en') + ' of ' + stored.toLocaleString('en') + ' points.';
  if ($(id).dataset.ready) return;
  $(id).dataset.ready = '1';
  if (timed(id)) {
    $(id).on('plotly_relayout', (e) => { if (!busy && 'xaxis.range[0]' in e) zoom([+e['xaxis.range[0]'], +e['xaxis.range[1]']]); });
    $(id).on('plotly_doubleclick', () => { zoom(full); return false; });
  } else $(id).on('plotly_doubleclick', () => { draw(id); return false; });
}

function zoom(to) {
  range = to[1] - to[0] > 1e-4 ? [Math.max(to[0], full[0]), Math.min(to[1], full[1])] : full;
  redraw(timed);
}

function redraw(which) {
  busy = true;
  for (const id of ids()) if (!waiting.has(id) && (!which || which(id))) draw(id);
  busy = false;
}

// hidden rows vanish from every figure; those not drawn yet know it when they are
function toggled() {
  document.querySelectorAll('.lg input').forEach((box) => { const r = +box.dataset.row; if (box.checked) hidden.delete(r); else hidden.add(r); });
  busy = true;
  for (const id of ids()) if (!waiting.has(id)) {
    if (REFIT.includes(D.figures[id].kind)) draw(id);
    else Plotly.restyle($(id), { visible: $(id).data.map((t) => t.meta == null || !hidden.has(t.meta)) });
  }
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
  $('reset').addEventListener('click', () => zoom(full));
  document.querySelector('.legend').hidden = false;
}

function movements() {
  const f = D.figures.step;
  if (!f) return;
  const select = $('event'), count = {};
  const offer = (text) => { const option = document.createElement('option'); option.value = select.length; option.textContent = text; select.append(option); };
  for (const axis of new Set(f.events.map((e) => e.axis))) {
    offer('all in ' + axis);
    choices.push(f.events.filter((e) => e.axis === axis));
  }
  for (const e of f.events) {
    count[e.axis] = (count[e.axis] || 0) + 1;
    offer(e.axis + ' ' + (e.at ? 'at ' + e.at.replace(/s$/, '') + ' s' : count[e.axis]));
    choices.push([e]);
  }
  const go = (i) => { event = (i + choices.length) % choices.length; select.value = event; draw('step'); };
  select.addEventListener('change', () => go(+select.value));
  $('event-back').addEventListener('click', () => go(event - 1));
  $('event-next').addEventListener('click', () => go(event + 1));
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
  button.hidden = $('print').hidden = false;
  button.addEventListener('click', () => { root.dataset.theme = isDark() ? 'light' : 'dark'; say(); if (D) redraw(); });
  wantsDark.addEventListener('change', () => { say(); if (D) redraw(); });
  $('print').addEventListener('click', () => window.print());
  say();
}

function printed() {
  let theme, opened = [];
  addEventListener('beforeprint', () => {
    theme = root.dataset.theme; printing = true; root.dataset.theme = 'light';
    opened = [...document.querySelectorAll('details:not([open]):not(.noprint)')];
    opened.forEach((d) => { d.open = true; });
    waiting.clear();
    redraw();
  });
  addEventListener('afterprint', () => {
    printing = false;
    if (theme) root.dataset.theme = theme; else delete root.dataset.theme;
    opened.forEach((d) => { d.open = false; });
    redraw();
  });
}

// a time in a list or a problem shows its surroundings in the figures
function jumps() {
  document.querySelectorAll('a[data-t]').forEach((link) => link.addEventListener('click', () => {
    const t = +link.dataset.t, around = Math.max(5, (full[1] - full[0]) / 60);
    zoom([t - around, t + around]);
  }));
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
    link.download = 'attlog-result.json';
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

// figures in view first, those near when they come near, the rest when nothing else is to be done
async function drawAll() {
  for (const id of ids()) { $(id).style.height = $(id).dataset.height + 'px'; waiting.add(id); }
  const watch = new IntersectionObserver((seen) => {
    for (const s of seen) if (s.isIntersecting && waiting.has(s.target.id)) { watch.unobserve(s.target); draw(s.target.id); }
  }, { rootMargin: '600px' });
  ids().forEach((id) => watch.observe($(id)));
  await idle();
  for (const id of ids()) { if (waiting.has(id)) { await idle(); if (waiting.has(id)) draw(id); } }
  watch.disconnect();
  root.dataset.drawn = failures.length ? 'failed ' + failures.join(' ') : 'all';
}

async function start() {
  themes();
  document.querySelectorAll('#table').forEach(sortable);
  if (!('DecompressionStream' in window)) throw new Error('this browser is too old (it lacks DecompressionStream)');
  await startData();
  full = D.marks.range; range = full;
  legend(); movements(); copies();
  await startPlotly();
  if (!window.Plotly) throw new Error('plotly.js could not be loaded; it has to lie beside this file');
  printed(); resized(); jumps();
  await drawAll();
}
start().catch((error) => { $('failed').hidden = false; $('failed').textContent = 'Figures are missing: ' + error.message + '. Verdicts, tables and everything below do not need them.'; root.dataset.drawn = 'failed'; throw error; });
