'use strict';

// Charts of numbers: curves over epochs, the reliability diagram, intervals.

// Round numbers that cover [low, high].
function ticks(low, high, wanted) {
  const span = high - low || Math.abs(high) || 1;
  const power = 10 ** Math.floor(Math.log10(span / wanted));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((s) => span / s <= wanted);
  const list = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * span; ++i) list.push(i * step);
  return { step, list };
}

// The digits that tell the ticks apart.
const tickText = (value, step) => fixed(value, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));

// The range of a chart. First epochs that are far from all others would press the rest of a curve
// onto the frame: they leave the range.
function usualRange(series, values) {
  const range = (list) => [Math.min(...list), Math.max(...list)];
  // Noise in the last digits is not made to look like news.
  const wide = ([a, b]) => {
    const least = 0.005 * Math.max(Math.abs(a), Math.abs(b));
    return b > a && b - a < least ? [(a + b - least) / 2, (a + b + least) / 2] : [a, b];
  };
  const later = series.flatMap((s) => s.values.slice(Math.ceil(0.15 * s.values.length))).filter(isNumber);
  const [low, high] = range(values);
  if (later.length < 8) return wide([low, high]);
  const [later_low, later_high] = range(later);
  return wide(high - low > 4 * (later_high - later_low) ? [later_low, later_high] : [low, high]);
}

const PHASES = { pretrain: 'Pretraining', covernet: 'CoverNet-like baseline', multipath: 'MultiPath-like baseline' };
const phaseTitle = (name) => PHASES[name] || words(name).replace(/^./, (letter) => letter.toUpperCase());

// One term over the epochs of a phase. The pointer reads values off.
//   series: [{kind: 'training' or 'held-out' or 'mixture', title, values}]
function curveChart(title, epochs, series) {
  const [width, height, left, right, top, bottom] = [240, 118, 44, 8, 8, 20];
  const values = series.flatMap((s) => s.values).filter(isNumber);
  const value = el('span', { class: 'value' });
  const tell = (prefix, valueOf) => value.replaceChildren(prefix,
    ...series.flatMap((s, i) => [i ? ' ' : '', el('span', { class: s.kind }, significant(valueOf(s)))]));
  const last = () => tell('', (s) => s.values.findLast(isNumber));
  last();
  const chart = svg('svg', { class: 'chart', viewBox: `0 0 ${width} ${height}`, role: 'img',
    'aria-label': `${title}: ${series.map((s) => `${s.title} from ${significant(s.values.find(isNumber))} to ${significant(s.values.findLast(isNumber))}`).join(', ')}` });
  let [low, high] = usualRange(series, values);
  if (!(high > low)) [low, high] = [low - (Math.abs(low) || 1) / 2, high + (Math.abs(high) || 1) / 2];
  const x = (epoch) => left + ((epoch - epochs[0]) / Math.max(1, epochs.at(-1) - epochs[0])) * (width - left - right);
  const y = (v) => top + ((high - v) / (high - low)) * (height - top - bottom);
  const marks = ticks(low, high, 4);
  for (const mark of marks.list) {
    chart.append(svg('line', { class: 'grid-line', x1: left, x2: width - right, y1: y(mark), y2: y(mark) }),
      svg('text', { x: left - 5, y: y(mark) + 4, 'text-anchor': 'end' }, tickText(mark, marks.step)));
  }
  const named = epochs.length > 1 ? [epochs[0], epochs.at(-1)] : epochs;
  named.forEach((epoch, i) => chart.append(svg('text', { x: x(epoch), y: height - 5,
    'text-anchor': i ? 'end' : 'start' }, i || named.length === 1 ? `epoch ${epoch}` : epoch)));
  // An inner drawing cuts off what leaves the range.
  const area = svg('svg', { x: left - 2, y: top - 3, width: width - left - right + 4, height: height - top - bottom + 6,
    viewBox: `${left - 2} ${top - 3} ${width - left - right + 4} ${height - top - bottom + 6}` });
  chart.append(area);
  for (const s of series) {
    const points = s.values.map((v, i) => [x(epochs[i]), v === null ? NaN : y(v)]).filter((p) => isNumber(p[1]));
    area.append(points.length > 1
      ? svg('path', { class: `curve ${s.kind}`, d: pathOf(points) })
      : svg('circle', { class: `curve-dot ${s.kind}`, cx: points[0][0], cy: points[0][1], r: 3 }));
  }
  const cursor = svg('line', { class: 'cursor', y1: top, y2: height - bottom, visibility: 'hidden' });
  chart.append(cursor);
  chart.addEventListener('pointermove', (event) => {
    const box = chart.getBoundingClientRect();
    const at = ((event.clientX - box.left) / box.width) * width;
    const nearest = epochs.reduce((best, epoch, i) =>
      (Math.abs(x(epoch) - at) < Math.abs(x(epochs[best]) - at) ? i : best), 0);
    cursor.setAttribute('x1', x(epochs[nearest]));
    cursor.setAttribute('x2', x(epochs[nearest]));
    cursor.setAttribute('visibility', 'visible');
    tell(`epoch ${epochs[nearest]}: `, (s) => s.values[nearest]);
  });
  chart.addEventListener('pointerleave', () => {
    cursor.setAttribute('visibility', 'hidden');
    last();
  });
  return el('figure', {}, el('figcaption', {}, el('span', { class: 'title' }, title), value), chart);
}

