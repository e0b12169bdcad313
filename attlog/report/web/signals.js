// The vehicle's parameters: a table that is searched. Rows are made when it is first opened.
function parameters() {
  const place = $('parameters');
  if (!place || !(D.parameters || []).length) return;
  const body = place.querySelector('tbody'), search = $('parameter-search'), kind = $('parameter-kind');
  let rows = null;
  const cell = (tag, text, kids) => { const made = document.createElement(tag); made.textContent = text; made.append(...(kids || [])); return made; };
  const dim = (text) => { const made = cell('span', text); made.className = 'mu'; return made; };
  const during = ([t, moment, value, flying]) => {
    const link = cell('a', moment);
    link.href = '#part-flight';
    link.dataset.t = t;
    const line = cell('span', '', [link, ': ', cell('b', value), flying ? ' in the air' : '']);
    line.className = 'set';
    return line;
  };
  const row = ([name, value, usual, remark, , changes, more]) => {
    const head = cell('th', name), made = document.createElement('tr');
    head.scope = 'row';
    head.className = 'mono';
    const rest = more ? [dim('and ' + more + (more > 1 ? ' changes' : ' change') + ' more, see the JSON result')] : [];
    made.append(head, cell('td', value, remark ? [' ', dim(remark)] : []), cell('td', usual), cell('td', '', [...changes.map(during), ...rest]));
    return made;
  };
  const shown = () => {
    rows = rows || D.parameters.map(row);
    const words = search.value.toUpperCase().split(/\s+/).filter(Boolean), all = D.parameters;
    const fits = ([name, , , , origin, changes]) => words.every((w) => name.toUpperCase().includes(w)) && (!kind.value || (kind.value === 'set' ? origin === 'set' || origin === 'airframe' : changes.length));
    const kept = rows.filter((_, i) => fits(all[i]));
    body.replaceChildren(...kept);
    $('parameter-count').textContent = kept.length + ' of ' + all.length;
  };
  place.querySelector('.ctl').hidden = false;
  place.addEventListener('toggle', () => { if (place.open && !rows) shown(); });
  search.addEventListener('input', shown);
  kind.addEventListener('change', shown);
  if (place.open) shown();
}
