'use strict';

// Everything that is a table: figures beside the baselines, rivals, strata, versions, settings,
// provenance.

// [metric, title, unit] in the order in which they are listed.
const MAIN = [
  ['ade_1', 'ADE, k = 1, m', 'm'], ['fde_1', 'FDE, k = 1, m', 'm'], ['miss_rate_1', 'missed, k = 1', 'share'],
  ['ade_medoid', 'ADE of the medoid, m', 'm'], ['min_ade_6', 'minADE, k = 6, m', 'm'], ['min_fde_6', 'minFDE, k = 6, m', 'm'],
  ['miss_rate_6', 'missed, k = 6', 'share'], ['brier_fde_6', 'brier-minFDE, k = 6, m', 'm'], ['nll', 'NLL a waypoint, nats', 'nats'],
  ['nll_joint', 'NLL a trajectory, nats', 'nats'], ['coverage_1sigma', 'truth within 1 sigma', 'share'], ['coverage_2sigma', 'truth within 2 sigma', 'share'],
  ['calibration_error', 'calibration error', 'share'], ['effective_actions', 'effective actions', ''], ['mutual_information', 'I(y;s), nats', 'nats'],
  ['purity_relative', 'purity, relative classes', 'share'],
];
const titleOf = (metric) => (MAIN.find(([name]) => name === metric) || [metric, words(metric)])[1];
const unitOf = (metric) => (MAIN.find(([name]) => name === metric) || [])[2];

// The predictors that stand in columns: how the name of their metric follows from the model's.
const PREDICTORS = [
  ['Model', (metric) => metric], ['Generic', (metric) => `${metric}_prior`], ['CoverNet-like', (metric) => `covernet_${metric}`], ['MultiPath-like', (metric) => `multipath_${metric}`],
  ['Constant velocity', (metric) => `${metric.replace(/_1$/, '')}_cv`], ['CTRA', (metric) => `${metric.replace(/_1$/, '')}_ctra`], ['Faded', (metric) => `${metric.replace(/_1$/, '')}_faded`],
];

function drawHeadline(data) {
  const metrics = data.evaluation ? data.evaluation.metrics : (data.model || {}).heldOut || [];
  const value = new Map(metrics.map((metric) => [metric.name, metric.value]));
  const cells = ['ade_1', 'min_ade_6', 'miss_rate_6', 'nll', 'calibration_error', 'effective_actions'].filter((name) => value.has(name))
    .map((name) => {
      const unit = unitOf(name);
      const [number, sign] = unit === 'share' ? [fixed(100 * value.get(name), 1), '%'] : unit === 'm' ? [fixed(value.get(name), 2), 'm'] : unit === 'nats' ? [fixed(value.get(name), 2), 'nats'] : [fixed(value.get(name), 0), ''];
      return el('div', {}, el('dt', {}, titleOf(name).replace(/, (m|nats)$/, '')), el('dd', {}, number, el('small', {}, ` ${sign}`)));
    });
  byId('headline').replaceChildren(...cells);
}

function drawFigures(data) {
  const metrics = data.evaluation ? data.evaluation.metrics : (data.model || {}).heldOut || [];
  if (!metrics.length) return showMissing('figures', data.missing.evaluation, { reason: 'Nothing was measured.' });
  const value = new Map(metrics.map((metric) => [metric.name, metric.value]));
  const rows = MAIN.filter(([name]) => value.has(name));
  const columns = [{ title: 'Metric', cell: ([, title]) => title }];
  for (const [title, nameOf] of PREDICTORS) {
    if (!rows.some(([name]) => value.has(nameOf(name)))) continue;
    columns.push({ title, number: true, cell: ([name, , unit]) => (value.has(nameOf(name)) ? inUnit(value.get(nameOf(name)), unit) : '') });
  }
  const every = [{ title: 'Metric', cell: (m) => el('code', {}, m.name) }, { title: 'Value', number: true, cell: (m) => fixed(m.value, 4) },
    { title: 'Unit', cell: (m) => m.unit || '' }, { title: 'Better', cell: (m) => (m.better === 'nearer' ? `nearer ${fixed(m.ideal, 3)}` : m.better || '') }];
  bodyOf('figures').replaceChildren(
    data.evaluation ? '' : el('p', { class: 'lead' }, 'There is no evaluation: these are of the recordings that the training held out.'),
    table('Main figures beside other predictors', columns, rows),
    el('details', {}, el('summary', {}, `All ${metrics.length} figures`), table('All figures', every, metrics)));
}

