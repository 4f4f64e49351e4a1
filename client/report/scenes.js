'use strict';

// Scenes: one large view with pan, zoom and time, its answers beside it, and small drawings of all
// scenes to choose from.

// Why a scene was chosen: as a heading, and as a word on its drawing.
const GROUPS = {
  worst: 'Worst', best: 'Best', surprising: 'Most surprising', typical: 'Typical of a class',
};
const BADGES = { worst: 'Worst', best: 'Best', surprising: 'Surprising', typical: 'Typical' };

function drawMap(scene) {
  const layer = svg('g');
  for (const kind of ['area', 'line', 'lane', 'bike', 'edge', 'stop']) {
    const lines = scene.map[kind];
    if (lines) layer.append(svg('path', { class: kind, d: lines.map((line) => pathOf(pairs(line), kind === 'area')).join('') }));
  }
  for (const [place] of (scene.map.sign || []).map(pairs)) {
    layer.append(svg('circle', { class: 'sign', cx: place[0], cy: place[1], r: 0.7 }));
  }
  return layer;
}

// The state [x, y, heading] of an agent at a time, or null while it is out of sight.
function stateAt(agent, time) {
  const s = agent.states;
  const last = s.length - 4;
  if (time < s[0] - 0.06 || time > s[last] + 0.06) return null;
  let i = 0;
  while (i < last && s[i + 4] <= time) i += 4;
  if (i === last) return s.slice(i + 1, i + 4);
  const share = Math.max(0, Math.min(1, (time - s[i]) / (s[i + 4] - s[i])));
  const turn = Math.atan2(Math.sin(s[i + 7] - s[i + 3]), Math.cos(s[i + 7] - s[i + 3]));
  return [s[i + 1] + share * (s[i + 5] - s[i + 1]), s[i + 2] + share * (s[i + 6] - s[i + 2]), s[i + 3] + share * turn];
}

// Where a trajectory from the origin is at a time: [x, y].
function waypointAt(flat, times, time) {
  const points = withOrigin(flat);
  const at = [0, ...times];
  let i = 0;
  while (i < points.length - 2 && at[i + 1] <= time) ++i;
  const share = Math.max(0, Math.min(1, (time - at[i]) / (at[i + 1] - at[i] || 1)));
  return [0, 1].map((k) => points[i][k] + share * (points[i + 1][k] - points[i][k]));
}

const wasAction = (scene) => scene.q.indexOf(Math.max(...scene.q));
const mostProbable = (scene) => scene.p.indexOf(Math.max(...scene.p));
const actionOf = (scene, id) => scene.actions.find((action) => action.id === id);
const reachOf = (scene) => [...pairs(scene.truth), ...scene.actions.filter((a) => a.p >= 0.05).flatMap((a) => pairs(a.mean))];

class SceneView {
  constructor(data, names) {
    this.data = data;
    this.names = names;
    this.horizon = data.times.at(-1) || 0;
    this.time = 0;
    this.playing = false;
    this.map = svg('svg', { class: 'map', tabindex: '0', role: 'group', 'aria-roledescription': 'scene', 'aria-describedby': 'scene-keys' });
    this.scale = el('span', { class: 'scale' });
    this.slider = el('input', { type: 'range', min: -1, max: this.horizon, step: 0.1, value: 0, 'aria-label': 'Time',
      oninput: () => this.go(Number(this.slider.value)) });
    this.clock = el('output');
    this.play = el('button', { class: 'plain', type: 'button', onclick: () => this.toggle() }, 'Play');
    this.answers = el('ul', { class: 'answers', 'aria-label': 'Actions in this scene' });
    this.facts = el('div');
    const zoom = (label, title, act) =>
      el('button', { class: 'plain', type: 'button', 'aria-label': title, title, onclick: act }, label);
    this.root = el('div', { class: 'scene' },
      el('div', {},
        el('div', { class: 'view' }, this.map,
          el('div', { class: 'zoom' }, zoom('+', 'Zoom in', () => this.zoom(1.4)),
            zoom('\u2212', 'Zoom out', () => this.zoom(1 / 1.4)), zoom('\u2922', 'Show all', () => this.fit())),
          this.scale),
        el('div', { class: 'timeline' }, this.play, this.slider, this.clock),
        el('p', { class: 'lead', id: 'scene-keys' },
          el('span', { class: 'key did' }, 'what it did'), ' ', el('span', { class: 'key predicted' }, 'predicted, with two sigma'),
          el('span', { class: 'keys' }, '. Drag or arrow keys move the view, + and \u2212 zoom, 0 shows all, comma and full stop step through time, space plays.'))),
      el('div', {}, this.facts, this.answers));
    this.listen();
  }

