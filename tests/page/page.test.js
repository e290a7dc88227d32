// The page in a headless browser, with a daemon and a simulated display behind it. PRAXI names another program than target/debug/praxi,
// CHROMIUM another browser. Pictures of the page are left in target/page.

import assert from 'node:assert/strict';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, afterEach, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';
import { brightness, difference, Display, looksLike, PATIENCE_MS, picture, until } from './display.js';
import { hardToRead } from './legible.js';
import { model } from './model.js';

const SHOTS = fileURLToPath(new URL('../../target/page/', import.meta.url));
/** Pictures of one turn from two places differ by more than this, of 255; from one place by less than a tenth of it. */
const DIFFERS = 3;
const DESKTOP = { width: 1280, height: 900 };

const display = new Display();
let browser;
let page;
/** What the page complained of, and what it may complain of: browsers log refused requests as errors. */
let complaints = [];
let expected = [];

async function open(options = {}, url = display.url) {
  const opened = await browser.newPage({ viewport: DESKTOP, colorScheme: 'light', reducedMotion: 'reduce', ...options });
  opened.setDefaultTimeout(PATIENCE_MS);
  opened.on('console', (message) => message.type() !== 'log' && complaints.push(message.text()));
  opened.on('pageerror', (error) => complaints.push(error.stack));
  await opened.goto(url);
  return opened;
}

const shot = (name, of = page, options = {}) => of.screenshot({ path: join(SHOTS, `${name}.png`), ...options });
const text = (id) => page.textContent(`#${id}`);
const state = (name) => until(`the state ${name}`, async () => (await text('state-name')) === name);
const shows = (what, condition) => until(what, async () => condition(await display.wish()));

/** A picture from the place `query` that is brighter than `least` and darker than `most`. */
function seen(query, least = 1, most = 255) {
  return until(`a picture of ${query}`, async () => {
    const eye = await picture(page);
    if (!eye?.shown.includes(query)) return undefined;
    const bright = brightness(eye);
    return bright >= least && bright <= most ? eye : undefined;
  });
}

/** A scene that stands still, on screen: dark first, so that what is lit after it is it. */
async function still(scene) {
  await display.ask('display', 'PATCH', { mode: 'blank', animation: { kind: 'still' } });
  await seen('', 0, 0);
  await display.ask('display', 'PATCH', { scene });
  return seen('');
}

before(async () => {
  mkdirSync(SHOTS, { recursive: true });
  await display.start();
  browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args: ['--no-sandbox'] });
  page = await open();
});

after(async () => {
  await browser?.close();
  await display.remove();
});

afterEach(() => {
  const unexpected = complaints.filter((complaint) => !expected.some((pattern) => pattern.test(complaint)));
  [complaints, expected] = [[], []];
  assert.deepEqual(unexpected, [], display.log);
});

test('a moving picture comes by itself', async () => {
  await state('Locked');
  const first = await seen('azimuth_deg=0.00');
  await until('another picture', async () => difference(first, await seen('azimuth_deg=0.00')) > 0.5);
  assert.equal(await page.title(), 'Locked – Praxinoscope');
  assert.match(await text('mirror'), /^(19\.9|20\.0)\d of 20\.00$/);
  await until('the phase error', async () => /\d/.test(await text('phase-now')));
  await page.locator('#slices').scrollIntoViewIfNeeded();
  await page.locator('#ring').waitFor();
  await page.evaluate(() => scrollTo(0, 0));
  await shot('desktop-light');
  await page.emulateMedia({ colorScheme: 'dark' });
  await shot('desktop-dark', page, { fullPage: true });
  await page.emulateMedia({ colorScheme: 'light' });
});

test('a scene is chosen', async () => {
  const boxes = await still('boxes');
  await page.selectOption('#scene', 'knot-5k');
  await until('the knot', async () => (await display.telemetry()).scene === 'knot-5k');
  await until('another picture', async () => difference(boxes, await seen('')) > DIFFERS);
});

test('a scene is chosen while another order is under way', async () => {
  await still('boxes');
  await page.evaluate(() => {
    document.querySelector('#animation [value=spin]').click();
    const list = document.getElementById('scene');
    list.value = 'knot-5k';
    list.dispatchEvent(new Event('change'));
  });
  await shows('the knot', ({ scene, animation }) => scene === 'knot-5k' && animation.kind === 'spin');
  await until('the knot in the list', async () => (await page.inputValue('#scene')) === 'knot-5k');
});

