// How the display does: state, fault, figures, timeline.

import { here, on, order, pause } from './daemon.js';
import { attempt, byId, show, write } from './parts.js';
import { ofTheMinute } from './plots.js';

/** What a state is called, and what it means; its colour is its name's. */
const STATES = {
  idle: ['Stopped', ({ mirror_turns_per_second: speed }) =>
    speed > 0.2 ? `The mirror runs out: ${speed.toFixed(1)} turns/s` : 'The mirror stands still'],
  'spin-up': ['Spinning up', ({ mirror_turns_per_second: speed, wanted_turns_per_second: wanted }) =>
    `${speed.toFixed(1)} of ${wanted.toFixed(1)} turns/s`],
  acquire: ['Getting in step', () => 'At speed; the mirror is brought in step with the projector'],
  locked: ['Locked', ({ lit }) => (lit ? 'In step with the projector, and lit' : 'In step with the projector; no picture yet')],
  holdover: ['Holding over', () => 'Pulses are missing: lit on the last good model, for a short time'],
  fault: ['Fault', () => 'Stopped and dark until somebody clears it'],
  service: ['Service', () => 'A pattern stands on the parked mirror'],
  'open loop': ['Open loop', () => 'Lit on the word of the drive: nothing measures the mirror'],
};

let telemetry;
let wish;
/** The last fault, until the mirror turns again. */
let lastFault = '';

function tellState() {
  const { state, connected, device_error: why } = telemetry;
  const [name, says] = STATES[state] ?? [connected ? 'Connecting' : 'No controller', () => why ?? ''];
  byId('state').dataset.state = state ?? 'unknown';
  write('state-name', name);
  write('state-says', says(telemetry));
  document.title = `${name} – Praxinoscope`;
  write('what', `${telemetry.rig} · ${telemetry.simulated ? 'simulated' : telemetry.device}`);
}

function tellFault() {
  const isFault = telemetry.state === 'fault';
  const waits = telemetry.state === 'idle' && wish && !wish.motor;
  if (isFault) lastFault = telemetry.fault ?? 'unknown';
  else if (!waits) lastFault = '';
  if (!isFault) show('fault-error', '');
  const banner = byId('fault');
  banner.hidden = !lastFault;
  banner.classList.toggle('over', !isFault);
  write('fault-title', isFault ? 'Fault' : 'The fault is cleared');
  write('fault-cause', isFault ? lastFault : `It was: ${lastFault}`);
  const next = wish?.motor ? 'Once it is cleared the mirror starts again by itself.' : 'Once it is cleared the mirror waits for a start.';
  write('fault-next', isFault ? next : 'The mirror waits for a start.');
  const hadFocus = document.activeElement === byId('clear');
  byId('clear').disabled = !isFault;
  byId('start-again').disabled = isFault;
  if (hadFocus && !isFault) byId(lastFault ? 'start-again' : 'stop').focus();
  byId('start').disabled = isFault || !wish || wish.motor;
}

/** What is not known, or no number, is a dash. */
const fixed = (value, digits) => value?.toFixed(digits).replace('-', '−') ?? '–';

function tellFigures() {
  const told = telemetry;
  const minute = ofTheMinute();
  write('phase-now', fixed(told.phase_error_slices, 4));
  write('phase-minute', minute ? `${fixed(minute.rms, 4)}, ${fixed(minute.peak, 4)}` : '–');
  write('mirror', `${fixed(told.mirror_turns_per_second, 2)} of ${fixed(told.wanted_turns_per_second, 2)}`);
  const period = 1000 / told.wanted_turns_per_second;
  write('render', `${fixed(told.render_ms, 0)} of ${fixed(period, 0)}`);
  byId('render-meter').value = Math.min(told.render_ms / period, 1);
  byId('render-meter').classList.toggle('late', told.render_ms > period);
  const asked = wish?.budget_px ?? told.budget_px;
  const lowered = told.budget_px > asked ? `${told.budget_px} allowed now` : `${fixed(told.error_px, 2)} reached`;
  const late = told.render_ms > period && told.cheapest ? ', nothing takes less time' : '';
  write('detail', `${asked} asked, ${told.planning ? 'being planned' : lowered}${late}`);
  write('link', `${fixed(told.link_turns_per_second, 1)} turns/s, ${fixed(told.link_bytes_per_second / 1e6, 1)} MB/s`);
  write('ratio', told.link_ratio === null ? '–' : `${fixed(told.link_ratio, 1)} to 1`);
  write('drops', `${told.turns_dropped} of ${told.turns_dropped + told.turns_delivered}`);
  writeVideo(told.video);
  byId('latency-entry').hidden = told.latency_ms === null;
  write('latency', told.latency_ms === null ? '' : `${fixed(told.latency_ms, 0)} ms, ${fixed(told.latency_ms / period, 1)} turns`);
  write('renderer', `${told.renderer}: ${told.plan || 'nothing yet'}`);
}

