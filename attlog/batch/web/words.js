// Numbers and elements: written as in the reports.
const MINUS = '\u2212';
const decimals = (size, unit) => {
  if (unit === 'deg') return size < 0.0995 ? 3 : size < 0.995 ? 2 : 1;
  if (unit === 'deg/min') return size < 0.995 ? 2 : 1;
  if (unit === 'ms' || unit === 'pct' || unit === '%' || unit === 'ns') return 0;
  if (unit === 's') return size < 99.5 ? 1 : 0;
  return size < 0.0995 ? 3 : size < 9.95 ? 2 : size < 99.5 ? 1 : 0;
};
const SIGNED = ['deg/min', 'ms'];
function number(value, unit) {
  if (value === null || value === undefined) return '';
  const size = Math.abs(value), places = decimals(size, unit), signed = SIGNED.includes(unit);
  let text = size.toFixed(places);
  if (+text === 0 && size > 0 && !signed && places) return (value < 0 ? MINUS : '') + '<' + (10 ** -places).toFixed(places);
  const zero = +text === 0;
  if (+text >= 10000) text = (+text).toLocaleString('en', { minimumFractionDigits: places, maximumFractionDigits: places });
  return (value < 0 && !zero ? MINUS : signed && !zero ? '+' : '') + text;
}
const withUnit = (value, c) => { const text = number(value, c.unit); return text && c.sign ? text + (/^[°×]/.test(c.sign) ? '' : ' ') + c.sign : text; };
const counted = (n, thing) => n.toLocaleString('en') + ' ' + thing + (n === 1 ? '' : 's');
const day = (s) => (s === null ? '' : new Date(1000 * s).toISOString().slice(0, 10));
const minute = (s) => (s === null ? 'date unknown' : new Date(1000 * s).toISOString().slice(0, 16).replace('T', ' ') + ' UTC');
function duration(s) {
  if (s === null || s === undefined) return '';
  if (s < 9.95) return s.toFixed(1) + ' s';
  if (s < 119.5) return s.toFixed(0) + ' s';
  if (s < 3600) return (s / 60).toFixed(1) + ' min';
  const m = Math.round(s / 60);
  return Math.floor(m / 60) + ' h ' + String(m % 60).padStart(2, '0') + ' min';
}
const clockTime = (s) => (Math.abs(s) < 600 ? s.toFixed(1) + ' s' : Math.floor(s / 3600) + ':' + String(Math.floor(s / 60) % 60).padStart(2, '0') + ':' + String(Math.floor(s % 60)).padStart(2, '0'));

// texts of strangers reach the page as text nodes and attributes only
function el(tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const key in attributes) if (attributes[key] !== null && attributes[key] !== undefined && attributes[key] !== false) made.setAttribute(key, attributes[key]);
  made.append(...children.filter((c) => c !== null && c !== undefined && c !== ''));
  return made;
}
function svg(tag, attributes, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  made.append(...children);
  return made;
}
function options(select, items, chosen) {
  select.replaceChildren(...items.map(([value, text]) => el('option', { value, selected: value === chosen ? '' : null }, text)));
}
