// Smallest and largest value per two pixel columns, again at every zoom; gaps and wraps break the line.
let stored = 0, points = 0;
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
  points += X.length;
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
  points += X.length + bandX.length;
  return { X, Y, bandX, bandY };
}

const share = (all, p) => all.slice().sort((a, b) => a - b)[Math.min(Math.floor(p * all.length), all.length - 1)];

// the range of an axis from what is drawn: diverged filters do not set it, in a calm one also not those that move CALM
// times as far as the middle one, nor what comes before `from` and after `to`, if anything stays
const CALM = 8;
function fitted(traces, key, fit, within) {
  const here = traces.filter((t) => t.visible !== false && !t.own.free && (t.yaxis || 'y') === key), sound = here.filter((t) => t.meta === null || !D.rows[t.meta].lost);
  const travel = (t) => t.y.reduce((m, v) => (v === null ? m : [Math.min(m[0], v), Math.max(m[1], v)]), [Infinity, -Infinity]).reduce((a, b) => b - a);
  const far = fit.calm ? CALM * sound.map(travel).sort((a, b) => a - b)[sound.length >> 1] : Infinity;
  const late = fit.from !== undefined && here.some((t) => t.x[t.x.length - 1] > fit.from) ? fit.from : -Infinity;
  const early = fit.to !== undefined && here.some((t) => t.x[0] < fit.to) ? fit.to : Infinity;
  const ends = [...(fit.include || [])], p = fit.share || 0;
  for (const t of sound.length ? sound.filter((t) => travel(t) <= far) : here) {
    const all = t.y.filter((v, i) => v !== null && t.x[i] >= late && t.x[i] <= early && (t.mode === 'lines' || !within || (t.x[i] >= within[0] && t.x[i] <= within[1])));
    if (p && all.length) ends.push(share(all, p), share(all, 1 - p));
    else if (all.length) { let low = Infinity, high = -Infinity; for (const v of all) { if (v < low) low = v; if (v > high) high = v; } ends.push(low, high); }
  }
  const least = fit.least || 0;
  if (!ends.length) return [-least || -1, least || 1];
  const low = Math.min(...ends), high = Math.max(...ends);
  if (fit.floor !== undefined) return [fit.floor, Math.min(Math.max(high + fit.pad * (high - fit.floor), least), fit.most || Infinity)];
  const pad = Math.max((fit.pad || 0.06) * (high - low), (least - (high - low)) / 2, fit.least_pad || 1e-6);
  return [low - pad, high + pad];
}
