// Controls that are bound to what the daemon holds: each shows it, and wishes for something else.

import { on, order, pause } from './daemon.js';
import { attempt, byId, show } from './parts.js';

const HALFTONES = {
  'blue-noise': 'Blue noise',
  'blue-noise-fixed': 'Blue noise, fixed',
  'blue-noise-half': 'Blue noise, half moved',
  'blue-noise-3d': 'Blue noise in space and angle',
  'alternating-blue-noise': 'Blue noise, alternating (flickers)',
  bayer: 'Bayer',
  'white-noise': 'White noise',
  'floyd-steinberg': 'Floyd–Steinberg',
  'optimised-diffusion': 'Optimised diffusion',
  'alternating-diffusion': 'Optimised diffusion, alternating (flickers)',
  search: 'Search (slow)',
};

const PATTERNS = { 'cross-hairs': 'Cross-hairs', grid: 'Grid', numbers: 'Number of each slice', markers: 'Markers of each plane' };

/** Numbers: where they stand, what they are, what the slider reaches; the daemon's unit times `factor` is shown. */
const AMOUNTS = [
  { into: 'spin-amounts', key: 'animation.degrees_per_turn', label: 'Speed', unit: '°/turn', range: [-10, 10], step: 0.1 },
  { into: 'clip-amounts', key: 'animation.speed', label: 'Speed', unit: '×', range: [-3, 3], step: 0.05 },
  { into: 'transform-amounts', key: 'transform.scale', label: 'Scale', unit: '×', range: [0.1, 10], step: 0.05, isLog: true },
  { into: 'transform-amounts', key: 'transform.yaw_deg', label: 'Yaw', unit: '°', range: [-180, 180], step: 1 },
  { into: 'transform-amounts', key: 'transform.pitch_deg', label: 'Pitch', unit: '°', range: [-180, 180], step: 1 },
  { into: 'transform-amounts', key: 'transform.roll_deg', label: 'Roll', unit: '°', range: [-180, 180], step: 1 },
  { into: 'transform-amounts', key: 'transform.move_m.0', label: 'Right', unit: 'mm', range: [-150, 150], step: 1, factor: 1000 },
  { into: 'transform-amounts', key: 'transform.move_m.1', label: 'Up', unit: 'mm', range: [-150, 150], step: 1, factor: 1000 },
  { into: 'transform-amounts', key: 'transform.move_m.2', label: 'Front', unit: 'mm', range: [-150, 150], step: 1, factor: 1000 },
  { into: 'quality-amounts', key: 'budget_px', label: 'Budget', unit: 'px', range: [0.05, 20], step: 0.05, isLog: true },
];

/** What can happen to a simulated controller, as scenario files have it. */
const FAULTS = [
  ['Press emergency stop', 'emergency-stop'],
  ['Release emergency stop', 'emergency-stop-released'],
  ['Open guard', 'guard-opened'],
  ['Close guard', 'guard-closed'],
  ['No index pulses for 2 s', { 'no-index-pulses': { seconds: 2 } }],
  ['No frame pulses for 2 s', { 'no-frame-pulses': { seconds: 2 } }],
  ['Encoder stuck for 1 s', { 'encoder-frozen': { seconds: 1 } }],
  ['Brake the mirror', { load: { torque_nm: -0.2 } }],
  ['Release the brake', { load: { torque_nm: 0 } }],
  ['Weak supply', { 'torque-limit': { share: 0.1 } }],
  ['Full supply', { 'torque-limit': { share: 1 } }],
  ['Pulses scatter by 50 µs', { 'pulse-jitter': { us: 50 } }],
  ['Pulses as they were', { 'pulse-jitter': { us: 2 } }],
];

let wish;
/** Whatever shows a part of the wish. */
const showing = [];
/** What is wished for and not sent yet, by control: the newest of each. */
const waiting = new Map();
/** The control whose wish is under way. */
let sending;
let isTold = () => {};
/** The daemon tells of a change within a tenth of a second; of what changes nothing it does not tell. */
const TOLD_WITHIN_MS = 1000;

/** What stands at `key` of what the daemon holds; nothing where it has no such part. */
export const held = (key) => key.split('.').reduce((part, name) => part?.[name], wish);

/** The patch that brings `value` to `key`. A list is patched as a whole. */
function patchOf(key, value) {
  const names = key.split('.');
  const last = names.pop();
  const list = held(names.join('.'));
  const inner = Array.isArray(list) ? list.with(Number(last), value) : { [last]: value };
  return names.reduceRight((patch, name) => ({ [name]: patch }), inner);
}

/** Whether `control` waits for an answer: until then it shows what was asked for. */
export const isAsked = (control) => sending === control || waiting.has(control);

/** Wishes, in turn: of each control the newest. `patch` is asked when its turn has come. The daemon's reason against it is shown at `error`. */
export async function ask(control, patch, error) {
  waiting.set(control, { patch, error });
  if (sending) return;
  while (waiting.size) {
    const [next, job] = waiting.entries().next().value;
    waiting.delete(next);
    sending = next;
    const told = new Promise((done) => (isTold = done));
    await attempt(job.error, async () => {
      await order('PATCH', 'display', job.patch());
      await Promise.race([told, pause(TOLD_WITHIN_MS)]);
    });
  }
  sending = undefined;
  hold(wish);
}

/** Shows what the daemon holds, wherever nobody is at it. */
function hold(wanted) {
  wish = wanted;
  if (wish) showing.forEach((look) => look());
}

/** Has `look` called whenever the daemon holds something else. */
export function whenHeld(look) {
  showing.push(look);
}

