// The packed blocks of the page: plotly, the drawing data, the JSON result.
const $ = (id) => document.getElementById(id);
const root = document.documentElement;

async function gunzip(id) {
  const text = atob($(id).textContent.trim());
  const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).arrayBuffer();
}

// Runs plotly by putting its text into a script element whose hash stands in the policy.
async function startPlotly() {
  const script = document.createElement('script');
  script.textContent = new TextDecoder().decode(await gunzip('plotly'));
  document.head.append(script);
  $('plotly').remove();
}

let D, blob;
async function startData() {
  [D, blob] = await unpacked('data');
}

async function unpacked(id) {
  const buffer = await gunzip(id), size = new DataView(buffer).getUint32(0, true);
  return [JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size))), new Uint8Array(buffer, 4 + size)];
}

// a block that is unpacked later: its arrays lie behind those of the page
async function more(id) {
  const [header, bytes] = await unpacked(id), all = new Uint8Array(blob.length + bytes.length), first = blob.length;
  all.set(blob);
  all.set(bytes, first);
  blob = all;
  const shifted = (value) => {
    if (!value || typeof value !== 'object') return;
    if (Number.isInteger(value.o) && Number.isInteger(value.w)) value.o += first;
    else Object.values(value).forEach(shifted);
  };
  shifted(header);
  return header;
}

// a difference whose lowest bit is its sign
const signed = (z) => (z >>> 1) ^ -(z & 1);
// int16 differences, low bytes first, then high bytes; -32768 is a gap
const decoded = new Map();
function values(a) {
  const key = 'v' + a.o + ' ' + a.s + ' ' + a.b;
  if (decoded.has(key)) return decoded.get(key);
  const middle = a.b || 0, out = middle ? new Float64Array(a.n) : new Float32Array(a.n);
  for (let i = 0, sum = 0; i < a.n; i++) {
    sum = ((sum + signed(blob[a.o + i] | (blob[a.o + a.n + i] << 8))) << 16) >> 16;
    out[i] = sum === -32768 ? NaN : middle + sum * a.s;
  }
  decoded.set(key, out);
  return out;
}

function times(a) {
  const key = 't' + a.o + ' ' + a.s;
  if (decoded.has(key)) return decoded.get(key);
  const out = new Float64Array(a.n), n = a.n, o = a.o;
  for (let i = 0, sum = 0; i < n; i++) {
    const z = blob[o + i] | (blob[o + n + i] << 8) | (blob[o + 2 * n + i] << 16) | (blob[o + 3 * n + i] << 24);
    sum = (sum + signed(z)) | 0;
    out[i] = sum * a.s;
  }
  decoded.set(key, out);
  return out;
}

// an array of a figure: numbers as they are, else what is packed
const array = (a) => (!a.w ? a : a.w === 4 ? times(a) : values(a));