/** Pictures that go to a monitor: how many of its refreshes showed another frame than theirs, or why there is no picture. */
function writeVideo(video) {
  byId('video-entry').hidden = video === null;
  if (video === null) return;
  const late = `${video.frames_late} late of ${video.frames_shown + video.frames_late}`;
  write('video', video.error ?? `${video.monitor}: ${fixed(video.frames_per_second, 1)}/s, ${late}`);
}

/** As many are kept as the daemon keeps. */
const EVENTS_MAX = 500;

function when(seconds) {
  const moment = new Date(1000 * seconds);
  const day = moment.toDateString() === new Date().toDateString() ? '' : `${moment.toLocaleDateString('en-CA')} `;
  return [moment.toISOString(), day + moment.toLocaleTimeString('en-GB')];
}

function tellEvent({ unix_s: seconds, kind, text }) {
  const entry = document.createElement('li');
  entry.className = kind;
  const time = document.createElement('time');
  [time.dateTime, time.textContent] = when(seconds);
  const words = document.createElement('span');
  words.textContent = kind === 'note' ? text : `${kind === 'fault' ? 'Fault' : 'Warning'}: ${text}`;
  entry.append(time, words);
  const events = byId('events');
  events.prepend(entry);
  while (events.childElementCount > EVENTS_MAX) events.lastElementChild.remove();
  byId('no-events').hidden = true;
}

/** A controller that does not clear a fault says nothing: after so long it has not. */
const CLEARED_WITHIN_MS = 2000;

async function clearFault() {
  await order('POST', 'faults/clear');
  await pause(CLEARED_WITHIN_MS);
  if (telemetry.state === 'fault') throw new Error('Not cleared: what caused it was still there.');
}

let focused;

/** The page as it is without the daemon: nothing can be ordered, and what is seen is old. */
function gone() {
  if (!document.body.classList.contains('gone')) focused = document.activeElement;
  document.body.classList.add('gone');
  const since = new Date().toLocaleTimeString('en-GB');
  if (byId('gone').hidden) show('gone', `The daemon is gone since ${since}. What you see is old. This page tries again by itself.`);
  write('state-name', 'Daemon gone');
  write('state-says', '');
  byId('state').dataset.state = 'unknown';
  document.title = 'Daemon gone – Praxinoscope';
  for (const orders of document.querySelectorAll('fieldset.orders')) orders.disabled = true;
}

function back() {
  document.body.classList.remove('gone');
  show('gone', '');
  for (const orders of document.querySelectorAll('fieldset.orders')) orders.disabled = false;
  if (document.activeElement === document.body) focused?.focus();
}

/** Begins; the page calls it once. */
export function start() {
  on('begin', () => {
    byId('events').replaceChildren();
    byId('no-events').hidden = false;
  });
  on('telemetry', (told) => {
    telemetry = told;
    tellState();
    tellFault();
    tellFigures();
  });
  on('wish', (held) => {
    wish = held;
    if (telemetry && here()) tellFault();
  });
  on('event', tellEvent);
  on('gone', gone);
  on('here', back);
  const press = (id, place, work) => byId(id).addEventListener('click', () => attempt(place, work));
  press('start', 'motor-error', () => order('POST', 'motor/start'));
  press('stop', 'motor-error', () => order('POST', 'motor/stop'));
  press('start-again', 'fault-error', () => order('POST', 'motor/start'));
  press('clear', 'fault-error', clearFault);
  byId('faults-only').addEventListener('change', (event) => byId('events').classList.toggle('faults-only', event.target.checked));
}
