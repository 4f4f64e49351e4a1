'use strict';

// The action set: one small drawing each, and the chosen one in detail. What is chosen or pointed
// at here is drawn in the scenes too.

const selection = {
  action: null,   // id of the chosen action
  pointed: null,  // id of the one under the pointer
  listeners: [],
  get shown() { return this.pointed ?? this.action; },
  choose(id) {
    this.action = this.action === id ? null : id;
    this.listeners.forEach((tell) => tell());
  },
  point(id) {
    if (this.pointed === id) return;
    this.pointed = id;
    this.listeners.forEach((tell) => tell());
  },
};

const withOrigin = (flat) => [[0, 0], ...pairs(flat)];

function drawActions(data) {
  const body = bodyOf('actions');
  if (!data.actions) {
    return showMissing('actions', data.missing.actions, { reason: 'There is no version to show actions of.' });
  }
  const all = data.actions.list;
  const speeds = data.actions.speeds;
  let speed = Math.max(0, speeds.indexOf(10));
  let withUnused = false;
  const shapeOf = (action) => action.shapes[Math.min(speed, action.shapes.length - 1)];
  const visible = () => all.filter((action) => action.effective || withUnused)
    .sort((a, b) => b.usage - a.usage);
  if (!all.some((action) => action.effective)) withUnused = true;

  const detail = el('div', { class: 'action-detail' });
  const cards = el('ul', { class: 'cards', 'aria-label': 'Actions' });

  function drawCard(action, reach) {
    const shape = shapeOf(action);
    const box = boxAround(reach, 3, 0.95);
    return el('li', {}, el('button', {
      class: 'card', type: 'button', 'data-action': action.id, 'data-effective': action.effective,
      'aria-pressed': selection.action === action.id,
      onclick: () => selection.choose(action.id),
      onpointerenter: () => selection.point(action.id),
      onpointerleave: () => selection.point(null),
    },
    svg('svg', { viewBox: box.join(' '), 'aria-hidden': 'true' },
      svg('g', { transform: UPWARDS }, tube(shape),
        svg('path', { class: 'mean', d: pathOf(withOrigin(shape.mean)) }),
        svg('circle', { class: 'origin', r: box[3] / 60 }))),
    el('span', { class: 'name' }, action.name),
    el('span', { class: 'numbers' }, el('span', {}, `id ${action.id}`), el('span', {}, percent(action.usage))),
    bar(action.usage / Math.max(...all.map((a) => a.usage), 1e-9))));
  }

  function drawDetail() {
    const action = all.find((a) => a.id === selection.shown) || visible()[0];
    const reach = visible().flatMap((a) => pairs(shapeOf(a).mean));
    const own = [...pairs(shapeOf(action).mean), ...shapeOf(action).sigma.flatMap(pairs)];
    const box = boxAround([...reach, ...own], 5, 0.95);
    const drawing = svg('g', { transform: UPWARDS });
    const distances = ticks(0, -box[1], 5).list.filter((metres) => metres > 0).map((metres) => {
      const text = svg('text', { x: box[0] + box[2] * 0.98, y: -metres - box[3] * 0.012, 'text-anchor': 'end' }, `${metres} m`);
      text.style.fontSize = `${box[3] * 0.036}px`;
      return [svg('line', { class: 'grid-line', x1: box[0], x2: box[0] + box[2], y1: -metres, y2: -metres }), text];
    });
    for (const other of visible()) {
      drawing.append(svg('path', { class: 'other', d: pathOf(withOrigin(shapeOf(other).mean)) }));
    }
    drawing.append(tube(shapeOf(action)));
    for (const sigma of shapeOf(action).sigma) {
      drawing.append(svg('path', { class: 'sigma', d: pathOf(withOrigin(sigma)) }));
    }
    drawing.append(svg('path', { class: 'mean', d: pathOf(withOrigin(shapeOf(action).mean)) }));
    drawing.append(svg('circle', { class: 'origin', r: box[3] / 110 }));
    detail.replaceChildren(el('div', { class: 'split' },
      svg('svg', { class: 'chart', viewBox: box.join(' '), role: 'img',
        'aria-label': `${action.name} among the other actions` },
      distances.flat(), drawing),
      el('div', {}, el('h3', {}, action.name), el('dl', { class: 'pairs' }, detailRows(action, shapeOf(action), data)))));
  }

  function drawCards() {
    const reach = visible().flatMap((action) => pairs(shapeOf(action).mean));
    cards.replaceChildren(...visible().map((action) => drawCard(action, reach)));
  }

  selection.listeners.push(() => {
    for (const card of cards.querySelectorAll('.card')) {
      card.setAttribute('aria-pressed', Number(card.dataset.action) === selection.action);
    }
    drawDetail();
  });
  cards.addEventListener('keydown', (event) => {
    const buttons = [...cards.querySelectorAll('.card')];
    const at = buttons.indexOf(document.activeElement);
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (at < 0 || !step) return;
    event.preventDefault();
    buttons[(at + step + buttons.length) % buttons.length].focus();
  });

  const controls = el('div', { class: 'controls' });
  if (speeds.length > 1) {
    controls.append(el('fieldset', { class: 'choices' }, el('legend', {}, 'Drawn for a target at'),
      speeds.map((value, i) => el('label', {}, el('input', { type: 'radio', name: 'speed', value,
        checked: i === speed, onchange: () => { speed = i; drawCards(); drawDetail(); } }), `${value} m/s`))));
  }
  const unused = all.filter((action) => !action.effective).length;
  if (unused > 0 && !withUnused) {
    controls.append(el('label', { class: 'field' }, el('input', { type: 'checkbox',
      onchange: (event) => { withUnused = event.target.checked; drawCards(); drawDetail(); } }),
    `also the ${unused} that are never given 5 %`));
  }
  drawCards();
  drawDetail();
  body.replaceChildren(controls, el('div', { class: 'actions' }, detail, cards));
}

const bar = (share) => {
  const inner = el('span');
  inner.style.width = `${100 * Math.max(0, Math.min(1, share))}%`;
  return el('span', { class: 'bar' }, inner);
};

function detailRows(action, shape, data) {
  const end = pairs(shape.mean).at(-1) || [0, 0];
  const rows = [
    ['id', action.id],
    ['mean p(y|s), held out', percent(action.usage)],
    ['ends', `${fixed(end[0], 1)} m ahead, ${fixed(Math.abs(end[1]), 1)} m ${end[1] < 0 ? 'right' : 'left'}`],
    ['after', data.times.length ? `${fixed(data.times.at(-1), 1)} s` : '\u2013'],
  ];
  if (action.label) rows.push(['label', action.label]);
  if (action.use) {
    rows.push(['mean p(y|s), evaluated', percent(action.use.probability)],
      ['largest p(y|s)', percent(action.use.largest)],
      ['examples that were it', count(action.use.examples)]);
    if (action.use.relative) rows.push(['mostly', `${words(action.use.relative)}, ${percent(action.use.relativeShare, 0)}`]);
    if (action.use.kinematic) rows.push(['by its path', `${words(action.use.kinematic)}, ${percent(action.use.kinematicShare, 0)}`]);
  }
  return rows.flatMap(([name, value]) => [el('dt', {}, name), el('dd', {}, value)]);
}
