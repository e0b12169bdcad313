// Figures of the sensors themselves: what they draw has no row, so the legend does not hide it.
const FAR = 0.985;
const AXES = ['x', 'y', 'z'];
const ofAxis = (k) => css('--a' + k);

// texts in the colours of their lines, in place of a legend
function letters(id, names, colours) {
  const size = 12, inside = width(id) - (narrow(id) ? 58 : 78);
  let x = 0;
  return names.map((text, i) => {
    const own = { x: x / inside, y: 1, xref: 'paper', yref: 'paper', xanchor: 'left', yanchor: 'bottom', text: safe(text), showarrow: false, font: { size, color: colours[i] } };
    x += (0.56 * text.length + 1.2) * size;
    return own;
  });
}

const axisLetters = (id) => letters(id, AXES, AXES.map(ofAxis));
const level = (y, color, dash) => ({ type: 'line', xref: 'paper', yref: 'y', x0: 0, x1: 1, y0: y, y1: y, line: { color, width: 1.3, dash } });
const beside = (y, text, color, right, below) => ({ x: right ? 1 : 0, y, xref: 'paper', yref: 'y', xanchor: right ? 'right' : 'left', yanchor: below ? 'top' : 'bottom', text, showarrow: false, font: { size: 12, color } });
const visibleIn = (t, y, range) => Array.from(y).filter((v, i) => Number.isFinite(v) && t[i] >= range[0] && t[i] <= range[1]);
const share = (all, p) => all.slice().sort((a, b) => a - b)[Math.min(Math.floor(p * all.length), all.length - 1)];
const beyond = (text, color, t, y, top, more) => plain(text, color, t.filter((_, i) => y[i] > top), t.filter((_, i) => y[i] > top).map(() => top), Object.assign({ mode: 'markers', arrow: true, hoverinfo: 'skip', say: undefined, cliponaxis: false, marker: { symbol: 'triangle-up', size: 8, color } }, more || {}));