function drawRivals(data) {
  const rivals = data.evaluation && data.evaluation.rivals;
  const parts = rivals ? rivals.parts.filter((part) => part.comparisons.length) : [];
  if (!parts.length) {
    return showMissing('rivals', data.missing.evaluation, { reason: 'There are too few examples to compare: at least 50 are needed.' });
  }
  const metrics = [...new Set(parts.flatMap((part) => part.comparisons.map((c) => c.metric)))];
  const holder = el('div');
  const draw = (metric) => {
    const of = (part, rival) => part.comparisons.find((c) => c.metric === metric && c.rival === rival);
    const names = [...new Set(parts.flatMap((part) => part.comparisons.filter((c) => c.metric === metric).map((c) => c.rival)))];
    const sizes = parts.flatMap((part) => names.map((name) => of(part, name))).filter(Boolean).map((c) => Math.max(Math.abs(c.lower), Math.abs(c.upper))).sort((a, b) => a - b);
    const limit = (sizes[Math.floor(0.9 * (sizes.length - 1))] || 1) * 1.1;
    const share = unitOf(metric) === 'share';
    const text = (c) => (share ? `${signed(100 * c.value, 1)} %` : signed(c.value, 2));
    holder.replaceChildren(table(`Differences of ${titleOf(metric)} to each rival`, [
      { title: 'Part', cell: (part) => (part.name ? words(part.name) : 'all') },
      { title: 'Examples', number: true, cell: (part) => count(part.examples) },
      ...names.map((name) => ({ title: rivals.titles[name] || name, cell: (part) => {
        const c = of(part, name);
        return c ? el('span', { class: 'rival' }, interval(c, limit), el('span', { class: { ahead: 'better', behind: 'worse' }[c.verdict] },
          text(c), c.verdict === 'ahead' ? el('span', { class: 'hidden-text' }, ' ahead') : c.verdict === 'behind' ? ' behind' : ' ?')) : '';
      } }))], parts, (part) => part.dimension ? `by ${part.dimension}` : undefined));
  };
  const select = el('select', { onchange: (event) => draw(event.target.value) }, metrics.map((metric) => el('option', { value: metric }, titleOf(metric))));
  bodyOf('rivals').replaceChildren(
    el('div', { class: 'controls' }, el('label', { class: 'field' }, 'Metric', select)), holder,
    el('p', { class: 'lead' }, `${count(rivals.recordings)} recordings in ${count(rivals.groups)} groups that share no place and no drive. A question mark: these recordings cannot tell.`));
  draw(metrics[0]);
}

function drawStrata(data) {
  const strata = data.evaluation ? data.evaluation.strata : [];
  if (!strata.length) return showMissing('strata', data.missing.evaluation, { reason: 'The evaluation has no strata.' });
  const errors = ['ade_1', 'ade_cv', 'ade_ctra', 'ade_faded'];
  const cell = (name, unit) => (row) => {
    const value = row.metrics[name];
    if (value === undefined) return '';
    const best = errors.includes(name) && value === Math.min(...errors.map((n) => row.metrics[n]).filter(isNumber));
    return best ? el('strong', {}, inUnit(value, unit)) : inUnit(value, unit);
  };
  const columns = [['ADE, m', 'ade_1', 'm'], ['of CV', 'ade_cv', 'm'], ['of CTRA', 'ade_ctra', 'm'], ['of faded', 'ade_faded', 'm'], ['minADE, k = 6', 'min_ade_6', 'm'],
    ['missed, k = 6', 'miss_rate_6', 'share'], ['NLL', 'nll', 'nats'], ['within 2 sigma', 'coverage_2sigma', 'share'], ['calibration error', 'calibration_error', 'share']]
    .filter(([, name]) => strata.some((row) => name in row.metrics))
    .map(([title, name, unit]) => ({ title, number: true, cell: cell(name, unit) }));
  bodyOf('strata').replaceChildren(table('Figures of each stratum', [{ title: 'Examples by', cell: (row) => words(row.name) },
    { title: 'Examples', number: true, cell: (row) => count(row.examples) }, ...columns], strata, (row) => `by ${row.dimension}`));
}

