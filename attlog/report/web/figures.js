// One function per kind of figure: its traces and its layout for a range of flight time.
const COMPASS = { 0: 'N', 90: 'E', 180: 'S', 270: 'W' };
const cutter = (cut) => (v) => v - 360 * Math.floor((v - cut) / 360);

const draws = {
  strip(id, f, range) {
    const M = D.marks, L = layout(id, { hovermode: 'closest', barmode: 'overlay' }), traces = [];
    const lane = (y, spans, fill, label, hover) => traces.push({
      type: 'bar', orientation: 'h', base: spans.map((s) => s[0]), x: spans.map((s) => s[1] - s[0]), y: spans.map(() => y), width: 0.76,
      marker: { color: fill, line: { color: css('--bg'), width: 1 } }, text: spans.map(label), textposition: 'inside', insidetextanchor: 'start',
      constraintext: 'none', cliponaxis: true, textfont: { size: 11.5, color: css('--tx') }, customdata: spans.map(hover), hovertemplate: '%{customdata}<extra></extra>', textangle: 0,
    });
    const names = [...new Set(M.modes.map((m) => m[2]))], tint = names.map((_, i) => css('--m' + (i % 4)));
    const pixels = (width(id) - L.margin.l - L.margin.r) / (range[1] - range[0]);
    const fits = (a, b, text) => ((Math.min(b, range[1]) - Math.max(a, range[0])) * pixels > 7 * text.length + 8 ? text : '');
    const start = (s) => [Math.max(s[0], range[0]), ...s.slice(1)];
    const inside = (spans) => spans.filter((s) => s[1] >= range[0] && s[0] <= range[1]).map(start);
    const modes = inside(M.modes);
    lane(2, modes, modes.map((m) => tint[names.indexOf(m[2])]), (m) => safe(fits(m[0], m[1], short(m[2], 24))), (m) => safe(short(m[2], 60)) + ' from ' + clock(m[0]) + ' to ' + clock(m[1]));
    lane(1, inside(M.armed), css('--armed'), () => '', (s) => 'armed, ' + clock(s[0]) + ' to ' + clock(s[1]));
    lane(1, inside(M.airborne), css('--air'), (s) => fits(s[0], s[1], 'in the air'), (s) => 'in the air, ' + clock(s[0]) + ' to ' + clock(s[1]));
    const colours = [css('--mu'), css('--warn'), css('--bad')];
    [0, 1, 2].forEach((level) => {
      const T = M.texts.filter((m) => m[1] === level && m[0] >= range[0] && m[0] <= range[1]);
      if (T.length) traces.push({
        type: 'scatter', mode: 'markers', x: T.map((m) => m[0]), y: T.map(() => 0), marker: { symbol: ['circle', 'triangle-up', 'x'][level], size: [6, 9, 9][level], color: colours[level] },
        customdata: T.map((m) => clock(m[0]) + ': ' + safe(short(m[2], 110))), hovertemplate: '%{customdata}<extra></extra>',
      });
    });
    L.xaxis = axis('', { range: range.slice(), showticklabels: false, zeroline: false });
    L.yaxis = axis('', { range: [-0.5, 2.5], tickvals: [0, 1, 2], ticktext: [narrow(id) ? 'texts' : 'messages', 'armed', 'mode'], fixedrange: true, zeroline: false, showgrid: false });
    L.margin.t = 18; L.margin.b = 6;
    alarms(L, range);
    return { traces, layout: L };
  },
  attitude(id, f, range) {
    const map = cutter(f.cut), ticks = [];
    for (let v = Math.ceil(f.cut / 90) * 90; v < f.cut + 360; v += 90) ticks.push(v);
    const text = ticks.map((v) => { const h = ((v % 360) + 360) % 360; return narrow(id) ? COMPASS[h] || h : (COMPASS[h] || '') + ' ' + h; });
    const p = panels(id, f, [['roll', 'roll, °', { least: 4, wraps: true }], ['pitch', 'pitch, °', { least: 4 }], ['heading', 'heading, °', { least: 10, wraps: true, map }]], { range, phases: 'named' });
    const [low, high] = p.layout.yaxis3.range;
    if (high - low > 150) Object.assign(p.layout.yaxis3, { tickvals: ticks, ticktext: text });
    else Object.assign(p.layout.yaxis3, numbered(low, high));
    alarms(p.layout, range);
    return p;
  },
  difference(id, f, range) {
    const p = panels(id, f, [['inclination', 'tilt, °', { axis: { rangemode: 'nonnegative' } }], ['roll', 'roll, °', { wraps: true }], ['pitch', 'pitch, °'], ['heading', 'heading, °', { wraps: true }]], { range, phases: 'named', from: f.scored });
    alarms(p.layout, range);
    return p;
  },
  bias(id, f, range) {
    return panels(id, f, ['x', 'y', 'z'].map((k) => [k, k + ', °/s', { least: 0.02 }]), { range, phases: 'plain', trace: { hovertemplate: '%{y:.3f} °/s' } });
  },
  rest(id, f) {
    const p = panels(id, f, [['roll', 'roll, °', { least: 0.002 }], ['pitch', 'pitch, °', { least: 0.002 }], ['heading', 'heading, °', { least: 0.002 }]], { range: f.range, calm: true, trace: { hovertemplate: '%{y:.4f}°', opacity: 0.85 } });
    for (const t of p.traces) t.line.width = 1.1;
    return p;
  },
  spread(id, f) {
    const L = layout(id), traces = f.shares.map((s) => trace(s.r, f.x, s.y, { line: Object.assign(line(s.r), { shape: 'hvh' }), hovertemplate: '%{y:.1f} %' }));
    L.xaxis = axis('angle, °', { hoverformat: '.4f' });
    L.yaxis = axis('share of samples, %', { rangemode: 'tozero' });
    return { traces, layout: L };
  },
  allan(id, f) {
    const L = layout(id), traces = [];
    for (const c of f.curves) traces.push(trace(c.r, c.tau, c.deviation, {
      customdata: c.low ? c.tau.map((_, i) => (c.low[i] === null ? '' : ' [' + c.low[i].toPrecision(2) + ' to ' + c.high[i].toPrecision(2) + ']')) : c.tau.map(() => ''),
      hovertemplate: '%{y:.2~r}°%{customdata}', name: name(c.r) + (c.key ? ' ' + safe(c.key) : ''),
    }));
    L.xaxis = axis('averaging time τ, s', Object.assign({ type: 'log', hoverformat: '.2~r' }, decades(f.curves.flatMap((c) => c.tau), narrow(id) ? 6 : 10)));
    L.yaxis = axis('Allan deviation, °', Object.assign({ type: 'log' }, decades(f.curves.flatMap((c) => c.deviation), 8)));
    L.margin.l += 10;
    return { traces, layout: L };
  },
  step(id, f) {
    const events = choices[event], single = events.length === 1, L = layout(id), traces = [], lines = new Map(), reference = [[], []], around = [-0.3, 1.2];
    const add = (r, key) => { const k = r + key; if (!lines.has(k)) lines.set(k, { r, key, x: [], y: [] }); return lines.get(k); };
    for (const e of events) {
      let best = null;
      for (const s of e.lines) {
        const t = times(s.t), est = values(s.y.est), ref = values(s.y.ref);
        const zero = onset(t, ref), top = ref.reduce((m, v, i) => (t[i] > 0 && t[i] < 1 && Math.abs(v - zero) > Math.abs(m) ? v - zero : m), 0), scale = single || !top ? 1 : 100 / top;
        if (!best || t.length < best[0].length) best = [t, ref.map((v) => v - zero), scale];
        const a = add(s.r, 'est'), d = add(s.r, 'off');
        for (let i = 0; i < t.length; i++) if (single || (t[i] >= around[0] && t[i] <= around[1])) { a.x.push(t[i] * 1e3); a.y.push((est[i] - zero) * scale); d.x.push(t[i] * 1e3); d.y.push((est[i] - ref[i]) * scale); }
        for (const l of [a, d]) { l.x.push(null); l.y.push(null); }
      }
      for (let i = 0; i < best[0].length; i++) if (single || (best[0][i] >= around[0] && best[0][i] <= around[1])) { reference[0].push(best[0][i] * 1e3); reference[1].push(best[1][i] * best[2]); }
      reference[0].push(null); reference[1].push(null);
    }
    const unit = single ? '°' : ' %', hover = single ? {} : { hoverinfo: 'skip', hovertemplate: undefined }, thin = single ? 1.8 : 0.8;
    for (const l of lines.values()) traces.push(trace(l.r, l.x, l.y, Object.assign({ yaxis: l.key === 'est' ? 'y' : 'y2', line: line(l.r, thin), hovertemplate: '%{y:.2f}' + unit }, hover)));
    traces.push(Object.assign({ type: 'scatter', mode: single && reference[0].length < 90 ? 'lines+markers' : 'lines', x: reference[0], y: reference[1], meta: null, name: 'reference', line: { color: css('--e0'), width: single ? 2.2 : 1.2 }, marker: { size: 5, color: css('--e0') }, hovertemplate: '%{y:.2f}' + unit }, hover));
    L.xaxis = axis('time from the start of the movement, ms', Object.assign({ anchor: 'y2', hoverformat: '.0f' }, single ? {} : { range: around.map((v) => v * 1e3) }));
    L.yaxis = axis(single ? safe(events[0].axis) + ' change, °' : safe(events[0].axis) + ', % of movement', { domain: [0.42, 1] });
    L.yaxis2 = axis(single ? 'minus reference, °' : 'minus reference, %', { domain: [0, 0.34], nticks: 5 });
    if (!single) {
      const shown = reference[1].filter((v) => v !== null && Number.isFinite(v));
      L.yaxis.range = [Math.max(Math.min(...shown), -100) - 30, Math.min(Math.max(...shown), 200) + 30];
      const [low, high] = fitted(traces, 'y2', 10, true);
      L.yaxis2.range = [Math.max(low, -60), Math.min(high, 60)];
    }
    return { traces, layout: L };
  },
  lag(id, f) {
    const p = dotted(id, f.rows, 'lag, ms (left: ahead, right: behind)', ' ms');
    if (f.half) { p.layout.shapes.push(band(-f.half, f.half, css('--arm'))); if (!narrow(id)) p.layout.annotations.push(note(0, '± half an IMU sample')); }
    f.rows.forEach((d) => {
      if (d.single.length && !hidden.has(d.r)) p.traces.unshift({ type: 'scatter', mode: 'markers', x: d.single, y: d.single.map((_, i) => p.place(d.r) + ((i * 7919) % 101) / 101 * 0.5 - 0.25), meta: d.r, visible: !hidden.has(d.r), marker: d.ok ? { size: 5, color: colour(d.r), opacity: 0.55 } : { size: 6, color: css('--bg'), line: { color: colour(d.r), width: 1.2 } }, hovertemplate: name(d.r) + ': %{x:.0f} ms<extra></extra>' });
    });
    return p;
  },
  drifts(id, f) { return dotted(id, f.rows, 'drift of the heading, °/min', ' °/min'); },
  drift(id, f) {
    const L = layout(id), traces = [];
    for (const s of ordered(f.series)) for (const [key, w, opacity] of [['heading', 1.1, 0.7], ['line', 2.6, 1]]) if (s.y[key]) {
      const [X, Y] = reduced(times(s.t), values(s.y[key]), null, width(id), false);
      traces.push(trace(s.r, X, Y, { line: line(s.r, w), opacity, hoverinfo: key === 'line' ? 'skip' : undefined, hovertemplate: key === 'line' ? undefined : '%{y:.2f}°' }));
    }
    L.xaxis = axis('time, s', { range: f.range, hoverformat: '.0f' });
    L.yaxis = axis('heading, °', { range: fitted(traces, 'y', 0.1) });
    return { traces, layout: L };
  },
  setpoint(id, f) {
    const L = layout(id), traces = [];
    for (const s of f.series) for (const key of Object.keys(s.y)) {
      traces.push(trace(s.r, Array.from(times(s.t), (v) => v * 1e3), Array.from(values(s.y[key])), { name: safe(key), hovertemplate: '%{y:.2f}', line: Object.assign(line(s.r), { dash: { roll: 'solid', pitch: 'dash', yaw: 'dot' }[key] || D.rows[s.r].dash }) }));
    }
    L.xaxis = axis('time after the command, ms');
    L.yaxis = axis('share of the command');
    return { traces, layout: L };
  },
  cost(id, f) {
    const L = layout(id, { hovermode: 'closest' }), x = f.points.map((p) => p.x), y = f.points.map((p) => p.y), least = Math.min(...y), most = Math.max(...y, 1e-6);
    const log = least > 0 && most / least > 8, bottom = log ? Math.log10(least) - 0.2 : 0, top = log ? Math.log10(most) + 0.2 : most * 1.1;
    const low = Math.log10(Math.min(...x)), high = Math.log10(Math.max(...x)), pad = Math.max(0.25, (high - low) * 0.12);
    const across = (width(id) - 80) / (high - low + 2 * pad), up = (v) => ((log ? Math.log10(v) : v) - bottom) / (top - bottom) * (L.height - 62), taken = [];
    const traces = f.points.map((p) => {
      const text = short(name(p.r), 22), left = (Math.log10(p.x) - low + pad) * across, height = up(p.y), w = text.length * 6.6;
      const boxes = { 'middle right': [left + 8, height - 8, w], 'middle left': [left - 8 - w, height - 8, w], 'top center': [left - w / 2, height + 8, w], 'bottom center': [left - w / 2, height - 24, w] };
      const free = (b) => b[0] > -10 && b[0] + w < width(id) - 80 && taken.every((o) => b[0] > o[0] + o[2] || o[0] > b[0] + w || Math.abs(b[1] - o[1]) > 15);
      const where = Object.keys(boxes).find((k) => free(boxes[k])) || 'middle right';
      taken.push(boxes[where], [left - 6, height - 8, 12]);
      return {
        type: 'scatter', mode: 'markers+text', x: [p.x], y: [p.y], text: [text], textposition: where, textfont: { size: 11.5, color: css('--tx') }, meta: p.r, visible: !hidden.has(p.r), cliponaxis: false,
        marker: { size: 11, color: colour(p.r), symbol: D.rows[p.r].dash === 'solid' ? 'circle' : 'diamond' }, hovertemplate: name(p.r) + ': %{x:.0f} ns, %{y:.2f}°<extra></extra>',
      };
    });
    L.xaxis = axis('cost, ns per sample', Object.assign({ type: 'log' }, decades(x, 8), { range: [low - pad, high + pad] }));
    L.yaxis = axis('tilt error, ° RMS', Object.assign(log ? { type: 'log' } : {}, log ? decades(y, 6) : {}, { range: [bottom, top] }));
    return { traces, layout: L };
  },
};
const SYMBOLS = { 'against truth': 'diamond', 'against smoother': 'diamond', 'against mag': 'square', 'against gnss_yaw': 'triangle-up', 'against course': 'triangle-down' };
const REFIT = ['lag', 'drifts', 'difference', 'rest', 'drift', 'cost'];
const TIMED = ['strip', 'attitude', 'difference', 'bias'];