  show(scene) {
    this.scene = scene;
    const layer = svg('g', { transform: UPWARDS }, drawMap(scene));
    this.predictions = svg('g');
    this.agents = scene.agents.map((agent) => {
      const target = agent.id === scene.target;
      const nose = agent.length / 2;
      return { agent, box: svg('path', { class: target ? 'agent target' : 'agent',
        d: pathOf([[-nose, -agent.width / 2], [nose * 0.6, -agent.width / 2], [nose, 0], [nose * 0.6, agent.width / 2], [-nose, agent.width / 2]], true) },
      svg('title', {}, `${agent.kind} ${agent.id}${target ? ', the target' : ''}`)) };
    });
    this.lights = scene.signals.map((signal) => ({ signal, dot: svg('circle', { cx: signal.x, cy: signal.y, r: 0.9 }) }));
    const target = scene.agents.find((agent) => agent.id === scene.target);
    const past = [];
    for (let i = 0; target && i < target.states.length && target.states[i] <= 0; i += 4) past.push([target.states[i + 1], target.states[i + 2]]);
    this.truthDot = svg('circle', { class: 'truth-dot', r: 0.75 });
    layer.append(...this.lights.map((l) => l.dot), svg('path', { class: 'trail', d: pathOf(past) }), this.predictions,
      ...this.agents.map((a) => a.box).reverse(), svg('path', { class: 'truth', d: pathOf(withOrigin(scene.truth)) }), this.truthDot);
    this.map.replaceChildren(layer);
    this.map.setAttribute('aria-label', `Scene ${scene.id}, target ${scene.target}: ${words(scene.class)}`);
    this.drawFacts();
    this.choose();
    this.fit();
    this.go(0);
  }

  // Draws the actions that are chosen: that of the whole report, or the most probable one.
  choose() {
    const scene = this.scene;
    const shown = actionOf(scene, selection.shown) ? selection.shown : mostProbable(scene);
    this.predictions.replaceChildren();
    this.dots = [];
    for (const action of [...scene.actions].sort((a, b) => (a.id === shown) - (b.id === shown) || a.p - b.p)) {
      const bold = action.id === shown;
      if (!bold && action.p < 0.02) continue;
      if (bold) this.predictions.append(tube(action));
      const strength = bold ? 1 : 0.25 + 0.5 * Math.sqrt(action.p);
      this.predictions.append(svg('path', { class: 'mean', d: pathOf(withOrigin(action.mean)), opacity: strength,
        'stroke-width': 2 }, svg('title', {}, `${this.names(action.id)}, ${percent(action.p)}`)));
      const dot = svg('circle', { class: 'mean-dot', r: bold ? 0.7 : 0.45, opacity: strength });
      this.dots.push({ dot, action });
      this.predictions.append(dot);
    }
    const was = wasAction(scene);
    const listed = scene.actions.map((action) => action.id);
    if (!listed.includes(was)) listed.push(was);
    listed.sort((a, b) => scene.p[b] - scene.p[a]);
    this.answers.replaceChildren(...listed.map((id) => el('li', {}, el('button', {
      type: 'button', 'aria-pressed': id === shown, 'data-action': id, onclick: () => {
        if (selection.action !== id) selection.choose(id);
      } },
    el('span', {}, this.names(id), id === was ? el('span', { class: 'was' }, ' \u2190 it was this') : null),
    el('span', {}, percent(scene.p[id])), bar(scene.p[id])))));
    this.go(this.time);
  }

  drawFacts() {
    const s = this.scene;
    const rows = [['recording', s.id], ['target', s.target], ['at', `${fixed(s.time, 2)} s`], ['speed', `${fixed(s.speed, 1)} m/s`],
      ['it does', words(s.class)], ['ADE, k = 1', `${fixed(s.ade1, 2)} m`], ['minADE, k = 6', `${fixed(s.minAde6, 2)} m`],
      ['surprise', `${fixed(s.surprise, 2)} nats`], ['shown as', s.groups.map((g) => GROUPS[g] || g).join(', ').toLowerCase()]];
    this.facts.replaceChildren(el('dl', { class: 'pairs' }, rows.flatMap(([name, value]) => [el('dt', {}, name), el('dd', {}, value)])));
  }

