// A figure that was drawn while folded has no width of its own yet.
document.querySelectorAll('details').forEach((d) => d.addEventListener('toggle', () => {
  if (d.open && !printing) d.querySelectorAll('.plot[data-ready]').forEach((p) => draw(p.id));
}));
