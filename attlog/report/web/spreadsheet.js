// A text as a cell that a spreadsheet shows and does not run, as attlog/spreadsheet.py makes it; quoted.
function spreadsheetCell(text) {
  const formula = /^[\s"]*[=+@＝＋－＠-].|^[\t\n]./s, number = /^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$/;
  const whole = String(text).replace(/\r\n?/g, '\n');
  const parts = whole.split(/([;\t\n])/).map((part, i) => (formula.test(i ? part : whole) && !number.test(part.trim()) ? "'" + part : part));
  return '"' + parts.join('').replace(/"/g, '""') + '"';
}
