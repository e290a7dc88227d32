// The phase error of the last minute, and the ring of slices.

import { here, on, pause, request } from './daemon.js';
import { byId } from './parts.js';

const SECONDS = 60;
/** The least that the axis shows on each side, in slices. */
const FLOOR_SLICES = 0.02;
const FONT = '12px system-ui, sans-serif';
const MARGIN = { left: 58, right: 12, top: 22, bottom: 34 };
const RING_EVERY_MS = 2000;

/** `{ at, error }`: milliseconds of the page's clock, slices or nothing. */
let samples = [];

/** The smallest of 1, 2, 5 times a power of ten that is `least` or more. */
function round(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= least * 0.999999);
}

/** RMS and largest of what is known, in slices; nothing where nothing is. */
export function ofTheMinute() {
  const known = samples.filter(({ error }) => error !== null).map(({ error }) => error);
  if (!known.length) return undefined;
  const rms = Math.sqrt(known.reduce((sum, error) => sum + error * error, 0) / known.length);
  return { rms, peak: Math.max(...known.map(Math.abs)) };
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** The canvas in CSS pixels, as sharp as the screen is. */
function prepare(canvas) {
  const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  }
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  return [pen, width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
}

function drawAxes(pen, width, height, range, x, y) {
  [pen.strokeStyle, pen.fillStyle, pen.lineWidth] = [colour('line'), colour('quiet'), 1];
  pen.textBaseline = 'middle';
  pen.textAlign = 'right';
  const digits = Math.max(0, -Math.floor(Math.log10(range / 2)));
  for (const value of [-range, -range / 2, 0, range / 2, range]) {
    pen.beginPath();
    pen.moveTo(MARGIN.left, y(value));
    pen.lineTo(MARGIN.left + width, y(value));
    pen.stroke();
    pen.fillText(value.toFixed(digits).replace('-', '−'), MARGIN.left - 6, y(value));
  }
  pen.textAlign = 'left';
  pen.fillText('phase error, slices', 4, 8);
  pen.textBaseline = 'top';
  for (const ago of [60, 40, 20, 0]) {
    pen.textAlign = ago === 60 ? 'left' : ago === 0 ? 'right' : 'center';
    pen.fillText(ago ? `−${ago}${ago === 60 ? ' s' : ''}` : 'now', x(ago), MARGIN.top + height + 8);
  }
}

/** Grey where nothing was measured, the error elsewhere. */
function drawSamples(pen, height, now, x, y) {
  const ago = (sample) => (now - sample.at) / 1000;
  samples.forEach((sample, place) => {
    if (sample.error !== null) return;
    const end = samples[place + 1] ? ago(samples[place + 1]) : 0;
    pen.fillStyle = colour('unknown');
    pen.fillRect(x(ago(sample)), MARGIN.top, x(end) - x(ago(sample)) + 0.5, height);
  });
  [pen.strokeStyle, pen.lineWidth, pen.lineJoin] = [colour('accent'), 1.5, 'round'];
  pen.beginPath();
  let isDown = false;
  for (const sample of samples) {
    if (sample.error === null) isDown = false;
    else if (isDown) pen.lineTo(x(ago(sample)), y(sample.error));
    else pen.moveTo(x(ago(sample)), y(sample.error));
    isDown = sample.error !== null;
  }
  pen.stroke();
}

function draw() {
  const canvas = byId('phase');
  if (document.hidden || !canvas.clientWidth) return;
  const [pen, width, height] = prepare(canvas);
  const range = round(Math.max(FLOOR_SLICES, ofTheMinute()?.peak ?? 0));
  const now = performance.now();
  const x = (ago) => MARGIN.left + width * (1 - Math.min(ago / SECONDS, 1));
  const y = (error) => MARGIN.top + (height / 2) * (1 - error / range);
  drawSamples(pen, height, now, x, y);
  drawAxes(pen, width, height, range, x, y);
  canvas.dataset.range = range;
}

function take({ phase_error_slices: error }) {
  const now = performance.now();
  samples.push({ at: now, error });
  samples = samples.filter(({ at }) => now - at <= SECONDS * 1000);
  draw();
}

/** Another ring every two seconds while it is on the screen. */
async function watchRing() {
  const ring = byId('ring');
  let isSeen = false;
  new IntersectionObserver((entries) => (isSeen = entries.at(-1).isIntersecting)).observe(ring.parentElement);
  for (;;) {
    if (isSeen && here() && !document.hidden) {
      const picture = await request('ring.png').then((answer) => answer.blob()).catch(() => undefined);
      if (picture) {
        const before = ring.src;
        ring.src = URL.createObjectURL(picture);
        ring.hidden = false;
        if (before) URL.revokeObjectURL(before);
      }
    }
    await pause(RING_EVERY_MS);
  }
}

/** Begins; the page calls it once. */
export function start() {
  on('telemetry', take);
  // What nobody heard is not known.
  on('gone', () => samples.push({ at: performance.now(), error: null }));
  new ResizeObserver(draw).observe(byId('phase'));
  watchRing();
}
