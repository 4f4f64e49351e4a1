'use strict';

// Reads the data and draws each part. A part that cannot be drawn says so and keeps the others.

function drawReport(data) {
  byId('title').textContent = data.title;
  const parts = [];
  if (data.evaluation) parts.push(`on ${shortName(data.evaluation.dataset)}, ${count(data.evaluation.examples)} examples, ${data.evaluation.time}`);
  else if (data.model) parts.push(`trained on ${data.model.datasets.map(shortName).join(', ')}, not evaluated yet`);
  else if (data.job) parts.push(`${data.job.name}, started ${data.job.started || '\u2013'}`);
  byId('subtitle').textContent = parts.join(' \u00b7 ');
  byId('made').textContent = `Made ${data.made} by ${data.program}. This file needs no network.`;
  const draws = { headline: drawHeadline, actions: drawActions, scenes: drawScenes, learning: drawLearning, calibration: drawCalibration,
    figures: drawFigures, rivals: drawRivals, strata: drawStrata, versions: drawVersions, settings: drawSettings, provenance: drawProvenance };
  for (const [part, draw] of Object.entries(draws)) {
    try {
      draw(data);
    } catch (error) {
      console.error(error);
      if (part !== 'headline') showMissing(part, null, { reason: `This part could not be drawn: ${error.message}` });
    }
  }
}

// Marks the part that is being read in the list of parts.
function followReading() {
  const links = new Map([...document.querySelectorAll('nav a')].map((link) => [link.hash.slice(1), link]));
  const seen = new Set();
  const observer = new IntersectionObserver((entries) => {
    for (const entry of entries) entry.isIntersecting ? seen.add(entry.target.id) : seen.delete(entry.target.id);
    const current = [...links.keys()].find((id) => seen.has(id));
    for (const [id, link] of links) id === current ? link.setAttribute('aria-current', 'true') : link.removeAttribute('aria-current');
  }, { rootMargin: '-15% 0px -60% 0px' });
  for (const id of links.keys()) observer.observe(byId(id));
}

// Paper shows what is folded away on a screen.
function openForPrint() {
  let closed = [];
  window.addEventListener('beforeprint', () => {
    closed = [...document.querySelectorAll('details:not([open])')];
    for (const details of closed) details.open = true;
  });
  window.addEventListener('afterprint', () => closed.forEach((details) => { details.open = false; }));
}

drawReport(JSON.parse(byId('data').textContent));
followReading();
openForPrint();