Object.assign(draws, {
  compass(id, f, range) {
    const L = layout(id), traces = [], t = Array.from(times(f.t)), names = [...AXES, 'size'], gap = 0.035, height = (1 - gap * 3) / 4;
    const part = (prefix) => {
      if (!f.y[prefix + 'x']) return null;
      const axes = AXES.map((k) => gaps(values(f.y[prefix + k])));
      return [...axes, axes[0].map((x, i) => (x === null ? null : Math.hypot(x, axes[1][i], axes[2][i])))];
    };
    const drawn = [['expected', part('expected_'), 'dash', 1.6], ['measured', part(''), 'solid', 1.5], ['corrected', part('corrected_'), 'dot', 1.8]].filter((d) => d[1]);
    names.forEach((k, i) => {
      const yaxis = i ? 'y' + (i + 1) : 'y', own = i < 3 ? ofAxis(k) : css('--mu');
      for (const [what, columns, dash, w] of drawn) traces.push(plain(k + ' ' + what, what === 'expected' ? css('--tx') : own, t, columns[i], { yaxis, line: { color: what === 'expected' ? css('--tx') : own, width: w, dash }, say: ' µT', unit: 'uT', digits: 1 }));
      const here = drawn.flatMap((d) => visibleIn(t, d[1][i].map((v) => (v === null ? NaN : v)), range)), low = share(here, 0.003), high = share(here, 0.997), pad = Math.max(0.1 * (high - low), 1);
      const top = 1 - i * (height + gap);
      L['yaxis' + (i ? i + 1 : '')] = axis(k + ', µT', { domain: [Math.max(top - height, 0), top], nticks: 5, zeroline: true, range: here.length ? [low - pad, high + pad] : [-1, 1] });
    });
    L.xaxis = axis('time, s', { range: range.slice(), anchor: 'y4' });
    phases(L, true);
    return { traces, layout: L };
  },
  interference(id, f) {
    const L = layout(id, { hovermode: 'closest' }), tint = css('--ac'), ends = [Math.min(...f.x), Math.max(...f.x)], sign = f.unit === '%' ? ' %' : ' ' + f.unit;
    const first = 'drive_' + (f.unit === '%' ? 'pct' : f.unit.toLowerCase());
    const traces = [
      plain('residual', tint, f.x, f.y, { mode: 'markers', marker: { size: 4, color: tint, opacity: 0.45 }, say: ' µT', digits: 1, at: sign, unit: 'uT', first }),
      plain('line', css('--tx'), ends, ends.map((x) => f.line[0] + f.line[1] * x), { line: { color: css('--tx'), width: 2 }, say: ' µT', digits: 1, at: sign, unit: 'uT', first }),
    ];
    const all = [...f.y, ...traces[1].y], low = share(all, 0.005), high = share(all, 0.995), pad = Math.max(0.1 * (high - low), 0.5);
    L.xaxis = axis(f.label, { zeroline: false });
    L.yaxis = axis('size less the earth’s, µT', { range: [low - pad, high + pad] });
    return { traces, layout: L };
  },
  spectrum(id, f) {
    const L = layout(id), all = Object.values(f.axes).flat();
    const traces = Object.entries(f.axes).map(([k, y]) => plain(k, ofAxis(k), f.x, y, { say: ' ' + f.unit, digits: 4, at: ' Hz', unit: f.unit, first: 'frequency_hz' }));
    const top = Math.log10(Math.max(...all)), floor = Math.log10(all.filter((v) => v > 0).sort((a, b) => a - b)[Math.floor(all.length / 100)] || 1e-6);
    L.yaxis = axis(f.unit, Object.assign({ type: 'log' }, decades(all, 8)));
    L.yaxis.range = [Math.max(floor, top - 5) - 0.1, top + 0.3];
    L.xaxis = axis('frequency, Hz', Object.assign({ type: 'log', range: [Math.log10(f.x[0]), Math.log10(f.nyquist * 1.12)] }, decades(f.x, narrow(id) ? 6 : 10)));
    bands(L, f, traces);
    L.shapes.push({ type: 'line', xref: 'x', yref: 'paper', x0: f.nyquist, x1: f.nyquist, y0: 0, y1: 1, line: { color: css('--bad'), width: 1.2, dash: 'dash' } });
    L.annotations.push(note(Math.log10(f.nyquist), 'half of ' + (2 * f.nyquist).toFixed(0) + ' Hz', { xanchor: 'right' }), ...axisLetters(id));
    L.margin.l += 10;
    return { traces, layout: L };
  },
  vibration(id, f, range) {
    const L = layout(id);
    L.xaxis = axis('time, s', { range: range.slice() });
    const p = f.level ? levels(L, f, range) : deviations(L, id, f, range), top = L.yaxis.range[1];
    if (f.clipped.length) p.traces.push(plain('clipped', css('--bad'), f.clipped.map((c) => c[0]), f.clipped.map(() => 0.97 * top), {
      mode: 'markers', marker: { symbol: 'triangle-down', size: 9, color: css('--bad') }, hoverinfo: 'skip', say: undefined,
    }));
    phases(L, false);
    return p;
  },
  ratios(id, f, range) {
    const L = layout(id), colours = f.lines.map((l) => css('--e' + l.slot)), traces = [];
    const lines = f.lines.map((l) => [Array.from(times(l.t)), Array.from(values(l.y.ratio))]);
    const most = Math.max(0, ...lines.flatMap(([t, y]) => visibleIn(t, y, range))), top = Math.min(Math.max(1.15 * most, 1.25), HIGHEST_RATIO);
    lines.forEach(([t, y], i) => {
      traces.push(plain(safe(f.lines[i].aid), colours[i], t, y, { line: { color: colours[i], width: 1.3 }, digits: 2, unit: '1' }));
      if (most > top) traces.push(beyond('beyond', colours[i], t, y, top));
    });
    L.xaxis = axis('time, s', { range: range.slice() });
    L.yaxis = axis('share of the gate', { range: [0, top] });
    L.shapes.push(level(1, css('--bad'), 'dash'));
    L.annotations.push(...letters(id, f.lines.map((l) => l.aid), colours));
    phases(L, false);
    return { traces, layout: L };
  },
  size(id, f, range) {
    const L = layout(id), tint = css('--e1'), here = (y) => visibleIn(f.t, y, range), traces = [];
    if (f.throttle) traces.push(plain('throttle', css('--mu'), f.throttle[0], f.throttle[1], { yaxis: 'y2', line: { color: css('--edge'), width: 1 }, say: ' %', unit: '%', digits: 0 }));
    traces.push(plain('smallest', tint, f.t, f.low, { line: { width: 0 }, hoverinfo: 'skip', say: undefined, unit: f.unit }));
    traces.push(plain('largest', tint, f.t, f.high, { line: { width: 0 }, fill: 'tonexty', fillcolor: faded(tint, 0.25), hoverinfo: 'skip', say: undefined, unit: f.unit }));
    traces.push(plain('mean', tint, f.t, f.mean, { line: { color: tint, width: 1.6 }, say: ' ' + f.unit, unit: f.unit }));
    // a bump on landing leaves the figure: it is as high as FAR of all
    const wanted = f.expected === undefined ? [] : [f.expected];
    const low = Math.min(share(here(f.low), 1 - FAR), ...wanted), high = Math.max(share(here(f.high), FAR), ...wanted), pad = 0.15 * (high - low) || 1;
    if (f.high.some((v) => v > high + pad)) traces.push(beyond('beyond', tint, f.t, f.high, high + pad));
    if (wanted.length) L.shapes.push(level(f.expected, css('--tx'), 'dash'));
    L.xaxis = axis('time, s', { range: range.slice() });
    L.yaxis = axis(f.unit, { range: [low - pad, high + pad], zeroline: false });
    if (f.throttle) { L.yaxis2 = axis('throttle, %', { overlaying: 'y', side: 'right', range: [0, 100], showgrid: false, zeroline: false, tickvals: [0, 50, 100] }); L.margin.r += 40; }
    phases(L, false);
    return { traces, layout: L };
  },
});
const HIGHEST_RATIO = 4;