  go(time) {
    this.time = Math.max(-1, Math.min(this.horizon, time));
    this.slider.value = this.time;
    const text = `${signed(this.time, 1)} s`;
    this.clock.textContent = text;
    this.slider.setAttribute('aria-valuetext', text);
    for (const { agent, box } of this.agents) {
      const state = stateAt(agent, this.time);
      box.setAttribute('visibility', state ? 'visible' : 'hidden');
      if (state) box.setAttribute('transform', `translate(${state[0]} ${state[1]}) rotate(${(state[2] * 180) / Math.PI})`);
    }
    for (const { signal, dot } of this.lights) {
      let light = 0;
      for (let i = 0; i + 1 < signal.states.length && signal.states[i] <= this.time; i += 2) light = signal.states[i + 1];
      dot.setAttribute('class', `light-${light}`);
    }
    const ahead = Math.max(0, this.time);
    const place = (dot, [x, y]) => { dot.setAttribute('cx', x); dot.setAttribute('cy', y); };
    place(this.truthDot, waypointAt(this.scene.truth, this.data.times, ahead));
    for (const dot of [this.truthDot, ...(this.dots || []).map((d) => d.dot)]) {
      dot.setAttribute('visibility', this.time > 0 ? 'visible' : 'hidden');
    }
    for (const { dot, action } of this.dots || []) place(dot, waypointAt(action.mean, this.data.times, ahead));
  }

