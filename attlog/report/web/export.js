// A figure as a file: picture with title and legend, or its numbers.
const LEGEND_ROW = 20;

function save(blob, file) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// the figure as it stands, each name once in a legend below, on the page's own background
function poster(id) {
  const gd = $(id), names = new Set(), f = D.figures[id], view = (f.views || []).length > 1 ? document.querySelector('select[data-figure=' + id + ']') : null;
  const data = gd.data.map((t) => {
    const own = t.visible !== false && t.name && !t.arrow && !(t.line && t.line.width === 0) && !names.has(t.name);
    if (own) names.add(t.name);
    return Object.assign({}, t, { showlegend: !!own });
  });
  const L = Object.assign({}, gd.layout), titles = [gd.dataset.title, view ? view.selectedOptions[0].textContent : ''].filter(Boolean).map(safe);
  const rows = names.size ? Math.ceil([...names].reduce((sum, n) => sum + 60 + 7 * n.length, 0) / L.width) + 1 : 0;
  L.margin = Object.assign({}, L.margin, { t: L.margin.t + 30, b: L.margin.b + LEGEND_ROW * rows });
  L.height += 30 + LEGEND_ROW * rows;
  L.paper_bgcolor = L.plot_bgcolor = css('--bg');
  L.title = { text: titles.join(', '), x: 0.01, xanchor: 'left', y: 1, yanchor: 'top', pad: { t: 8 }, font: { size: 14 } };
  L.showlegend = names.size > 0;
  L.legend = { orientation: 'h', x: 0, xanchor: 'left', y: 0, yanchor: 'bottom', yref: 'container', font: { size: 12 } };
  return { data, layout: L, config: CONFIG };
}

async function picture(id, format) {
  const p = poster(id), scale = format === 'png' ? 2 : 1;
  const url = await Plotly.toImage(p, { format, width: p.layout.width, height: p.layout.height, scale });
  const [head, body] = [url.slice(0, url.indexOf(',')), url.slice(url.indexOf(',') + 1)];
  const bytes = head.endsWith('base64') ? Uint8Array.from(atob(body), (c) => c.charCodeAt(0)) : new TextEncoder().encode(decodeURIComponent(body));
  return new Blob([bytes], { type: format === 'png' ? 'image/png' : 'image/svg+xml' });
}

function exports() {
  document.querySelectorAll('button[data-save]').forEach((button) => {
    button.hidden = false;
    button.addEventListener('click', () => save(new Blob([$(button.dataset.save).textContent], { type: 'text/plain' }), button.dataset.file));
  });
  document.querySelectorAll('.out').forEach(savable);
}

function savable(place) {
  place.hidden = false;
  place.querySelectorAll('button').forEach((button) => button.addEventListener('click', async () => {
    const id = place.dataset.figure, kind = button.dataset.out;
    if (waiting.has(id)) draw(id);
    save(kind === 'csv' ? new Blob([csv(tableOf(id))], { type: 'text/csv' }) : await picture(id, kind), (D.log || 'attlog') + '_' + id + '.' + kind);
  }));
}
