// One function per kind of figure: its traces and its layout for a range of flight time.
const COMPASS = { 0: 'N', 90: 'E', 180: 'S', 270: 'W' };
const cutter = (cut) => (v) => v - 360 * Math.floor((v - cut) / 360);

const draws = {
  strip(id, f, range) {
    const M = D.marks, L = layout(id, { hovermode: 'closest', barmode: 'overlay' }), traces = [];
    const lane = (y, spans, fill, label, hover) => traces.push({
      type: 'bar', orientation: 'h', base: spans.map((s) => s[0]), x: spans.map((s) => s[1] - s[0]), y: spans.map(() => y), width: 0.76,
      marker: { color: fill, line: { color: css('--bg'), width: 1 } }, text: spans.map(label), textposition: 'inside', insidetextanchor: 'start',
      constraintext: 'none', cliponaxis: true, textfont: { size: 12, color: css('--tx') }, customdata: spans.map(hover), hovertemplate: '%{customdata}<extra></extra>', textangle: 0,
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
    // the set-point sets no range: in a crash nothing follows it
    if (f.demand) ['roll', 'pitch', 'heading'].forEach((key, i) => {
      const y = values(f.demand.y[key]), [X, Y] = reduced(times(f.demand.t), i < 2 ? y : y.map(map), range, width(id), i !== 1);
      p.traces.push(plain('set-point', css('--mu'), X, Y, { yaxis: i ? 'y' + (i + 1) : 'y', line: { color: css('--mu'), width: 1.3, dash: 'dash' }, say: '°' }));
    });
    alarms(p.layout, range);
    return headed(id, p);
  },
  difference(id, f, range) {
    const p = panels(id, f, [['tilt', 'tilt, °', { axis: { rangemode: 'nonnegative' } }], ['roll', 'roll, °', { wraps: true }], ['pitch', 'pitch, °'], ['heading', 'heading, °', { wraps: true }]].filter(([k]) => f.series.some((s) => s.y[k])), { range, phases: 'named', from: f.scored, to: D.marks.crash });
    // how wrong the smoother may be itself: a grey band below the lines
    const none = { line: { width: 0 }, hoverinfo: 'skip', say: undefined }, grey = faded(css('--tx'), 0.14);
    if (f.sigma) [['tilt', 'y', 0], ['heading', 'y4', -1]].forEach(([key, yaxis, low]) => {
      if (!f.sigma.y[key]) return;
      const [X, Y] = reduced(times(f.sigma.t), values(f.sigma.y[key]), range, width(id));
      const edge = (sign, more) => plain('sigma of the smoother', css('--tx'), X, Y.map((v) => (v === null ? null : sign * v)), Object.assign({ yaxis }, none, more));
      p.traces.unshift(edge(low), edge(1, { fill: 'tonexty', fillcolor: grey }));
    });
    alarms(p.layout, range);
    return headed(id, p);
  },
  bias(id, f, range) {
    const p = panels(id, f, ['x', 'y', 'z'].map((k) => [k, k + ', °/s', { least: 0.02 }]), { range, phases: 'plain', trace: { say: ' °/s', digits: 3 }, to: D.marks.crash });
    if (f.rests) ['x', 'y', 'z'].forEach((k, i) => {
      const ax = p.layout['yaxis' + (i ? i + 1 : '')], all = f.rests[k], low = Math.min(...all), high = Math.max(...all), pad = 0.06 * (Math.max(high, ax.range[1]) - Math.min(low, ax.range[0]));
      p.traces.push(plain('gyro at rest', css('--tx'), f.rests.t, all, { mode: 'markers', marker: { size: 9, color: css('--tx') }, yaxis: i ? 'y' + (i + 1) : 'y', say: ' °/s', digits: 3 }));
      ax.range = [Math.min(ax.range[0], low - pad), Math.max(ax.range[1], high + pad)];
    });
    return p;
  },
  rest(id, f) {
    const p = panels(id, f, [['roll', 'roll, °', { least: 0.002 }], ['pitch', 'pitch, °', { least: 0.002 }], ['heading', 'heading, °', { least: 0.002 }]], { range: f.range, calm: true, trace: { digits: 4, opacity: 0.85 } });
    for (const t of p.traces) if (t.line) t.line.width = 1.1;
    return p;
  },
  spread(id, f) {
    const L = layout(id), traces = ordered(f.shares).map((s) => trace(s.r, f.x, s.y, { line: Object.assign(line(s.r), { shape: 'hvh' }), say: ' %', digits: 1, at: '°' }));
    L.xaxis = axis('angle, °', { hoverformat: '.4f' });
    L.yaxis = axis('share of samples, %', { rangemode: 'tozero' });
    return { traces, layout: L };
  },
  allan(id, f) {
    const L = layout(id), traces = [];
    for (const c of ordered(f.curves)) traces.push(trace(c.r, c.tau, c.deviation, {
      also: c.low ? c.tau.map((_, i) => (c.low[i] === null ? '' : ' [' + c.low[i].toPrecision(2) + ' to ' + c.high[i].toPrecision(2) + ']')) : undefined, digits: 4,
    }));
    L.xaxis = axis('averaging time τ, s', Object.assign({ type: 'log', hoverformat: '.2~r' }, decades(f.curves.flatMap((c) => c.tau), narrow(id) ? 6 : 10)));
    L.yaxis = axis('Allan deviation, °', Object.assign({ type: 'log' }, decades(f.curves.flatMap((c) => c.deviation), 8)));
    L.margin.l += 10;
    return ended(id, { traces, layout: L });
  },
  step(id, f) {
    const L = layout(id), traces = [], ms = (t) => Array.from(t, (v) => v * 1e3), longest = f.lines.reduce((a, b) => (b.t.n > a.t.n ? b : a));
    for (const l of ordered(f.lines)) {
      const est = values(l.y.est), ref = values(l.y.ref), own = { at: ' ms', line: line(l.r, 1.8) };
      traces.push(trace(l.r, ms(times(l.t)), gaps(est), own), trace(l.r, ms(times(l.t)), gaps(est.map((v, i) => v - ref[i])), Object.assign({ yaxis: 'y2' }, own)));
    }
    const whose = f.reference === undefined ? { color: css('--e0') } : line(f.reference), black = whose.color, x = ms(times(longest.t));
    traces.push(plain('reference', black, x, gaps(values(longest.y.ref)), { mode: x.length < 90 ? 'lines+markers' : 'lines', line: Object.assign({}, whose, { width: 2.4 }), marker: { size: 5, color: black }, say: '°', at: ' ms' }));
    if (longest.y.set) traces.push(plain('set-point', black, x, gaps(values(longest.y.set)), { line: { color: css('--mu'), width: 2, dash: 'dash' }, say: '°', at: ' ms' }));
    L.xaxis = axis('time from the start of the step, ms', { anchor: 'y2' });
    L.yaxis = axis(safe(short(f.axis, 110)) + ' change, °', { domain: [0.42, 1], range: fitted(traces, 'y', 1, true) });
    L.yaxis2 = axis('minus reference, °', { domain: [0, 0.34], nticks: 5, range: fitted(traces, 'y2', 0.5, true) });
    return ended(id, leaving({ traces, layout: L }));
  },
  // medians of all, the band of one: many bands hide each other
  steps(id, f) {
    const L = layout(id), bands = [], lines = [], chosen = banded[id] === undefined ? f.band : banded[id];
    for (const l of ordered(f.lines)) {
      const own = f.x.map((_, i) => i).filter((i) => l.median[i] !== null), pick = (y) => own.map((i) => y[i]), x = pick(f.x), edge = { line: { color: colour(l.r), width: 0 }, hoverinfo: 'skip', say: undefined };
      if (l.r === chosen) bands.push(trace(l.r, x, pick(l.low), Object.assign({}, edge, { name: name(l.r) + ', 10 %' })), trace(l.r, x, pick(l.high), Object.assign({}, edge, { name: name(l.r) + ', 90 %', fill: 'tonexty', fillcolor: faded(colour(l.r), 0.2) })));
      lines.push(trace(l.r, x, pick(l.median), { say: ' %', digits: 1, at: ' ms', line: line(l.r, 2) }));
    }
    L.xaxis = axis('time from the start of the step, ms', { range: [f.x[0], f.x[f.x.length - 1]] });
    L.yaxis = axis('minus reference, % of the step', { range: fitted(lines.concat(bands), 'y', 4, true) });
    const p = ended(id, leaving({ traces: lines, layout: L }));
    return { traces: bands.concat(p.traces), layout: L };
  },
  lag(id, f) {
    const p = dotted(id, f.rows, 'lag, ms (left: ahead, right: behind)', ' ms');
    if (f.half) { p.layout.shapes.push(band(-f.half, f.half, css('--arm'))); if (!narrow(id)) p.layout.annotations.push(note(0, '± half an IMU sample')); }
    const [low, high] = p.layout.xaxis.range;
    f.rows.forEach((d) => {
      const x = d.single.filter((v) => v >= low && v <= high);
      if (x.length && !off(d.r)) p.traces.unshift({ type: 'scatter', mode: 'markers', x, y: x.map((_, i) => p.place(d.r) + ((i * 7919) % 101) / 101 * 0.5 - 0.25), meta: d.r, visible: !off(d.r), name: name(d.r), marker: { size: 5, color: colour(d.r), opacity: 0.55 }, hovertemplate: name(d.r) + ': %{x:.0f} ms<extra></extra>' });
    });
    return p;
  },
  drifts(id, f) { return dotted(id, f.rows, 'drift of the heading, °/min', ' °/min'); },
  drift(id, f) {
    const L = layout(id), traces = [];
    for (const s of ordered(f.series)) for (const [key, w, opacity] of [['heading', 1.1, 0.7], ['line', 2.6, 1]]) if (s.y[key]) {
      const [X, Y] = reduced(times(s.t), values(s.y[key]), null, width(id), false);
      traces.push(trace(s.r, X, Y, { line: line(s.r, w), opacity, hoverinfo: key === 'line' ? 'skip' : 'none', say: key === 'line' ? undefined : '°' }));
    }
    L.xaxis = axis('time, s', { range: f.range, hoverformat: '.0f' });
    L.yaxis = axis('heading, °', { range: fitted(traces, 'y', 0.1, true) });
    return ended(id, leaving({ traces, layout: L }));
  },
  setpoint(id, f) {
    const L = layout(id), traces = [];
    for (const s of f.series) for (const key of Object.keys(s.y)) {
      traces.push(trace(s.r, Array.from(times(s.t), (v) => v * 1e3), Array.from(values(s.y[key])), { name: safe(key), say: '', at: ' ms', line: Object.assign(line(s.r), { dash: { roll: 'solid', pitch: 'dash', yaw: 'dot' }[key] || D.rows[s.r].dash }) }));
    }
    L.xaxis = axis('time after the command, ms');
    L.yaxis = axis('share of the command');
    return ended(id, { traces, layout: L });
  },
  // metres, equal on both axes; arrows all along the path that is in sight, by distance flown
  track(id, f, range) {
    const L = layout(id, { hovermode: 'closest' }), blue = css('--ac'), black = css('--e0'), here = f.t.map((_, i) => i).filter((i) => f.t[i] >= range[0] && f.t[i] <= range[1] && f.north[i] !== null);
    const path = (what, color, w, keep) => plain(what, color, here.map((i) => (keep(i) ? f.east[i] : null)), here.map((i) => (keep(i) ? f.north[i] : null)), { line: { color, width: w }, customdata: here.map((i) => clock(f.t[i])), say: undefined, hoverinfo: undefined, hovertemplate: '%{customdata}: north %{y:.1f} m, east %{x:.1f} m<extra></extra>' });
    const driven = (i) => f.driven[i] > 0, some = here.some(driven), fit = here.filter((i) => !some || driven(i));
    const traces = [path('on the ground', css('--edge'), 1.2, (i) => !driven(i) || !driven(i - 1)), path('path', blue, 1.6, driven)].filter((t) => t.y.some((v) => v !== null));
    const [ex, ny] = [f.east, f.north].map((y) => { const all = fit.map((i) => y[i]), low = share(all, 0.002), high = share(all, 0.998); return [(low + high) / 2, high - low]; });
    const w = L.width - L.margin.l - L.margin.r, h = L.height - L.margin.t - L.margin.b, scale = Math.max(ex[1] / w, ny[1] / h, 4 / h) * 1.15, long = 26 * scale;
    const at = [];
    let flown = Infinity, before = null;
    for (const i of fit) {
      if (before !== null) flown += Math.hypot(f.east[i] - f.east[before], f.north[i] - f.north[before]);
      if (flown > 1.1 * long && f.course[i] !== null) { at.push(i); flown = 0; }
      before = i;
    }
    const thin = at.filter((_, k) => k % Math.ceil(at.length / MOST_ARROWS) === 0);
    for (const [what, angles, color] of [['course', f.course, blue], ['heading', f.heading, black]]) traces.push(...arrows(what, thin.filter((i) => angles[i] !== null), f, angles, long, color));
    const ends = [fit[0], fit[fit.length - 1]].filter((i) => i !== undefined);
    traces.push(plain('start, end', black, ends.map((i) => f.east[i]), ends.map((i) => f.north[i]), { mode: 'markers', hoverinfo: 'skip', say: undefined, arrow: true, marker: { symbol: ['circle-open', 'x-thin'], size: 12, color: black, line: { width: 2, color: black } } }));
    L.xaxis = axis('east, m', { range: [ex[0] - scale * w / 2, ex[0] + scale * w / 2], zeroline: false });
    L.yaxis = axis('north, m', { range: [ny[0] - scale * h / 2, ny[0] + scale * h / 2], zeroline: false, scaleanchor: 'x' });
    return headed(id, { traces, layout: L });
  },
  // one line per log and below them all together; several configurations side by side on a line
  forest(id, f) {
    const L = layout(id, { hovermode: 'closest' }), rows = [...new Set(f.items.filter((d) => !off(d.r)).map((d) => d.r))], traces = [], to = f.log ? Math.log10 : (v) => v, from = f.log ? (v) => 10 ** v : (v) => v;
    const lines = f.lines.length, wide = (d) => [d.v, ...(d.ci || [])].filter((v) => v !== null && (!f.log || v > 0)).map(to), values = f.items.flatMap((d) => [to(d.v)]), zero = 0;
    const most = Math.max(f.log ? 0.02 : 1e-6, ...values.map(Math.abs)), ends = f.items.flatMap(wide).filter((v) => Math.abs(v) < 4 * most);
    const low = Math.min(zero, ...values, ...ends), high = Math.max(zero, ...values, ...ends), pad = 0.06 * (high - low), range = [low - pad, high + pad];
    for (const r of rows) {
      const own = f.items.filter((d) => d.r === r), at = (d) => lines - 1 - d.line + (rows.length > 1 ? 0.25 - (0.5 * rows.indexOf(r)) / (rows.length - 1) : 0);
      for (const all of [false, true]) {
        const some = own.filter((d) => d.all === all), inside = (v) => Math.min(Math.max(v, from(range[0])), from(range[1]));
        if (some.length) traces.push({
          type: 'scatter', mode: 'markers', meta: r, name: name(r) + (all ? ', all logs' : ''), x: some.map((d) => d.v), y: some.map(at),
          error_x: { type: 'data', symmetric: false, array: some.map((d) => (d.ci ? inside(d.ci[1]) - d.v : 0)), arrayminus: some.map((d) => (d.ci ? d.v - inside(d.ci[0]) : 0)), color: colour(r), thickness: all ? 3 : 1.6, width: all ? 6 : 3 },
          marker: { size: all ? 13 : 8, symbol: all ? 'diamond' : some.map((d) => (d.significant ? 'circle' : 'circle-open')), color: colour(r), line: { color: colour(r), width: 1.6 } },
          customdata: some.map((d) => safe(short(d.say, 160))), hovertemplate: '%{customdata}<extra></extra>',
        });
      }
    }
    const longest = Math.max(1, ...f.lines.map((t) => Math.min(t.length, 28)));
    L.margin.l = Math.min(24 + 6.6 * longest, width(id) * 0.42);
    L.xaxis = axis(safe(short(f.axis, 110)), { range, type: f.log ? 'log' : 'linear', zeroline: false });
    if (f.log) { const t = ratios(from(range[0]), from(range[1]), narrow(id) ? 5 : 9); L.xaxis.tickvals = t; L.xaxis.ticktext = t.map((v) => minus((v < 1 ? '-' : v > 1 ? '+' : '') + Math.round(Math.abs(v - 1) * 100) + ' %')); }
    L.yaxis = axis('', { tickvals: f.lines.map((_, i) => lines - 1 - i), ticktext: f.lines.map((t) => safe(short(t, 28))), range: [-0.6, lines - 0.4], fixedrange: true, zeroline: false });
    L.shapes.push({ type: 'line', xref: 'x', yref: 'paper', x0: f.log ? 1 : 0, x1: f.log ? 1 : 0, y0: 0, y1: 1, line: { color: css('--tx'), width: 1.3 } });
    if (f.all) L.shapes.push({ type: 'line', xref: 'paper', yref: 'y', x0: 0, x1: 1, y0: 0.5, y1: 0.5, line: { color: css('--bd'), width: 1 } });
    for (const [x, text, anchor] of [[0, '← nearer to perfect', 'left'], [1, 'farther →', 'right']]) L.annotations.push({ x, y: 1, xref: 'paper', yref: 'paper', xanchor: anchor, yanchor: 'bottom', text, showarrow: false, font: { size: 12, color: css('--mu') } });
    return { traces, layout: L };
  },
};
const ratios = (low, high, most) => { const t = [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.1, 1.25, 1.5, 2, 3, 5, 10, 20].filter((v) => v >= low && v <= high); return t.length > most ? t.filter((v) => v === 1 || [0.1, 0.2, 0.5, 0.7, 1.5, 2, 5, 10].includes(v)) : t; };
const SYMBOLS = { 'against truth': 'diamond', 'against smoother': 'diamond', 'against mag': 'square', 'against gnss_yaw': 'triangle-up', 'against yaw_estimator': 'pentagon', 'against course': 'triangle-down' };
const REFIT = ['forest', 'attitude', 'lag', 'drifts', 'difference', 'rest', 'drift', 'step', 'steps'];
const FOLLOWS = ['track'];
const TIMED = ['strip', 'attitude', 'difference', 'bias', 'vibration', 'size', 'compass', 'ratios'];
const gaps = (y) => Array.from(y, (v) => (Number.isNaN(v) ? null : v));

const MOST_ARROWS = 160;
// shafts as one line, heads as one set of markers turned to the screen, north up
function arrows(what, at, f, angles, long, color) {
  const tip = (i) => { const a = angles[i] * Math.PI / 180; return [f.east[i] + long * Math.sin(a), f.north[i] + long * Math.cos(a)]; };
  const tips = at.map(tip), none = { hoverinfo: 'skip', say: undefined };
  return [
    plain(what, color, at.flatMap((i, k) => [f.east[i], tips[k][0], null]), at.flatMap((i, k) => [f.north[i], tips[k][1], null]), Object.assign({}, none, { line: { color, width: 1.6 } })),
    plain(what, color, tips.map((p) => p[0]), tips.map((p) => p[1]), Object.assign({ mode: 'markers', arrow: true, marker: { symbol: 'triangle-up', size: 7, color, angle: at.map((i) => angles[i]) } }, none)),
  ];
}

// failsafes and critical messages across a figure
function alarms(L, range) {
  const T = D.marks.texts.filter((m) => m[1] === 2 && m[0] >= range[0] && m[0] <= range[1]).slice(0, 60);
  for (const [t] of T) L.shapes.push(bar(t, css('--bad'), 'dash'));
}