  toggle() {
    this.playing = !this.playing;
    this.play.textContent = this.playing ? 'Pause' : 'Play';
    if (!this.playing) return;
    if (this.time >= this.horizon - 0.05) this.go(-1);
    let before = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.go(this.time + (now - before) / 1000);
      before = now;
      if (this.time >= this.horizon) this.toggle();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  fit() {
    const box = this.map.getBoundingClientRect();
    this.look(boxAround(reachOf(this.scene), 14, box.width && box.height ? box.width / box.height : 1.4));
  }

  look(box) {
    this.box = box;
    this.map.setAttribute('viewBox', box.join(' '));
    const size = this.map.getBoundingClientRect();
    if (!size.width) return;
    const pixels = Math.min(size.width / box[2], size.height / box[3]);
    const length = [1, 2, 5, 10, 20, 50, 100, 200].findLast((metres) => metres * pixels <= 110) || 1;
    this.scale.textContent = `${length} m`;
    this.scale.style.width = `${length * pixels}px`;
  }

  // Zooms about a place of the view, given as shares of its width and height.
  zoom(factor, across = 0.5, down = 0.5) {
    const [left, top, width, height] = this.box;
    if ((width < 8 && factor > 1) || (width > 800 && factor < 1)) return;
    this.look([left + across * width * (1 - 1 / factor), top + down * height * (1 - 1 / factor), width / factor, height / factor]);
  }

  pan(across, down) {
    const [left, top, width, height] = this.box;
    this.look([left + across * width, top + down * height, width, height]);
  }

  listen() {
    const fingers = new Map();
    const shares = (event) => {
      const size = this.map.getBoundingClientRect();
      return [(event.clientX - size.left) / size.width, (event.clientY - size.top) / size.height];
    };
    this.map.addEventListener('pointerdown', (event) => {
      fingers.set(event.pointerId, shares(event));
      this.map.setPointerCapture(event.pointerId);
    });
    this.map.addEventListener('pointermove', (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = shares(event);
      const other = [...fingers].find(([id]) => id !== event.pointerId);
      if (other) {
        const apart = (a) => Math.hypot(a[0] - other[1][0], a[1] - other[1][1]);
        if (apart(before) > 0) this.zoom(apart(now) / apart(before), other[1][0], other[1][1]);
      } else this.pan(before[0] - now[0], before[1] - now[1]);
      fingers.set(event.pointerId, now);
    });
    for (const over of ['pointerup', 'pointercancel']) {
      this.map.addEventListener(over, (event) => fingers.delete(event.pointerId));
    }
    // The page scrolls past a view that nobody has clicked into.
    this.map.addEventListener('wheel', (event) => {
      if (document.activeElement !== this.map && !event.ctrlKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.002 * event.deltaY), ...shares(event));
    }, { passive: false });
    this.map.addEventListener('keydown', (event) => {
      const act = {
        ArrowLeft: () => this.pan(-0.1, 0), ArrowRight: () => this.pan(0.1, 0), ArrowUp: () => this.pan(0, -0.1), ArrowDown: () => this.pan(0, 0.1),
        '+': () => this.zoom(1.4), '=': () => this.zoom(1.4), '-': () => this.zoom(1 / 1.4), 0: () => this.fit(),
        ',': () => this.go(this.time - 0.2), '.': () => this.go(this.time + 0.2), ' ': () => this.toggle(),
      }[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
    });
    window.addEventListener('resize', () => this.scene && this.fit());
  }
}

// A scene in small: the road, what the target did, and the action that the model thought likeliest.
function thumbnail(scene) {
  const likeliest = actionOf(scene, mostProbable(scene));
  const box = boxAround([...pairs(scene.truth), ...(likeliest ? pairs(likeliest.mean) : [])], 9, 1.3);
  return svg('svg', { viewBox: box.join(' '), 'aria-hidden': 'true' }, svg('g', { transform: UPWARDS }, drawMap(scene),
    likeliest ? svg('path', { class: 'mean', d: pathOf(withOrigin(likeliest.mean)) }) : null,
    svg('path', { class: 'truth', d: pathOf(withOrigin(scene.truth)) }),
    svg('circle', { class: 'origin', r: box[3] / 40 })));
}

function drawScenes(data) {
  if (!data.scenes.length) {
    return showMissing('scenes', data.missing.scenes, { reason: 'There are no scenes to show.' });
  }
  const list = data.actions ? data.actions.list : [];
  const names = (id) => (list.find((action) => action.id === id) || { name: `action ${id}` }).name;
  byId('scenes-lead').textContent = `${data.scenes.length} examples of ${shortName(data.scenesFrom)}, chosen among up to twelve of each of at most 24 recordings: `
    + 'the worst by minADE of six actions, the best by ADE of the most probable one, those where the target did what the model thought least probable, and typical ones of each class.'
    + (data.scenesLeftOut ? ` ${data.scenesLeftOut} more did not fit into the page.` : '');
  const view = new SceneView(data, names);
  const thumbs = el('ul', { class: 'thumbs', 'aria-label': 'Scenes' });
  let current = 0;
  const show = (index) => {
    current = index;
    for (const card of thumbs.querySelectorAll('.card')) card.setAttribute('aria-pressed', Number(card.dataset.scene) === index);
    view.show(data.scenes[index]);
  };

  // What can be asked for: [value, title, whether a scene belongs to it]. Each has a scene.
  const distinct = (values) => [...new Set(values)].sort();
  const filters = [['all', `All ${data.scenes.length}`, () => true]];
  for (const [group, title] of Object.entries(GROUPS)) {
    const belongs = (s) => s.groups.includes(group);
    if (data.scenes.some(belongs)) filters.push([`group ${group}`, title, belongs]);
  }
  for (const name of distinct(data.scenes.map((s) => s.class))) filters.push([`class ${name}`, words(name), (s) => s.class === name]);
  for (const id of distinct(data.scenes.map(wasAction))) filters.push([`was ${id}`, names(id), (s) => wasAction(s) === id]);
  const options = (start) => filters.filter(([value]) => value.startsWith(start)).map(([value, title]) => el('option', { value }, title));
  const filter = el('select', { id: 'scene-filter', onchange: () => draw() }, options('all'),
    el('optgroup', { label: 'Chosen as' }, options('group')), el('optgroup', { label: 'What the target does' }, options('class')),
    el('optgroup', { label: 'The action that it was' }, options('was')));
  const draw = () => {
    const fits = filters.find(([value]) => value === filter.value)[2];
    const indices = data.scenes.map((_, index) => index).filter((index) => fits(data.scenes[index]));
    thumbs.replaceChildren(...indices.map((index) => {
      const scene = data.scenes[index];
      return el('li', {}, el('button', { class: 'card', type: 'button', 'data-scene': index, 'aria-pressed': 'false', onclick: () => show(index) },
        thumbnail(scene), el('span', { class: 'name' }, words(scene.class)),
        el('span', { class: 'numbers' }, el('span', {}, BADGES[scene.groups[0]] || ''),
          el('span', {}, `${fixed(scene.ade1, scene.ade1 < 9.95 ? 1 : 0)} m`))));
    }));
    show(indices[0]);
  };
  const step = (by) => {
    const shown = [...thumbs.querySelectorAll('.card')].map((card) => Number(card.dataset.scene));
    show(shown[(shown.indexOf(current) + by + shown.length) % shown.length]);
  };
  bodyOf('scenes').replaceChildren(
    el('div', { class: 'controls' }, el('label', { class: 'field' }, 'Show', filter),
      el('button', { class: 'plain', type: 'button', onclick: () => step(-1) }, 'Previous'),
      el('button', { class: 'plain', type: 'button', onclick: () => step(1) }, 'Next')),
    view.root, thumbs);
  selection.listeners.push(() => view.choose());
  draw();
}