test('the eye is dragged around, and back', async () => {
  const home = await still('boxes');
  const [map, eye] = [await page.locator('#map').boundingBox(), page.locator('#eye-mark')];
  const middle = { x: map.x + map.width / 2, y: map.y + map.height / 2 };
  const grip = await eye.boundingBox();
  const away = grip.y + grip.height / 2 - middle.y;
  const drag = async (from, to) => {
    await page.mouse.move(from.x, from.y);
    await page.mouse.down();
    await page.mouse.move((from.x + to.x) / 2 + 5, (from.y + to.y) / 2 + 5);
    await page.mouse.move(to.x, to.y);
    await page.mouse.up();
  };
  const [front, right] = [{ x: middle.x, y: middle.y + away }, { x: middle.x + away, y: middle.y }];
  await drag(front, right);
  const side = await seen('azimuth_deg=90.00');
  assert.ok(difference(home, side) > DIFFERS, `${difference(home, side)}`);
  assert.equal(await page.inputValue('#azimuth'), '90');
  await drag(right, front);
  await page.click('#default-place');
  const again = await seen('azimuth_deg=0.00&distance_m=0.900&height_m=0.350');
  assert.ok(difference(home, again) < DIFFERS / 10, `${difference(home, again)}`);

  await page.locator('#height-slider').fill('1.2');
  const above = await seen('height_m=1.200');
  assert.ok(difference(home, above) > DIFFERS, `${difference(home, above)}`);

  // The picture itself is taken by the hand: to the left, and down.
  await page.click('#default-place');
  const box = await page.locator('#picture').boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await drag({ x, y }, { x: x - 60, y: y + 40 });
  await seen('azimuth_deg=30.00&distance_m=0.900&height_m=0.550');
  await page.click('#default-place');
});

test('a file is uploaded, shown with its clip, and deleted', async () => {
  await page.setInputFiles('#file', { name: 'my bar.glb', mimeType: 'model/gltf-binary', buffer: model() });
  await until('the bar', async () => (await display.telemetry()).scene === 'my_bar');
  await until('what it holds', async () => /my_bar is there: 12 triangles/.test(await text('upload-says')));
  assert.equal(await page.inputValue('#scene'), 'my_bar');

  await page.check('#animation [value=clip]');
  await shows('the clip', ({ animation }) => animation.kind === 'clip' && animation.name === 'Turn');
  await page.fill('#animation-speed', '1.5');
  await page.keyboard.press('Enter');
  await shows('its speed', ({ animation }) => animation.speed === 1.5);
  const posed = await seen('');
  await until('that it moves', async () => difference(posed, await seen('')) > DIFFERS / 3);

  page.once('dialog', (dialog) => dialog.accept());
  await page.click('#delete');
  await until('that it is gone', async () => !(await display.ask('scenes')).some(({ name }) => name === 'my_bar'));
  await until('that it is gone from the list', async () => (await page.locator('#scene option[value=my_bar]').count()) === 0);
});

test('what is no model is refused, with the reason where it was dropped', async () => {
  expected = [/status of 400/];
  const before = await display.wish();
  const data = await page.evaluateHandle(() => {
    const transfer = new DataTransfer();
    transfer.items.add(new File(['no model'], 'bad.glb'));
    return transfer;
  });
  await page.dispatchEvent('#drop', 'drop', { dataTransfer: data });
  await until('the reason', async () => /^bad: /.test(await text('upload-error')));
  assert.deepEqual(await display.wish(), before);
});

test('a fault appears with its cause, is cleared, and the mirror starts again', async () => {
  await state('Locked');
  const sound = await shot('before-fault');
  await page.click('#simulator summary');
  await page.click('text=Press emergency stop');
  await page.locator('#fault').waitFor();
  await until('its cause', async () => /emergency stop/.test(await text('fault-cause')));
  await state('Fault');
  await until('the timeline', async () => /emergency stop/.test(await page.locator('#events .fault').first().textContent()));
  assert.ok(!(await display.wish()).motor);
  await seen('', 0, 0);
  assert.ok(!(await shot('fault')).equals(sound));

  // Its cause stands: the controller says no.
  await page.click('#clear');
  await until('why not', async () => /Not cleared/.test(await text('fault-error')));
  await page.click('text=Release emergency stop');
  await page.click('#clear');
  await state('Stopped');
  assert.equal(await text('fault-title'), 'The fault is cleared');
  await page.click('#start-again');
  await state('Locked');
  assert.ok(await page.locator('#fault').isHidden());
  await seen('');
});