/** Radio buttons in `group` for the text at `key`; `patch(value)` where it takes more. */
function bindChoice(group, key, patch = (value) => patchOf(key, value)) {
  const buttons = [...byId(group).querySelectorAll('input')];
  for (const button of buttons) {
    button.addEventListener('change', () => ask(group, () => patch(button.value), `${group}-error`));
  }
  whenHeld(() => {
    if (!isAsked(group)) buttons.forEach((button) => (button.checked = button.value === held(key)));
  });
}

/** The list `id` offers `[value, label]`, and `now`, which may be none of them. */
export function fill(id, entries, now) {
  const list = byId(id);
  const all = now === undefined || entries.some(([value]) => value === now) ? entries : [...entries, [now, now]];
  const there = [...list.options].map(({ value, text }) => [value, text]);
  if (String(there) !== String(all)) list.replaceChildren(...all.map(([value, label]) => new Option(label, value)));
  if (now !== undefined) list.value = now;
}

/** A list of `names` for what is at the key that is called like it. */
function bindList(id, names, error) {
  fill(id, Object.entries(names));
  byId(id).addEventListener('change', () => ask(id, () => patchOf(id, byId(id).value), error));
  whenHeld(() => isAsked(id) || fill(id, Object.entries(names), held(id)));
}

const tidy = (value) => Number(value.toPrecision(6));

/** A slider and a number for the same. */
function bindAmount({ into, key, label, unit, range, step, factor = 1, isLog = false }) {
  const row = byId('amount').content.cloneNode(true).firstElementChild;
  const [slider, number, error] = ['[type=range]', '[type=number]', '.error'].map((part) => row.querySelector(part));
  const id = key.replaceAll(/[._]/g, '-');
  const [toSlider, fromSlider] = isLog ? [Math.log10, (at) => Number((10 ** at).toPrecision(3))] : [(value) => value, (at) => at];
  row.querySelector('label').htmlFor = number.id = id;
  row.querySelector('label').textContent = label;
  row.querySelector('.unit').textContent = unit;
  slider.id = `${id}-slider`;
  slider.setAttribute('aria-label', `${label}, ${unit}`);
  [slider.min, slider.max] = range.map(toSlider);
  slider.step = isLog ? 0.01 : step;
  number.step = step;
  // Who is typing is left alone.
  let isTouched = false;
  const wishForIt = (value) => ask(key, () => patchOf(key, tidy(value / factor)), error);
  slider.addEventListener('input', () => {
    number.value = fromSlider(slider.valueAsNumber);
    wishForIt(number.valueAsNumber);
  });
  number.addEventListener('input', () => (isTouched = true));
  number.addEventListener('blur', () => ((isTouched = false), look()));
  number.addEventListener('change', () => {
    isTouched = false;
    show(error, '');
    if (Number.isFinite(number.valueAsNumber)) wishForIt(number.valueAsNumber);
    else look();
  });
  const look = () => {
    const value = held(key);
    if (typeof value !== 'number' || isTouched || isAsked(key)) return;
    number.value = tidy(value * factor);
    slider.value = toSlider(value * factor);
    slider.setAttribute('aria-valuetext', `${number.value} ${unit}`);
  };
  whenHeld(look);
  byId(into).append(row);
}

/** How the scene moves: each kind has its own amounts. */
function bindAnimation() {
  let clips = [];
  const kinds = {
    still: () => ({ kind: 'still' }),
    spin: () => ({ kind: 'spin', degrees_per_turn: 2 }),
    clip: () => ({ kind: 'clip', name: clips[0], speed: 1 }),
  };
  bindChoice('animation', 'animation.kind', (kind) => ({ animation: kinds[kind]() }));
  byId('clip').addEventListener('change', () => ask('clip', () => patchOf('animation.name', byId('clip').value), 'animation-error'));
  const look = () => {
    const kind = held('animation.kind');
    byId('spin-amounts').hidden = kind !== 'spin';
    byId('clip-amounts').hidden = byId('clip-row').hidden = kind !== 'clip';
    byId('animation').querySelector('[value=clip]').disabled = clips.length === 0 && kind !== 'clip';
    const entries = clips.map((clip) => [clip, clip]);
    if (!isAsked('clip')) fill('clip', entries, kind === 'clip' ? (held('animation.name') ?? clips[0]) : undefined);
  };
  whenHeld(look);
  on('telemetry', (told) => {
    if (String(told.clips) === String(clips)) return;
    clips = told.clips;
    look();
  });
}

function bindFaults() {
  for (const [label, action] of FAULTS) {
    const button = document.createElement('button');
    [button.type, button.textContent] = ['button', label];
    button.addEventListener('click', async () => {
      const isDone = await attempt('simulator-error', () => order('POST', 'simulator', action).then(() => true));
      show('simulator-says', isDone ? `Done: ${label.toLowerCase()}.` : '');
    });
    byId('faults').append(button);
  }
  on('telemetry', (told) => (byId('simulator').hidden = !told.simulated));
}

/** Begins; the page calls it once. */
export function start() {
  AMOUNTS.forEach(bindAmount);
  bindChoice('mode', 'mode');
  bindAnimation();
  bindFaults();
  bindList('halftone', HALFTONES, 'halftone-error');
  bindList('pattern', PATTERNS, 'mode-error');
  whenHeld(() => (byId('pattern-row').hidden = held('mode') !== 'pattern'));
  byId('reset-transform').addEventListener('click', () => {
    const transform = { scale: 1, yaw_deg: 0, pitch_deg: 0, roll_deg: 0, move_m: [0, 0, 0] };
    for (const error of byId('transform-amounts').querySelectorAll('.error')) show(error, '');
    ask('reset', () => ({ transform }), 'transform-error');
  });
  on('wish', (wanted) => {
    hold(wanted);
    isTold();
  });
  on('gone', () => waiting.clear());
}
