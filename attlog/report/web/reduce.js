// Smallest and largest value per two pixel columns, again at every zoom; gaps and wraps break the line.
let stored = 0, drawn = 0;
const at = (t, x) => {
  let a = 0, b = t.length;
  while (a < b) { const m = (a + b) >> 1; if (t[m] < x) a = m + 1; else b = m; }
  return a;
};

function reduced(t, y, range, pixels, wraps) {
  const from = range ? Math.max(at(t, range[0]) - 1, 0) : 0;
  const to = range ? Math.min(at(t, range[1]) + 1, t.length) : t.length;
  const X = [], Y = [], n = Math.max(Math.round(pixels / 2), 50);
  const put = (i) => {
    const last = Y.length - 1;
    if (wraps && last >= 0 && Y[last] !== null && Math.abs(Y[last] - y[i]) > 180) { X.push(t[i]); Y.push(null); }
    X.push(t[i]);
    Y.push(Number.isNaN(y[i]) ? null : y[i]);
  };
  stored += to - from;
  if (to - from <= 2 * n) for (let i = from; i < to; i++) put(i);
  else for (let c = 0, step = (to - from) / n; c < n; c++) {
    const i0 = from + Math.floor(c * step), i1 = from + Math.floor((c + 1) * step);
    let low = -1, high = -1, hole = -1;
    for (let i = i0; i < i1; i++) {
      if (Number.isNaN(y[i])) { hole = i; continue; }
      if (low < 0 || y[i] < y[low]) low = i;
      if (high < 0 || y[i] > y[high]) high = i;
    }
    for (const i of [...new Set([low, high, hole])].filter((i) => i >= 0).sort((a, b) => a - b)) put(i);
  }
  drawn += X.length;
  return [X, Y];
}

// Middle and band of smallest to largest value per three pixel columns, for ranges in which nobody can see steps.
function enveloped(t, y, range, pixels, wraps) {
  const from = Math.max(at(t, range[0]) - 1, 0), to = Math.min(at(t, range[1]) + 1, t.length), n = Math.max(Math.round(pixels / 3), 50);
  const X = [], Y = [], bandX = [], bandY = [];
  let part = [];
  const close = () => {
    for (const [x, low] of part) { bandX.push(x); bandY.push(low); }
    for (const [x, , high] of part.reverse()) { bandX.push(x); bandY.push(high); }
    if (part.length) { bandX.push(null); bandY.push(null); X.push(part[0][0]); Y.push(null); }
    part = [];
  };
  stored += to - from;
  for (let c = 0, step = (to - from) / n; c < n && step > 0; c++) {
    const i0 = from + Math.floor(c * step), i1 = Math.max(from + Math.floor((c + 1) * step), i0 + 1);
    let low = Infinity, high = -Infinity, sum = 0, count = 0;
    for (let i = i0; i < i1 && i < to; i++) {
      if (Number.isNaN(y[i])) continue;
      if (y[i] < low) low = y[i];
      if (y[i] > high) high = y[i];
      sum += y[i]; count++;
    }
    if (!count || (wraps && high - low > 180)) { close(); continue; }
    const x = t[i0], middle = sum / count;
    if (wraps && part.length && Math.abs(Y[Y.length - 1] - middle) > 180) close();
    part.push([x, low, high]); X.push(x); Y.push(middle);
  }
  close();
  drawn += X.length + bandX.length;
  return { X, Y, bandX, bandY };
}

// the range of visible values with a margin, from what is drawn; a diverged filter may leave the figure, and in a
// calm one also those that move CALM times as far as the middle one; `from` and `to` leave out what comes before and
// after them, if anything stays
const CALM = 8;
function fitted(traces, axis, least, calm, from, to) {
  let low = Infinity, high = -Infinity;
  const here = traces.filter((t) => t.visible !== false && (t.yaxis || 'y') === axis), sound = here.filter((t) => t.meta == null || !D.rows[t.meta].lost);
  const travel = (t) => t.y.reduce((m, v) => (v === null ? m : [Math.min(m[0], v), Math.max(m[1], v)]), [Infinity, -Infinity]).reduce((a, b) => b - a);
  const far = calm ? CALM * sound.map(travel).sort((a, b) => a - b)[sound.length >> 1] : Infinity;
  const late = from !== undefined && here.some((t) => t.x[t.x.length - 1] > from) ? from : -Infinity;
  const early = to !== null && to !== undefined && here.some((t) => t.x[0] < to) ? to : Infinity;
  for (const t of sound.length ? sound.filter((t) => travel(t) <= far) : here)
    t.y.forEach((v, i) => { if (v !== null && v !== undefined && t.x[i] >= late && t.x[i] <= early) { if (v < low) low = v; if (v > high) high = v; } });
  if (!(low <= high)) return [-least, least];
  const pad = Math.max((high - low) * 0.06, (least - (high - low)) / 2, 1e-6);
  return [low - pad, high + pad];
}