test('every control does what it says, and shows what the daemon holds', async () => {
  for (const mode of ['freeze', 'blank', 'scene']) {
    await page.check(`#mode [value=${mode}]`);
    await shows(mode, (wish) => wish.mode === mode);
  }
  await page.check('#animation [value=spin]');
  const numbers = [
    ['animation-degrees-per-turn', '1.5', ({ animation }) => animation.degrees_per_turn === 1.5],
    ['transform-scale', '0.8', ({ transform }) => transform.scale === 0.8],
    ['transform-yaw-deg', '30', ({ transform }) => transform.yaw_deg === 30],
    ['transform-pitch-deg', '-10', ({ transform }) => transform.pitch_deg === -10],
    ['transform-roll-deg', '5', ({ transform }) => transform.roll_deg === 5],
    ['transform-move-m-0', '7', ({ transform }) => transform.move_m[0] === 0.007],
    ['transform-move-m-1', '-8', ({ transform }) => transform.move_m[1] === -0.008],
    ['transform-move-m-2', '9', ({ transform }) => transform.move_m[2] === 0.009],
    ['budget-px', '2', ({ budget_px }) => budget_px === 2],
  ];
  for (const [id, value, condition] of numbers) {
    await page.fill(`#${id}`, value);
    await page.keyboard.press('Enter');
    await shows(`${id} ${value}`, condition);
    await page.focus(`#${id}-slider`);
    await page.keyboard.press('ArrowRight');
    await shows(`${id} more than ${value}`, (wish) => !condition(wish));
  }
  await page.selectOption('#halftone', 'bayer');
  await shows('Bayer', ({ halftone }) => halftone === 'bayer');
  await page.click('#reset-transform');
  await shows('the placement', ({ transform }) => transform.scale === 1 && transform.move_m.every((metres) => metres === 0));
  await page.click('#stop');
  await shows('the stop', ({ motor }) => !motor);
  await page.click('#start');
  await shows('the start', ({ motor }) => motor);

  // Another page changes everything.
  await display.ask('display', 'PATCH', {
    mode: 'freeze', transform: { scale: 2, yaw_deg: 45 }, animation: { kind: 'still' }, budget_px: 0.5, halftone: 'blue-noise',
  });
  await until('what another page did', () => page.evaluate(() => {
    const value = (id) => document.getElementById(id).value;
    const checked = (group) => document.querySelector(`#${group} :checked`)?.value;
    return checked('mode') === 'freeze' && checked('animation') === 'still' && value('transform-scale') === '2' &&
      value('transform-yaw-deg') === '45' && value('budget-px') === '0.5' && value('halftone') === 'blue-noise';
  }));
  await display.ask('display', 'PATCH', { mode: 'scene', transform: { scale: 1, yaw_deg: 0 } });
});

test('a test pattern is chosen', async () => {
  // A pattern stands still: the picture that comes twice, and is none of those before it.
  const before = [await until('the scene', () => picture(page))];
  const another = (what) => until(what, async () => {
    const eye = await picture(page);
    if (!eye || brightness(eye) === 0 || before.some((other) => difference(eye, other) <= DIFFERS)) return undefined;
    const again = await until('one more', async () => { const next = await picture(page); return next && next.shown !== eye.shown ? next : undefined; });
    return difference(eye, again) < DIFFERS / 4 ? eye : undefined;
  });
  await page.check('#mode [value=pattern]');
  await page.selectOption('#pattern', 'numbers');
  await shows('the numbers', ({ mode, pattern }) => mode === 'pattern' && pattern === 'numbers');
  before.push(await another('the numbers'));
  await page.selectOption('#pattern', 'grid');
  await another('the grid');
  await shot('pattern');
  await page.check('#mode [value=scene]');
  await until('no list of patterns', () => page.isHidden('#pattern'));
});

test('the display follows the eye that is dragged', async () => {
  assert.match(await text('others-say'), /Nobody/);
  await page.check('#follow');
  await until('a viewer', async () => (await display.telemetry()).viewers.length === 1);
  await page.fill('#azimuth', '40');
  await page.fill('#height', '0.6');
  await page.keyboard.press('Enter');
  const isThere = ({ azimuth_deg: azimuth, height_m: height }) => Math.abs(azimuth - 40) < 0.5 && Math.abs(height - 0.6) < 0.01;
  await until('the viewer where the eye is', async () => (await display.telemetry()).viewers.some(isThere));
  await until('the latency', async () => /ms, .* turns/.test(await text('latency')));
  await until('one viewer', async () => /1 viewer is followed/.test(await text('others-say')));
  await shot('followed');
  await page.uncheck('#follow');
  await until('nobody', async () => (await display.telemetry()).viewers.length === 0);
  await page.click('#default-place');
});

