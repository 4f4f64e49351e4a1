'use strict';

// Elements, numbers as text, and coordinates. Everything that the data says becomes a text node or
// an attribute value: nothing of it is ever parsed as HTML.

const SVG = 'http://www.w3.org/2000/svg';

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined) continue;
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (typeof value === 'boolean' && !/^(aria|data)-/.test(name)) element.toggleAttribute(name, value);
    else element.setAttribute(name, String(value));
  }
  for (const child of children.flat()) {
    if (child === null || child === undefined) continue;
    element.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return element;
}

// el('p', {class: 'lead', onclick: f}, 'text', element, ...)
const el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
const byId = (id) => document.getElementById(id);
const bodyOf = (section) => document.querySelector(`#${section} .body`);

// Numbers; a missing one is a dash.
const isNumber = (value) => typeof value === 'number' && Number.isFinite(value);
const fixed = (value, digits) =>
  (isNumber(value) ? value.toFixed(digits).replace(/^-(?=[0.]*$)/, '').replace('-', '\u2212') : '\u2013');
const percent = (value, digits = 1) => (isNumber(value) ? `${fixed(100 * value, digits)}\u00a0%` : '\u2013');
const signed = (value, digits) => (value > 0 ? '+' : '') + fixed(value, digits);
const count = (value) => (isNumber(Number(value)) ? Number(value).toLocaleString('en') : '\u2013');
const significant = (value) => {
  if (!isNumber(value)) return '\u2013';
  const size = Math.abs(value);
  return fixed(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
};
const inUnit = (value, unit) => {
  if (unit === 'share') return percent(value);
  if (unit === 'm') return fixed(value, 2);
  return Number.isInteger(value) ? fixed(value, 0) : significant(value);
};

// "left_turn" -> "left turn", "<=10" -> "\u2264 10"; "models/town/versions/3" -> "town/3".
const words = (name) =>
  String(name).replaceAll('_', ' ').replace('<=', '\u2264 ').replace('>=', '\u2265 ').replace(/^u turn$/, 'U-turn');
const shortName = (name) =>
  String(name).replace(/^(models|datasets|jobs)\//, '').replace('/versions/', '/');

// Says why a part is empty and what fills it.
function showMissing(section, missing, fallback) {
  const what = missing || fallback;
  bodyOf(section).replaceChildren(el('div', { class: 'missing' }, what.reason,
    what.command ? el('code', {}, what.command) : null));
}

// [x0, y0, x1, y1, ...] as pairs.
function pairs(flat) {
  const points = [];
  for (let i = 0; i + 1 < flat.length; i += 2) points.push([flat[i], flat[i + 1]]);
  return points;
}

// In drawings of the road the target's heading is upwards: x is up, y is to the left.
const UPWARDS = 'matrix(0 -1 -1 0 0 0)';
const pathOf = (points, closed) =>
  points.length ? `M${points.map((p) => p.join(' ')).join('L')}${closed ? 'Z' : ''}` : '';

// Two-sigma ellipses of the waypoints, as one layer.
function tube(shape) {
  const group = svg('g', { class: 'tube' });
  pairs(shape.mean).forEach(([x, y], t) => {
    const [xx, xy, yy] = shape.cov.slice(3 * t, 3 * t + 3);
    if (yy === undefined) return;
    const middle = (xx + yy) / 2;
    const spread = Math.hypot((xx - yy) / 2, xy);
    group.append(svg('ellipse', {
      rx: 2 * Math.sqrt(Math.max(0, middle + spread)),
      ry: 2 * Math.sqrt(Math.max(0, middle - spread)),
      transform: `translate(${x} ${y}) rotate(${(Math.atan2(2 * xy, xx - yy) * 90) / Math.PI})`,
    }));
  });
  return group;
}

// The least box [left, top, width, height] of a drawing, in its own upward coordinates, that holds
// all points and has the shape of width : height.
function boxAround(points, margin, shape) {
  let [left, right, top, bottom] = [0, 0, 0, 0];
  for (const [x, y] of points) {
    left = Math.min(left, -y);
    right = Math.max(right, -y);
    top = Math.min(top, -x);
    bottom = Math.max(bottom, -x);
  }
  let width = right - left + 2 * margin;
  let height = bottom - top + 2 * margin;
  const middle = [(left + right) / 2, (top + bottom) / 2];
  if (width / height < shape) width = height * shape;
  else height = width / shape;
  return [middle[0] - width / 2, middle[1] - height / 2, width, height];
}

// A table that scrolls sideways where it does not fit.
//   columns: [{title, number, cell: (row) => text or element}]; the first one heads its rows
//   group: (row) => heading over rows that share it, if any
function table(caption, columns, rows, group) {
  const body = el('tbody');
  let last;
  for (const row of rows) {
    const heading = group ? group(row) : undefined;
    if (heading !== last) {
      body.append(el('tr', { class: 'group' },
        el('th', { colspan: columns.length, scope: 'rowgroup' }, heading)));
      last = heading;
    }
    body.append(el('tr', {}, columns.map((column, i) =>
      el(i ? 'td' : 'th', { class: column.number ? 'number' : 'text', scope: i ? null : 'row' },
        column.cell(row)))));
  }
  return el('div', { class: 'table', role: 'region', 'aria-label': caption, tabindex: '0' },
    el('table', {},
      el('caption', { class: 'hidden-text' }, caption),
      el('thead', {}, el('tr', {}, columns.map((column) =>
        el('th', { class: column.number ? 'number' : null, scope: 'col' }, column.title)))),
      body));
}
