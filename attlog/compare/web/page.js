const save = (name, url) => {
  const a = document.createElement('a');
  a.href = url;
  a.download = name;
  a.click();
};
const text = (svg) => new XMLSerializer().serializeToString(svg);
document.querySelectorAll('figure').forEach((figure, i) => {
  const svg = figure.querySelector('svg');
  const name = document.body.dataset.name + '-' + (i + 1);
  figure.querySelector('.svg').onclick = () => save(name + '.svg', URL.createObjectURL(new Blob([text(svg)], {type: 'image/svg+xml'})));
  figure.querySelector('.png').onclick = () => {
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement('canvas');
      canvas.width = 2 * svg.viewBox.baseVal.width;
      canvas.height = 2 * svg.viewBox.baseVal.height;
      canvas.getContext('2d').drawImage(image, 0, 0, canvas.width, canvas.height);
      save(name + '.png', canvas.toDataURL('image/png'));
    };
    image.src = 'data:image/svg+xml;base64,' + btoa(unescape(encodeURIComponent(text(svg))));
  };
});
document.querySelectorAll('button.csv').forEach((button, i) => {
  button.onclick = () => {
    const rows = [...button.parentElement.querySelectorAll('tr')].map((row) => [...row.children].map((cell) => spreadsheetCell(cell.textContent)).join(','));
    save(document.body.dataset.name + '-table-' + (i + 1) + '.csv', URL.createObjectURL(new Blob([rows.join('\n')], {type: 'text/csv'})));
  };
});