test('what happens is recorded, and stopped sooner', async () => {
  const saved = async (stops) => {
    const download = page.waitForEvent('download');
    await page.click('#record');
    if (stops) {
      await until('some of it', async () => /MB/.test(await text('record-says')));
      await page.click('#record');
    }
    return readFileSync(await (await download).path());
  };
  await page.selectOption('#record-seconds', '10');
  for (const stops of [true, false]) {
    const bytes = await saved(stops);
    assert.equal(bytes.subarray(1, 5).toString('latin1'), 'MCAP');
    assert.equal(bytes.subarray(-7, -3).toString('latin1') === 'MCAP', !stops);
    assert.match(await text('record-says'), /^Saved/);
    assert.equal(await text('record'), 'Record');
  }
});

test('an answer that is late does not hide what was told since', async () => {
  await page.route('**/api/v1/display', async (route) => {
    const response = await route.fetch();
    await display.ask('display', 'PATCH', { mode: 'blank', budget_px: 3 });
    await until('what was told', async () => (await page.inputValue('#budget-px')) === '3');
    await route.fulfill({ response });
  }, { times: 1 });
  await page.check('#mode [value=freeze]');
  await until('what was told last', () => page.isChecked('#mode [value=blank]'));
  await display.ask('display', 'PATCH', { mode: 'scene', budget_px: 0.5 });
  // What is told while text is being selected, to be typed over, lets go of the selection.
  await until('what it was', async () => (await page.inputValue('#budget-px')) === '0.5');
});

test('what is not allowed is said where it was asked for', async () => {
  expected = [/status of 400/];
  await page.fill('#budget-px', '99');
  await page.keyboard.press('Enter');
  await until('the reason', async () => /0\.05 to 20/.test(await page.locator('#quality-amounts .error').textContent()));
  assert.equal((await display.wish()).budget_px, 0.5);
  await page.locator('#budget-px').blur();
  assert.equal(await page.inputValue('#budget-px'), '0.5');
});

test('the keyboard reaches everything', async () => {
  await page.reload();
  await until('the controls', () => page.isEnabled('#halftone'));
  const reached = [];
  for (;;) {
    await page.keyboard.press('Tab');
    const name = await page.evaluate(() => {
      const { id, name, tagName } = document.activeElement;
      return id || name || tagName;
    });
    if (name === 'BODY' || reached.includes('events')) break;
    reached.push(name);
  }
  for (const id of ['stop', 'picture', 'map', 'height-slider', 'azimuth', 'distance', 'height', 'default-place', 'follow', 'mode', 'scene', 'choose',
    'animation', 'transform-scale', 'transform-move-m-2-slider', 'reset-transform', 'budget-px', 'halftone', 'faults-only']) {
    assert.ok(reached.includes(id), `${id} is not among ${reached}`);
  }
  await page.focus('#azimuth');
  await page.keyboard.press('Shift+Tab');
  await page.keyboard.press('Shift+Tab');
  await page.keyboard.press('Shift+Tab');
  assert.equal(await page.evaluate(() => document.activeElement.id), 'picture');
  assert.ok(await page.locator('#picture').evaluate((element) => getComputedStyle(element).outlineStyle !== 'none'));
  for (const key of ['ArrowRight', 'ArrowRight', 'ArrowUp']) await page.keyboard.press(key);
  await seen('azimuth_deg=4.00&distance_m=0.900&height_m=0.370');
  await page.keyboard.press('Home');
  await seen('azimuth_deg=0.00&distance_m=0.900&height_m=0.350');
  await page.focus('#mode [value=scene]');
  await page.keyboard.press('ArrowRight');
  await shows('a pattern, by a key', ({ mode }) => mode === 'pattern');
  await page.keyboard.press('ArrowLeft');
  await shows('the scene, by a key', ({ mode }) => mode === 'scene');
});

