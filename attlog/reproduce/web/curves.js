// Figures of papers: stacked panels of lines over any x, and points with their intervals.
draws.curves = (id, f) => {
  const p = panels(id, f, f.panels.map((title, i) => [String(i), title, { least: 1e-4 }]), { range: f.range, time: f.x });
  for (const t of p.traces) { const i = t.yaxis && t.yaxis !== 'y' ? +t.yaxis.slice(1) - 1 : 0; if (t.say !== undefined) Object.assign(t, { say: f.units[i], digits: 3, at: f.at }); }
  return p;
};
draws.points = (id, f) => {
  const L = layout(id, { hovermode: 'closest' }), n = f.panels.length, gap = 0.06, height = (1 - gap * (n - 1)) / n, rows = [...new Set(f.dots.map((d) => d.r))];
  const scale = (v) => (f.log ? Math.log10(v) : v), ends = f.range.map(scale), span = ends[1] - ends[0];
  const pad = span * 0.06 || 0.5, shift = f.ticks.length ? 0.5 / (rows.length + 1) : 0;
  const traces = f.dots.map((d) => {
    const x = d.x.map((v) => v + shift * (rows.indexOf(d.r) - (rows.length - 1) / 2));
    return trace(d.r, x, d.y, {
      mode: f.ticks.length ? 'markers' : 'lines+markers', yaxis: d.panel ? 'y' + (d.panel + 1) : 'y', marker: { size: 8, color: colour(d.r) }, say: f.units[d.panel], digits: 3, at: f.at,
      error_y: d.ci ? { type: 'data', symmetric: false, array: d.ci[1].map((v, i) => v - d.y[i]), arrayminus: d.ci[0].map((v, i) => d.y[i] - v), color: colour(d.r), thickness: 1.6, width: 4 } : undefined,
    });
  });
  L.xaxis = axis(f.x, Object.assign({ range: [ends[0] - pad - shift * rows.length, ends[1] + pad + shift * rows.length], type: f.log ? 'log' : 'linear', anchor: n > 1 ? 'y' + n : 'y', zeroline: false }, f.ticks.length ? { tickvals: f.ticks.map((_, i) => i), ticktext: f.ticks.map(safe) } : f.log ? decades(f.range, 9) : {}));
  f.panels.forEach((title, i) => {
    const top = 1 - i * (height + gap), all = f.dots.filter((d) => d.panel === i).flatMap((d) => [...d.y, ...(d.ci ? [...d.ci[0], ...d.ci[1]] : [])]).filter((v) => v !== null);
    const low = Math.min(0, ...all), high = Math.max(0, ...all), edge = (high - low) * 0.06 || 1;
    L['yaxis' + (i ? i + 1 : '')] = axis(title, { domain: [Math.max(top - height, 0), top], nticks: 5, range: [low < 0 ? low - edge : 0, high + edge] });
  });
  return { traces, layout: L };
};
