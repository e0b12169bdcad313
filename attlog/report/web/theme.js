// Colours come from the style sheet, so that light, dark and print agree with the page.
const wantsDark = matchMedia('(prefers-color-scheme: dark)');
let printing = false;
const isDark = () => !printing && (root.dataset.theme ? root.dataset.theme === 'dark' : wantsDark.matches);
// asked once for each of both: every question makes the browser lay the page out
const shades = new Map();
function css(name) {
  const key = isDark() + name;
  if (!shades.has(key)) shades.set(key, getComputedStyle(root).getPropertyValue(name).trim());
  return shades.get(key);
}
const faded = (color, share) => 'rgba(' + [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16)).join(',') + ',' + share + ')';
// a colour of the style sheet by its name, with its opacity: e1, bad/0.2; others as they are
function shade(text) {
  const [key, share] = text.split('/'), found = /^[a-z]+\d?$/.test(key) ? css('--' + key) : '';
  return !found ? text : share ? faded(found, share) : found;
}
// a trace, shape or note with the colours of the theme
function coloured(value) {
  const out = {};
  for (const [key, own] of Object.entries(value)) {
    if (key !== 'meta' && own && typeof own === 'object' && !Array.isArray(own)) out[key] = key === 'x' || key === 'y' ? own : coloured(own);
    else if (key.endsWith('color') && own) out[key] = Array.isArray(own) ? own.map(shade) : typeof own === 'string' ? shade(own) : own;
    else out[key] = own;
  }
  return out;
}
const colour = (r) => css('--e' + D.rows[r].slot);
const PRINT_WIDTH = 684;

// plotly reads tags and entities in texts: nothing that looks like one may reach it
const safe = (text) => String(text).replace(/&/g, '＆').replace(/</g, '‹').replace(/>/g, '›').replace(/%\{/g, '%(').replace(/\$/g, '＄');
const short = (text, n) => (text.length > n ? text.slice(0, n - 1) + '…' : text);
const name = (r) => safe(short(D.rows[r].name, 60)); // a figure has no room for more, and plotly none to measure it

const minus = (text) => text.replace(/^-(?=[0.]+$)/, '').replace(/-/g, '\u2212');
