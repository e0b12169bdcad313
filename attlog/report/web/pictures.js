// Every figure as SVG and PNG; then the page holds nothing else. What goes wrong is told in their place.
(async () => {
  const { figures, scale } = JSON.parse(document.getElementById('figures').textContent), drawn = [];
  const body = (url) => url.slice(url.indexOf(',') + 1);
  const painted = async (url, { width, height }) => {
    const image = new Image(), canvas = document.createElement('canvas');
    image.src = url;
    await image.decode();
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    canvas.getContext('2d').drawImage(image, 0, 0, canvas.width, canvas.height);
    return canvas.toDataURL('image/png');
  };
  let answer = drawn;
  try {
    for (const f of figures) {
      const svg = await Plotly.toImage(f, { format: 'svg', width: f.layout.width, height: f.layout.height });
      drawn.push([decodeURIComponent(body(svg)), body(await painted(svg, f.layout))]);
    }
  } catch (error) { answer = String(error); }
  const bytes = new TextEncoder().encode(JSON.stringify(answer));
  let text = '';
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  const place = document.createElement('pre');
  place.id = 'pictures';
  place.textContent = btoa(text);
  document.body.replaceChildren(place);
})();