// the reference's angle when the movement starts
function onset(t, ref) {
  const i = Math.min(at(t, 0), t.length - 1);
  return Number.isFinite(ref[i]) ? ref[i] : 0;
}

// failsafes and critical messages across a figure
function alarms(L, range) {
  const T = D.marks.texts.filter((m) => m[1] === 2 && m[0] >= range[0] && m[0] <= range[1]).slice(0, 60);
  for (const [t] of T) L.shapes.push(bar(t, css('--bad'), 'dash'));
}

// one line per row: a value with its interval, filled at rest, hollow in the air
function dotted(id, all, title, unit) {
  const dots = all.filter((d) => !hidden.has(d.r)), rows = [...new Set(dots.map((d) => d.r))], L = layout(id, { hovermode: 'closest' }), traces = [];
  const place = (r) => rows.length - 1 - rows.indexOf(r);
  const count = new Map();
  for (const d of dots.filter((d) => d.v !== null)) {
    const i = count.get(d.r) || 0, n = dots.filter((o) => o.r === d.r).length;
    count.set(d.r, i + 1);
    const y = place(d.r) + (n > 1 ? 0.28 - (0.56 * i) / (n - 1) : 0), full = !d.where || d.where === 'at rest' || d.where === 'against truth';
    traces.push({
      type: 'scatter', mode: 'markers', x: [d.v], y: [y], meta: d.r, visible: !hidden.has(d.r),
      error_x: d.ci ? { type: 'data', symmetric: false, array: [d.ci[1] - d.v], arrayminus: [d.v - d.ci[0]], color: colour(d.r), thickness: 2, width: 4 } : undefined,
      marker: { size: 9, symbol: SYMBOLS[d.where] || 'circle', color: full ? colour(d.r) : css('--bg'), line: { color: colour(d.r), width: 2 } },
      hovertemplate: name(d.r) + (d.where ? ', ' + safe(d.where) : '') + ': ' + minus(d.v.toFixed(2)) + unit + (d.ci ? ' [' + minus(d.ci[0].toFixed(2)) + ' to ' + minus(d.ci[1].toFixed(2)) + ']' : '') + '<extra></extra>',
    });
  }
  const longest = Math.max(1, ...rows.map((r) => Math.min(D.rows[r].name.length, 22)));
  L.margin.l = Math.min(24 + 6.6 * longest, width(id) * 0.42);
  L.xaxis = axis(title, { zerolinewidth: 2, range: spanOf(dots) });
  L.yaxis = axis('', { tickvals: rows.map((r) => place(r)), ticktext: rows.map((r) => short(name(r), 22)), range: [-0.6, rows.length - 0.4], fixedrange: true, zeroline: false });
  return { traces, layout: L, place };
}

