// Reads a report in headless Chromium, as a person would: by eye, by pointer and by keyboard.
//
//   node browser.mjs PAGE.html [SCREENSHOTS]
//
// Chromium is $CHROMIUM, or the one on the path. Exits with 77 if there is none.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync } from 'node:fs';
import { createRequire } from 'node:module';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

import puppeteer from 'puppeteer-core';

const [page_file, screenshots] = process.argv.slice(2);
const require = createRequire(import.meta.url);

function browserPath() {
  if (process.env.CHROMIUM) return process.env.CHROMIUM;
  for (const name of ['chromium', 'chromium-browser', 'google-chrome']) {
    try {
      return execFileSync('which', [name], { encoding: 'utf8' }).trim();
    } catch { /* the next one */ }
  }
  console.log('SKIPPED: there is no Chromium');
  process.exit(77);
}

const checks = [];
const check = (name, run) => checks.push([name, run]);
const WIDE = { width: 1280, height: 900 };
const PHONE = { width: 390, height: 844, hasTouch: true };

async function open(browser, { scheme = 'light', viewport = WIDE } = {}) {
  const page = await browser.newPage();
  page.problems = [];
  page.on('pageerror', (error) => page.problems.push(String(error)));
  page.on('console', (message) => {
    if (['error', 'warn'].includes(message.type())) page.problems.push(message.text());
  });
  page.on('request', (request) => {
    if (!/^(file|data|blob):/.test(request.url())) page.problems.push(`asks for ${request.url()}`);
  });
  await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme },
    { name: 'prefers-reduced-motion', value: 'reduce' }]);
  await page.setViewport(viewport);
  await page.goto(pathToFileURL(path.resolve(page_file)).href);
  return page;
}

const text = (page, selector) => page.$eval(selector, (element) => element.textContent);

// How many pixels of an element's picture differ from its most frequent colour, as a share.
async function inkOf(page, selector) {
  const element = await page.$(selector);
  assert.ok(element, `${selector} is on the page`);
  const picture = await element.screenshot({ encoding: 'base64' });
  // Away from the page, whose policy lets in no pictures.
  const blank = await page.browser().newPage();
  const share = await blank.evaluate(async (base64) => {
    const image = new Image();
    image.src = `data:image/png;base64,${base64}`;
    await image.decode();
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    const pixels = new Uint32Array(context.getImageData(0, 0, image.width, image.height).data.buffer);
    const counts = new Map();
    for (const pixel of pixels) counts.set(pixel, (counts.get(pixel) || 0) + 1);
    return 1 - Math.max(...counts.values()) / pixels.length;
  }, picture);
  await blank.close();
  return share;
}

check('loads without an error, and what the data says is never run', async (browser) => {
  const page = await open(browser);
  assert.deepEqual(page.problems, []);
  assert.equal(await page.evaluate('window.broken'), undefined);
  assert.equal(await page.$$eval('img, iframe, script[src], link', (all) => all.length), 0);
  const names = await page.$$eval('#actions .card .name', (all) => all.map((one) => one.textContent));
  assert.ok(names.some((name) => name.startsWith('</script><script>')), 'a hostile name is shown as text');
});

check('the policy keeps out a program that is not the page\'s own', async (browser) => {
  const page = await open(browser);
  await page.evaluate(() => {
    const script = document.createElement('script');
    script.textContent = 'window.foreign = true';
    document.body.append(script);
  });
  assert.equal(await page.evaluate('window.foreign'), undefined);
});

check('every part is there and drawn', async (browser) => {
  const page = await open(browser);
  for (const part of ['actions', 'scenes', 'learning', 'calibration', 'figures', 'rivals', 'strata', 'versions', 'settings', 'provenance']) {
    assert.equal(await page.$$eval(`#${part} .missing`, (all) => all.length), 0, `${part} is not missing`);
    assert.ok((await text(page, `#${part} .body`)).length > 10, `${part} has something in it`);
  }
  assert.equal(await text(page, 'h1'), 'town/3');
  assert.equal((await page.$$('#actions .card')).length, 6);  // the effective ones
  assert.equal((await page.$$('#scenes .thumbs .card')).length, 3);
  assert.equal((await page.$$('#learning figure')).length, 2 + 3);
});

