"""The script of the HTML report: sort tables by a column, and switch between light and dark.

Without it the page shows everything. Before printing it opens what is folded.
"""

from typing import Final

SCRIPT: Final = """
'use strict';
const each = (where, what, act) => where.querySelectorAll(what).forEach(act);
const keyOf = cell => {
  const text = cell.textContent.trim();
  const number = parseFloat(text.replace(/^[<>\\u2264\\u2265]\\s*/, '').replace(/,/g, ''));
  return Number.isNaN(number) ? text : number;
};
const compare = (a, b) => typeof a === typeof b
  ? (a < b ? -1 : a > b ? 1 : 0)
  : (typeof a === 'number' ? -1 : 1);
each(document, 'table', table => each(table, 'thead th', (head, column) => {
  const sort = () => {
    const down = head.getAttribute('aria-sort') === 'ascending';
    each(table, 'thead th', other => other.removeAttribute('aria-sort'));
    head.setAttribute('aria-sort', down ? 'descending' : 'ascending');
    const body = table.tBodies[0], rows = [...body.rows];
    rows.sort((a, b) => compare(keyOf(a.cells[column]), keyOf(b.cells[column])) * (down ? -1 : 1));
    body.append(...rows);
  };
  head.tabIndex = 0;
  head.classList.add('sorts');
  head.addEventListener('click', sort);
  head.addEventListener('keydown', event => { if (event.key === 'Enter') sort(); });
}));
const wantsDark = matchMedia('(prefers-color-scheme: dark)');
const root = document.documentElement, button = document.createElement('button');
const isDark = () => (root.dataset.colours || (wantsDark.matches ? 'dark' : 'light')) === 'dark';
const label = () => { button.textContent = isDark() ? 'Light colours' : 'Dark colours'; };
button.addEventListener('click', () => {
  root.dataset.colours = isDark() ? 'light' : 'dark';
  label();
});
wantsDark.addEventListener('change', label);
label();
document.querySelector('header').append(button);
addEventListener('beforeprint', () => each(document, 'details', part => { part.open = true; }));
"""