// intervals far wider than the values may run out of the figure, values never
function spanOf(dots) {
  const all = dots.flatMap((d) => [...(d.v === null ? [] : [d.v]), ...(d.single || [])]), most = Math.max(1e-3, ...all.map(Math.abs));
  const ends = dots.flatMap((d) => (d.ci ? d.ci : [])).filter((v) => Math.abs(v) < 4 * most);
  const low = Math.min(0, ...all, ...ends), high = Math.max(0, ...all, ...ends), pad = (high - low) * 0.08;
  return [low - pad, high + pad];
}

// 1, 2, 5 of every decade as ticks of a log axis
function decades(all, most) {
  const good = all.filter((v) => v > 0);
  if (!good.length) return {};
  const low = Math.log10(Math.min(...good)), high = Math.log10(Math.max(...good)), ticks = [];
  for (let d = Math.floor(low); d <= high; d++) for (const m of high - low > 2 ? [1] : [1, 2, 5]) ticks.push(m * 10 ** d);
  const thin = ticks.length > 2 * most ? ticks.filter((_, i) => i % 2 === 0) : ticks;
  return { tickvals: thin, ticktext: thin.map((v) => String(+v.toPrecision(1))) };
}

// ticks of a heading axis with little range: numbers of the compass
function numbered(low, high) {
  const step = [1, 2, 5, 10, 20, 45].find((s) => (high - low) / s < 6) || 90, ticks = [];
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) ticks.push(v);
  return { tickvals: ticks, ticktext: ticks.map((v) => String(((v % 360) + 360) % 360)) };
}