for (const scheme of ['light', 'dark']) {
  check(`drawings are not empty on a ${scheme} ground`, async (browser) => {
    const page = await open(browser, { scheme });
    for (const [selector, least] of [['.action-detail svg', 0.02], ['#actions .card svg', 0.01], ['svg.map', 0.03],
      ['.thumbs .card svg', 0.02], ['#learning .chart', 0.01], ['#calibration .chart', 0.02], ['#rivals .rival svg', 0.005]]) {
      const ink = await inkOf(page, selector);
      assert.ok(ink > least, `${selector} has ${(100 * ink).toFixed(2)} % of ink`);
    }
    const ground = await page.$eval('body', (body) => getComputedStyle(body).backgroundColor);
    const brightness = ground.match(/\d+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0) / 3;
    assert.equal(brightness > 128, scheme === 'light');
  });

  check(`follows axe's rules on a ${scheme} ground`, async (browser) => {
    const page = await open(browser, { scheme });
    await page.setBypassCSP(true);
    await page.reload();
    await page.evaluate(() => document.querySelectorAll('details').forEach((details) => { details.open = true; }));
    await page.addScriptTag({ path: require.resolve('axe-core/axe.min.js') });
    const { violations } = await page.evaluate(() => window.axe.run());
    assert.deepEqual(violations.map((v) => `${v.id}: ${v.nodes.slice(0, 3).map((n) => n.html).join(' | ')}`), []);
  });
}

check('a click chooses an action here and in the scenes', async (browser) => {
  const page = await open(browser);
  const cards = await page.$$('#actions .card');
  await cards[1].click();
  await page.mouse.move(0, 0);
  assert.equal(await cards[1].evaluate((card) => card.getAttribute('aria-pressed')), 'true');
  assert.equal(await cards[0].evaluate((card) => card.getAttribute('aria-pressed')), 'false');
  const id = await cards[1].evaluate((card) => card.dataset.action);
  assert.equal(await text(page, '.action-detail h3'), await cards[1].$eval('.name', (name) => name.textContent));
  assert.equal(await page.$eval('.answers [aria-pressed=true]', (answer) => answer.dataset.action), id);
});

check('pointing at an action shows it for as long', async (browser) => {
  const page = await open(browser);
  const before = await text(page, '.action-detail h3');
  const cards = await page.$$('#actions .card');
  await cards[3].hover();
  assert.notEqual(await text(page, '.action-detail h3'), before);
  await page.mouse.move(0, 0);
  assert.equal(await text(page, '.action-detail h3'), before);
});

check('another speed draws other actions', async (browser) => {
  const page = await open(browser);
  const shape = () => page.$eval('#actions .card .mean', (mean) => mean.getAttribute('d'));
  const at_ten = await shape();
  await page.click('input[name=speed][value="0"]');
  assert.notEqual(await shape(), at_ten);
});