function drawVersions(data) {
  if (!data.evaluation) return showMissing('versions', data.missing.evaluation);
  if (!data.others.length) {
    return showMissing('versions', null, { reason: 'No other version of this model was evaluated on the same examples.',
      command: `maneuver evaluate ${shortName(data.model.name).split('/')[0]}/VERSION --dataset ${shortName(data.evaluation.dataset)}` });
  }
  const own = new Map(data.evaluation.metrics.map((metric) => [metric.name, metric]));
  const rows = MAIN.filter(([name]) => own.has(name) && data.others.some((other) => name in other.metrics));
  // How far a value is from the best that it can be.
  const badness = (metric, value) => (metric.better === 'higher' ? -value : metric.better === 'nearer' ? Math.abs(value - metric.ideal) : value);
  const columns = [{ title: 'Metric', cell: ([, title]) => title },
    { title: `${shortName(data.model.name)}, this one`, number: true, cell: ([name, , unit]) => inUnit(own.get(name).value, unit) }];
  for (const other of data.others) {
    columns.push({ title: shortName(other.version), number: true, cell: ([name, , unit]) => {
      const value = other.metrics[name];
      if (!isNumber(value)) return '';
      const metric = own.get(name);
      const difference = badness(metric, value) - badness(metric, metric.value);
      const verdict = !metric.better || difference === 0 ? null : difference < 0 ? 'better' : 'worse';
      return el('span', { class: verdict, title: verdict }, inUnit(value, unit), verdict ? el('span', { class: 'hidden-text' }, ` ${verdict}`) : null);
    } });
  }
  bodyOf('versions').replaceChildren(table('Versions on the same examples', columns, rows),
    el('p', { class: 'lead' }, el('span', { class: 'better' }, 'Blue'), ' is better than this version, ', el('span', { class: 'worse' }, 'red'), ' is worse. maneuver model compare has strata too.'));
}

// {a: {b: 1}} as [["a.b", "1"]].
function flat(object, path = '') {
  return Object.entries(object).flatMap(([name, value]) => {
    const at = path ? `${path}.${name}` : name;
    if (value && typeof value === 'object' && !Array.isArray(value)) return flat(value, at);
    return [[at, Array.isArray(value) ? value.map((v) => (typeof v === 'object' ? JSON.stringify(v) : v)).join(', ') : String(value)]];
  });
}

function drawSettings(data) {
  if (!data.model) return showMissing('settings', data.missing.settings, { reason: 'There is no version yet.' });
  const columns = [{ title: 'Setting', cell: ([name]) => el('code', {}, name) }, { title: 'Value', cell: ([, value]) => value }];
  const settings = flat(data.model.settings);
  const groupOf = ([name]) => (name.includes('.') ? name.split('.')[0] : '');
  bodyOf('settings').replaceChildren(...[...new Set(settings.map(groupOf))].sort().map((group) => {
    const rows = settings.filter((setting) => groupOf(setting) === group);
    return el('details', { open: group === '' || group === 'optimization' }, el('summary', {}, group ? words(group) : 'the run'), table(`Settings: ${group || 'the run'}`, columns, rows));
  }));
}

function drawProvenance(data) {
  const rows = [];
  const add = (name, value) => { if (value !== undefined && value !== null && value !== '' && value !== 0) rows.push([name, value]); };
  const { model, evaluation, job } = data;
  if (model) {
    add('version', model.name);
    add('aliases', model.aliases.join(', '));
    add('registered', model.time);
    add('training ended', model.trainTime);
    add('learned from', model.datasets.join(', '));
    add('started from', model.startFrom);
    add('training examples', count(model.trainingExamples));
    add('held-out examples', count(model.heldOutExamples));
    add('learned numbers', count(model.parameters));
    add('trainer', model.trainer);
    add('weights, SHA-256', model.weightsSha256);
  }
  if (job) {
    add('training job', job.name);
    add('job started', job.started);
    add('job ended', job.ended);
    add('processes', job.processes > 1 ? job.processes : '');
    add('error', job.error);
    add('promotion', job.promotionReason ? `${job.promoted ? 'promoted' : 'not promoted'}: ${job.promotionReason}` : '');
  }
  if (evaluation) {
    add('evaluated on', evaluation.dataset);
    add('evaluated', evaluation.time);
    add('evaluated examples', count(evaluation.examples));
    add('dataset, SHA-256', evaluation.datasetSha256);
    for (const name of ['stride', 'keep_standing', 'standing_distance', 'max_speed']) add(`examples.${name}`, evaluation.settings[name]);
  }
  bodyOf('provenance').replaceChildren(table('Origins of the version and of its figures', [{ title: 'What', cell: ([name]) => name }, { title: 'Value', cell: ([, value]) => value }], rows));
}