// the autopilot's own level with its percentiles, and the limits that are in sight
function levels(L, f, range) {
  const tint = css('--e1'), muted = css('--mu'), here = visibleIn(f.t, f.level, range), most = Math.max(0.1, ...here);
  const top = Math.max(1.15 * most, ...f.limits.slice(0, 1).map((v) => Math.min(1.1 * v, 6 * most)));
  L.yaxis = axis('m/s²', { range: [0, top] });
  for (const [what, v] of Object.entries(f.shares)) if (v <= top && what !== 'worst') { L.shapes.push(level(v, muted, 'dot')); L.annotations.push(beside(v, what + ' ' + v.toPrecision(3), muted, true, what === 'p50')); }
  f.limits.forEach((v, i) => { if (v <= top) { const color = css(i ? '--bad' : '--warn'); L.shapes.push(level(v, color, 'dash')); L.annotations.push(beside(v, 'limit ' + v, color)); } });
  return { traces: [plain('level', tint, f.t, f.level, { say: ' m/s²', unit: 'm/s^2', line: { color: tint, width: 1.6 } })], layout: L };
}

// the logged accelerometer's standard deviation, and where it was clipped
function deviations(L, id, f, range) {
  const traces = Object.entries(f.axes).map(([k, y]) => plain(k, ofAxis(k), f.t, y, { say: ' m/s²', unit: 'm/s^2' }));
  const top = Math.max(0.1, ...Object.values(f.axes).flatMap((y) => visibleIn(f.t, y, range)));
  L.yaxis = axis('m/s²', { range: [0, top * 1.08] });
  L.annotations.push(...axisLetters(id));
  return { traces, layout: L };
}

// rotors, notches, and hatched at the top what faster shaking folds back to
function bands(L, f, traces) {
  const box = (b, color, y0) => ({ type: 'rect', xref: 'x', yref: 'paper', x0: b.low, x1: Math.max(b.high, b.low * 1.01), y0, y1: 1, fillcolor: faded(color, 0.18), line: { color: faded(color, 0.6), width: 1 }, layer: 'below' });
  for (const b of f.rotor || []) L.shapes.push(box(b, css('--e9'), 0));
  for (const b of f.notches || []) L.shapes.push(box(b, css(b.key === 'proposed' ? '--e3' : '--e1'), 0));
  (f.rotor || []).forEach((b, i) => { if (b.f < f.nyquist) L.annotations.push(note(Math.log10(b.f), (i + 1) + '×', { y: 0.86, yanchor: 'bottom' })); });
  if (!(f.folded < f.nyquist)) return;
  const [low, high] = L.yaxis.range, edge = 10 ** (high - 0.05 * (high - low)), left = Math.max(f.folded, f.x[0]), none = { line: { width: 0 }, hoverinfo: 'skip', say: undefined };
  traces.unshift(
    plain('folded', css('--bad'), [left, f.nyquist], [edge, edge], none),
    plain('folded', css('--bad'), [left, f.nyquist], [10 ** high, 10 ** high], Object.assign({}, none, { fill: 'tonexty', fillcolor: 'rgba(0,0,0,0)', fillpattern: { shape: '/', fgcolor: css('--bad'), size: 6, solidity: 0.25, fillmode: 'overlay' } })),
  );
}