check('scenes can be chosen, filtered, moved, zoomed and stepped through', async (browser) => {
  const page = await open(browser);
  const facts = () => text(page, '#scenes .pairs');
  const first = await facts();
  await page.click('#scenes .thumbs li:nth-child(2) .card');
  assert.notEqual(await facts(), first);
  const box = () => page.$eval('svg.map', (map) => map.getAttribute('viewBox').split(' ').map(Number));
  const before = await box();
  const element = await page.$('svg.map');
  await element.scrollIntoView();
  const map = await element.boundingBox();
  await page.mouse.move(map.x + 200, map.y + 200);
  await page.mouse.down();
  await page.mouse.move(map.x + 260, map.y + 200);
  await page.mouse.up();
  assert.ok((await box())[0] < before[0], 'dragging to the right looks further to the left');
  await page.click('[aria-label="Zoom in"]');
  assert.ok((await box())[2] < before[2]);
  await page.click('[aria-label="Show all"]');
  assert.deepEqual(await box(), before);
  await page.select('#scene-filter', 'group surprising');
  assert.equal((await page.$$('#scenes .thumbs .card')).length, 1);
  for (const value of await page.$$eval('#scene-filter option', (options) => options.map((option) => option.value))) {
    await page.select('#scene-filter', value);
    assert.notEqual((await page.$$('#scenes .thumbs .card')).length, 0, value);
  }
});

check('the keyboard does what the pointer does', async (browser) => {
  const page = await open(browser);
  await page.keyboard.press('Tab');
  assert.equal(await page.evaluate(() => document.activeElement.className), 'skip');
  await page.focus('#actions .card');
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('Enter');
  assert.equal(await page.evaluate(() => document.activeElement.getAttribute('aria-pressed')), 'true');
  await page.$eval('svg.map', (map) => map.focus());
  const box = () => page.$eval('svg.map', (map) => map.getAttribute('viewBox'));
  const before = await box();
  await page.keyboard.press('ArrowLeft');
  assert.notEqual(await box(), before);
  await page.keyboard.press('0');
  assert.equal(await box(), before);
  const place = () => page.$eval('.agent.target', (agent) => agent.getAttribute('transform'));
  const now = await place();
  for (let i = 0; i < 5; ++i) await page.keyboard.press('.');
  assert.equal(await text(page, '.timeline output'), '+1.0 s');
  assert.notEqual(await place(), now);
});

check('a phone shows all of it without scrolling sideways', async (browser) => {
  const page = await open(browser, { viewport: PHONE });
  const [scroll, width] = await page.evaluate(() => [document.documentElement.scrollWidth, window.innerWidth]);
  assert.ok(scroll <= width, `${scroll} pixels in ${width}`);
});

check('prints what is folded away, and no controls', async (browser) => {
  const page = await open(browser);
  await page.evaluate(() => window.dispatchEvent(new Event('beforeprint')));
  assert.equal(await page.$$eval('details:not([open])', (all) => all.length), 0);
  await page.emulateMediaType('print');
  assert.equal(await page.$eval('nav', (nav) => getComputedStyle(nav).display), 'none');
});

check('prints no paragraph and no scene across two pages', async (browser) => {
  const page = await open(browser);
  await page.emulateMediaType('print');
  for (const whole of ['.lead', '.scene']) {
    assert.equal(await page.$eval(whole, (part) => getComputedStyle(part).breakInside), 'avoid', whole);
  }
});

async function takeScreenshots(browser) {
  mkdirSync(screenshots, { recursive: true });
  for (const scheme of ['light', 'dark']) {
    for (const [name, viewport] of [['wide', WIDE], ['phone', PHONE]]) {
      const page = await open(browser, { scheme, viewport });
      await page.screenshot({ path: path.join(screenshots, `${name}-${scheme}.png`), fullPage: true });
      await page.close();
    }
  }
}

// Debian's Chromium will not run as root within its sandbox; the page is our own.
const browser = await puppeteer.launch({ executablePath: browserPath(), args: ['--no-sandbox', '--disable-gpu'] });
let failed = 0;
try {
  if (screenshots) await takeScreenshots(browser);
  else {
    for (const [name, run] of checks) {
      try {
        await run(browser);
        console.log(`ok      ${name}`);
      } catch (error) {
        failed += 1;
        console.log(`FAILED  ${name}\n${error.stack}`);
      }
      for (const page of (await browser.pages()).slice(1)) await page.close();
    }
  }
} finally {
  await browser.close();
}
process.exit(failed ? 1 : 0);