function drawLearning(data) {
  if (!data.learning.length) {
    return showMissing('learning', data.missing.learning, { reason: 'No epoch has been reported.' });
  }
  bodyOf('learning').replaceChildren(...data.learning.flatMap((phase) => {
    const seriesOf = (term) => [
      { kind: 'training', title: 'training', values: term.training || [] },
      { kind: 'held-out', title: 'held-out', values: term.heldOut || [] },
      { kind: 'mixture', title: 'actions', values: term.mixture || [] },
    ].filter((s) => s.values.some((v) => isNumber(v) && v !== 0));
    // The loss first, then the other terms, then what describes the actions.
    const order = (term) => (term.name === 'loss' ? 0 : term.mixture ? 2 : 1);
    const terms = phase.terms.filter((term) => seriesOf(term).length)
      .sort((a, b) => order(a) - order(b));
    const columns = [{ title: 'Epoch', cell: (row) => row.epoch }];
    for (const term of terms) {
      for (const s of seriesOf(term)) {
        columns.push({ title: `${words(term.name)}${s.kind === 'mixture' ? '' : `, ${s.title}`}`, number: true,
          cell: (row) => significant(s.values[row.index]) });
      }
    }
    const rows = phase.epochs.map((epoch, index) => ({ epoch, index }));
    return [
      el('h3', {}, `${phaseTitle(phase.name)}, ${phase.epochs.length} ${phase.epochs.length === 1 ? 'epoch' : 'epochs'}`),
      el('div', { class: 'charts' }, terms.map((term) => curveChart(words(term.name), phase.epochs, seriesOf(term)))),
      el('details', {}, el('summary', {}, 'As a table'),
        table(`Epochs of ${phaseTitle(phase.name)}`, columns, rows)),
    ];
  }));
}

function drawCalibration(data) {
  const bins = data.evaluation ? data.evaluation.reliability.filter((bin) => bin.examples > 0) : [];
  if (!bins.length) return showMissing('calibration', data.missing.evaluation, { reason: 'The evaluation has no bins.' });
  const [size, left, top, bottom, bars] = [330, 40, 10, 34, 60];
  const x = (share) => left + share * size;
  const y = (share) => top + (1 - share) * size;
  const base = top + size + bottom + bars;
  const most = Math.max(...bins.map((bin) => bin.examples));
  const chart = svg('svg', { class: 'chart', viewBox: `0 0 ${left + size + 12} ${base + 34}`, role: 'img',
    'aria-label': `Reliability diagram of ${bins.length} bins; the table beside it has its figures` });
  for (const share of [0, 0.25, 0.5, 0.75, 1]) {
    chart.append(
      svg('line', { class: 'grid-line', x1: x(0), x2: x(1), y1: y(share), y2: y(share) }),
      svg('line', { class: 'grid-line', x1: x(share), x2: x(share), y1: y(0), y2: y(1) }),
      svg('text', { x: x(0) - 6, y: y(share) + 4, 'text-anchor': 'end' }, fixed(share, 2)),
      svg('text', { x: x(share), y: y(0) + 15, 'text-anchor': 'middle' }, fixed(share, 2)));
  }
  chart.append(svg('line', { class: 'diagonal', x1: x(0), x2: x(1), y1: y(0), y2: y(1) }));
  for (const bin of bins) {
    const height = (bin.examples / most) * bars;
    chart.append(svg('rect', { class: 'count', x: x(bin.lower) + 1, width: Math.max(1, (bin.upper - bin.lower) * size - 2),
      y: base - height, height }, svg('title', {}, `${count(bin.examples)} examples`)));
  }
  chart.append(svg('path', { class: 'curve held-out', d: pathOf(bins.map((bin) => [x(bin.confidence), y(bin.responsibility)])) }));
  for (const bin of bins) {
    chart.append(svg('circle', { class: 'point', cx: x(bin.confidence), cy: y(bin.responsibility), r: 4.5 },
      svg('title', {}, `called ${percent(bin.confidence)}, was ${percent(bin.responsibility)}, ${count(bin.examples)} examples`)));
  }
  chart.append(svg('line', { class: 'axis-line', x1: x(0), x2: x(1), y1: base, y2: base }),
    svg('text', { x: x(0), y: base + 16 }, 'p(y|s) of the most probable action'));
  const columns = [
    { title: 'Between', cell: (bin) => `${percent(bin.lower, 0)} and ${percent(bin.upper, 0)}` },
    { title: 'Examples', number: true, cell: (bin) => count(bin.examples) },
    { title: 'Called', number: true, cell: (bin) => percent(bin.confidence) },
    { title: 'Was', number: true, cell: (bin) => percent(bin.responsibility) },
    { title: 'Off by, points', number: true, cell: (bin) => signed(100 * (bin.responsibility - bin.confidence), 1) },
  ];
  bodyOf('calibration').replaceChildren(el('div', { class: 'calibration' },
    el('figure', {}, chart), table('Reliability by bin', columns, bins)));
}

// A difference with its interval, about a zero line. The scale goes from -limit to +limit.
function interval(difference, limit) {
  const x = (v) => 60 + (Math.max(-limit, Math.min(limit, v)) / limit) * 56;
  return svg('svg', { viewBox: '0 0 120 18', 'aria-hidden': 'true' },
    svg('line', { class: 'axis-line', x1: 60, x2: 60, y1: 1, y2: 17 }),
    svg('line', { class: `whisker ${difference.verdict}`, x1: x(difference.lower), x2: x(difference.upper), y1: 9, y2: 9 }),
    svg('circle', { class: `mark ${difference.verdict}`, cx: x(difference.value), cy: 9, r: 3.5 }));
}