test('it says that the daemon is gone, and recovers with the state kept', async () => {
  expected = [/ERR_/];
  await display.ask('display', 'PATCH', { transform: { yaw_deg: 12 }, scene: 'boxes', animation: { kind: 'still' } });
  await until('the yaw', async () => (await page.inputValue('#transform-yaw-deg')) === '12');
  await until('the boxes', async () => (await display.telemetry()).scene === 'boxes' && /triangles/.test(await text('scene-says')));
  const kept = await display.wish();
  const parts = (name) => Promise.all(['#controls', '.motor'].map((part) => shot(name + part.slice(1), page.locator(part))));
  await page.evaluate(() => document.activeElement.blur());
  await page.mouse.move(0, 0);
  const before = await parts('before-');
  assert.equal(await display.stop(), 0);
  await page.locator('#gone').waitFor();
  assert.match(await text('gone'), /daemon is gone/);
  assert.ok(await page.isDisabled('#halftone') && (await page.isDisabled('#stop')) && (await page.isDisabled('#azimuth')));
  assert.notEqual(await page.locator('#eye').evaluate((element) => getComputedStyle(element).filter), 'none');
  await shot('gone');
  assert.ok(!(await parts('gone-')).some((part, place) => part.equals(before[place])));
  await display.start();
  await page.locator('#gone').waitFor({ state: 'hidden' });
  await state('Locked');
  assert.deepEqual(await display.wish(), kept);
  await seen('');
  assert.ok(await page.isEnabled('#halftone'));
  const [back, blank] = [await parts('back-'), await open({}, 'about:blank')];
  for (const [place, part] of back.entries()) assert.ok(await looksLike(blank, part, before[place]), 'the controls look as before');
  await blank.close();
  assert.match(await text('events'), /the daemon ends/, 'what happened before is still told');
});

test('a phone shows everything, and nothing is cut off', async () => {
  const phone = await open({ viewport: { width: 360, height: 740 }, hasTouch: true, isMobile: true });
  await until('the picture', () => picture(phone));
  await phone.evaluate(() => document.querySelectorAll('details').forEach((details) => (details.open = true)));
  for (const width of [320, 360, 599, 768, 960, 1504, 2200]) {
    await phone.setViewportSize({ width, height: 740 });
    const [content, screen] = await phone.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    assert.ok(content <= width && screen === width, `${content} of ${width}`);
  }
  await phone.setViewportSize({ width: 360, height: 740 });
  for (const id of ['stop', 'scene', 'choose', 'transform-yaw-deg', 'halftone', 'height-slider', 'azimuth']) {
    await phone.locator(`#${id}`).scrollIntoViewIfNeeded();
    const box = await phone.locator(`#${id}`).boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 360, `${id}: ${JSON.stringify(box)}`);
    await phone.locator(`#${id}`).click({ trial: true });
  }
  await phone.locator('#map').scrollIntoViewIfNeeded();
  const map = await phone.locator('#map').boundingBox();
  await phone.touchscreen.tap(map.x + 0.8 * map.width, map.y + map.height / 2);
  assert.equal(await phone.inputValue('#azimuth'), '90');
  await phone.evaluate(() => scrollTo(0, 0));
  await shot('phone', phone, { fullPage: true });
  await phone.close();
});

test('all text is large enough and stands out', async () => {
  for (const colorScheme of ['light', 'dark']) {
    const reader = await open({ viewport: { width: 360, height: 740 }, colorScheme });
    await until('the controls', () => reader.isEnabled('#halftone'));
    await reader.evaluate(() => document.querySelectorAll('details').forEach((details) => (details.open = true)));
    assert.deepEqual(await reader.evaluate(hardToRead), [], colorScheme);
    await reader.close();
  }
});

test('with a token the page asks for it, once', async () => {
  expected = [/status of 401/];
  const [locked, token] = [new Display(), 'a-token-of-24-characters'];
  try {
    writeFileSync(join(locked.folder, 'token'), `${token}\n`);
    writeFileSync(join(locked.folder, 'praxi.toml'), `token_file = "${join(locked.folder, 'token')}"\nmotor = "wait"\n`);
    await locked.start('--config', join(locked.folder, 'praxi.toml'));
    const asked = await open({}, locked.url);
    const dialog = asked.locator('#token');
    await dialog.waitFor();
    await shot('token', asked);
    await asked.fill('#token-text', 'a-wrong-token-of-some-length');
    await asked.keyboard.press('Enter');
    await until('that it is wrong', async () => /wrong/.test(await asked.textContent('#token-error')));
    await dialog.waitFor();
    await asked.fill('#token-text', token);
    await asked.keyboard.press('Enter');
    await dialog.waitFor({ state: 'hidden' });
    await until('the state', async () => (await asked.textContent('#state-name')) === 'Stopped');
    await until('a dark picture', () => picture(asked));
    await asked.check('#mode [value=freeze]');
    await asked.reload();
    await until('the state again', async () => (await asked.textContent('#state-name')) === 'Stopped');
    await until('what was kept', () => asked.isChecked('#mode [value=freeze]'));
    assert.ok(await dialog.isHidden());
    await asked.close();
  } finally {
    await locked.remove();
  }
});
