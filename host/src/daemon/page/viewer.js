// What an eye sees, and the place of that eye: dragged on a map or on the picture, by keys, by numbers.

import { here, on, order, pause, request } from './daemon.js';
import { byId, show } from './parts.js';

/** Half the width of the map: so many units of its drawing are so many metres. */
const MAP_UNITS = 104;
const MAP_M = 2;
const DEGREES_A_PIXEL = 0.5;
const METRES_A_PIXEL = 0.005;
const LIMITS = { distance: [0.2, 20], height: [-5, 5] };
const TRY_AGAIN_MS = 1000;
const PIXELS_MAX = 448;
const TELL_EVERY_MS = 50;
const HEAD_M_PER_S = 1.5;

const place = { azimuth: 0, distance: 0.9, height: 0.35 };
let defaultPlace = { ...place };
let telemetry;
let wake = () => {};

const clamp = (value, [least, most]) => Math.min(most, Math.max(least, value));
const turned = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;

/** Puts the eye elsewhere: what `changes` names. */
function move(changes) {
  const next = { ...place, ...changes };
  if (!Object.values(next).every(Number.isFinite)) return draw();
  place.azimuth = turned(next.azimuth);
  place.distance = clamp(next.distance, LIMITS.distance);
  place.height = clamp(next.height, LIMITS.height);
  draw();
  wake();
  follow();
}

const spot = (distance, azimuth) => {
  const [r, a] = [Math.min(distance / MAP_M, 1) * MAP_UNITS, (azimuth * Math.PI) / 180];
  return [r * Math.sin(a), r * Math.cos(a)];
};

function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

/** An input shows `value`, but not while somebody types into it. */
function write(input, value) {
  if (document.activeElement !== input || input.type === 'range') input.value = value;
}

function draw() {
  const [x, y] = spot(place.distance, place.azimuth);
  set(byId('eye-mark'), { transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})` });
  set(byId('sight'), { x2: x.toFixed(1), y2: y.toFixed(1) });
  const shown = { azimuth: Math.round(place.azimuth), distance: place.distance.toFixed(2), height: place.height.toFixed(2) };
  for (const [name, value] of Object.entries(shown)) write(byId(name), value);
  write(byId('height-slider'), place.height);
  set(byId('height-slider'), { 'aria-valuetext': `${shown.height} metres` });
  const words = `${shown.azimuth}°, ${shown.distance} m away, ${shown.height} m up`;
  set(byId('picture'), { 'aria-label': `What an eye sees: ${words}` });
  set(byId('map'), { 'aria-label': `The display from above, the eye at ${words}` });
}

/** Another page's eye is another viewer. */
const id = Math.floor(256 * Math.random());
let told;

/** Where the followed eye goes next, as a head goes: a jump would not be believed. Then in the world: to the right, up, to the front, metres. */
function nextPosition() {
  told ??= { ...place };
  const by = {
    azimuth: turned(place.azimuth - told.azimuth),
    distance: place.distance - told.distance,
    height: place.height - told.height,
  };
  const way = Math.hypot((by.azimuth * Math.PI * place.distance) / 180, by.distance, by.height);
  const share = Math.min(1, (HEAD_M_PER_S * TELL_EVERY_MS) / 1000 / way);
  for (const name of Object.keys(told)) told[name] += way > 0 ? share * by[name] : 0;
  const angle = (told.azimuth * Math.PI) / 180;
  return [told.distance * Math.sin(angle), told.height, told.distance * Math.cos(angle)];
}

let telling = false;

/** Tells the daemon where this eye is for as long as it is to be followed: whoever is not told of for a second has gone. */
async function follow() {
  if (telling) return;
  telling = true;
  let said = '';
  while (byId('follow').checked && here()) {
    try {
      await order('POST', 'viewers', [{ id, position_m: nextPosition() }]);
      said = '';
    } catch (error) {
      said = error.message;
    }
    show('follow-error', said);
    await pause(TELL_EVERY_MS);
  }
  show('follow-error', '');
  telling = false;
  told = undefined;
}

/** Who else is followed, on the map and in words. */
function drawOthers(viewers) {
  const marks = viewers.map(({ distance_m: distance, azimuth_deg: azimuth }) => {
    const mark = document.createElementNS('http://www.w3.org/2000/svg', 'circle');
    const [cx, cy] = spot(distance, azimuth).map((units) => units.toFixed(1));
    set(mark, { cx, cy, r: 14 });
    return mark;
  });
  byId('others').replaceChildren(...marks);
  const count = viewers.length === 1 ? '1 viewer is' : `${viewers.length} viewers are`;
  byId('others-say').textContent = viewers.length ? `${count} followed: ringed on the map.` : 'Nobody is followed.';
}

/** Has `moved(dx, dy, event)` called while `element` is dragged; `begun(event)` where the drag begins. */
function draggable(element, moved, begun = () => {}) {
  let last;
  element.addEventListener('pointerdown', (event) => {
    if (event.button !== 0 || !here()) return;
    element.setPointerCapture(event.pointerId);
    last = event;
    begun(event);
  });
  element.addEventListener('pointermove', (event) => {
    if (!last) return;
    moved(event.clientX - last.clientX, event.clientY - last.clientY, event);
    last = event;
  });
  for (const end of ['pointerup', 'pointercancel']) element.addEventListener(end, () => (last = undefined));
}

/** Has arrow keys on `element` do what `steps` says of them; Home goes to the default place. */
function keyed(element, steps) {
  element.addEventListener('keydown', (event) => {
    const step = event.key === 'Home' ? () => defaultPlace : steps[event.key];
    if (!step || event.ctrlKey || event.altKey || event.metaKey || !here()) return;
    event.preventDefault();
    move(step(event.shiftKey ? 5 : 1));
  });
}

function toPointer(event) {
  const box = byId('map').getBoundingClientRect();
  const along = [event.clientX - box.x - box.width / 2, event.clientY - box.y - box.height / 2];
  const units = byId('map').viewBox.baseVal.width / box.width;
  const [x, y] = along.map((pixels) => (pixels * units * MAP_M) / MAP_UNITS);
  move({ azimuth: (Math.atan2(x, y) * 180) / Math.PI, distance: Math.min(Math.hypot(x, y), MAP_M) });
}

function connect() {
  draggable(byId('map'), (dx, dy, event) => toPointer(event), toPointer);
  // The picture is taken by the hand: what is pulled to the right shows its left side.
  draggable(byId('picture'), (dx, dy) =>
    move({ azimuth: place.azimuth - dx * DEGREES_A_PIXEL, height: place.height + dy * METRES_A_PIXEL }),
  );
  const walk = {
    ArrowLeft: (by) => ({ azimuth: place.azimuth - 2 * by }),
    ArrowRight: (by) => ({ azimuth: place.azimuth + 2 * by }),
  };
  keyed(byId('picture'), {
    ...walk,
    ArrowUp: (by) => ({ height: place.height + 0.02 * by }),
    ArrowDown: (by) => ({ height: place.height - 0.02 * by }),
  });
  keyed(byId('map'), {
    ...walk,
    ArrowUp: (by) => ({ distance: place.distance - 0.05 * by }),
    ArrowDown: (by) => ({ distance: place.distance + 0.05 * by }),
  });
  byId('height-slider').addEventListener('input', (event) => move({ height: event.target.valueAsNumber }));
  for (const name of ['azimuth', 'distance', 'height']) {
    byId(name).addEventListener('change', (event) => {
      move({ [name]: event.target.valueAsNumber });
      event.target.value = name === 'azimuth' ? Math.round(place[name]) : place[name].toFixed(2);
    });
  }
  byId('default-place').addEventListener('click', () => move(defaultPlace));
  byId('follow').addEventListener('change', follow);
}

/** Where nobody has moved the eye yet it goes to the rig's own viewing circle. */
function begin({ viewing_m: viewing, display_radius_m: radius }) {
  const isUntouched = Object.entries(defaultPlace).every(([name, value]) => place[name] === value);
  if (viewing) defaultPlace = { azimuth: 0, distance: viewing[0], height: viewing[1] };
  set(byId('default-circle'), { r: Math.min(defaultPlace.distance / MAP_M, 1) * MAP_UNITS });
  set(byId('display-circle'), { r: Math.max((radius / MAP_M) * MAP_UNITS, 3) });
  if (isUntouched) move(defaultPlace);
}

/** What decides how the picture looks: the same is not asked for twice. */
function wanted() {
  if (!here() || document.hidden || !telemetry) return undefined;
  const side = byId('picture').clientWidth * Math.min(window.devicePixelRatio, 2);
  const pixels = clamp(Math.round(side / 32) * 32, [128, PIXELS_MAX]);
  const query = new URLSearchParams({
    azimuth_deg: place.azimuth.toFixed(2),
    distance_m: place.distance.toFixed(3),
    height_m: place.height.toFixed(3),
    pixels,
  });
  return { query, key: `${query} ${telemetry.lit} ${telemetry.turn_on_screen}` };
}

async function fetchPicture(query) {
  const picture = await (await request(`eye.png?${query}`)).blob();
  const [eye, before] = [byId('eye'), byId('eye').src];
  eye.src = URL.createObjectURL(picture);
  if (before) URL.revokeObjectURL(before);
  await eye.decode();
}

/** One picture after the other for as long as the page is open. */
async function watch() {
  let shown;
  for (;;) {
    const want = wanted();
    if (!want || want.key === shown) {
      await new Promise((woken) => (wake = woken));
      continue;
    }
    try {
      await fetchPicture(want.query);
      shown = want.key;
      // For tests: which picture stands there.
      byId('eye').dataset.shown = want.key;
      show('eye-error', '');
    } catch (error) {
      if (here()) show('eye-error', `No picture: ${error.message}`);
      await pause(TRY_AGAIN_MS);
    }
  }
}

/** Begins; the page calls it once. */
export function start() {
  connect();
  draw();
  let isNew = true;
  on('gone', () => {
    isNew = true;
    show('dark', 'Old: the daemon is gone');
  });
  on('telemetry', (told) => {
    telemetry = told;
    if (isNew) begin(told);
    isNew = false;
    show('dark', told.lit ? '' : 'The display is dark');
    drawOthers(told.viewers);
    wake();
  });
  on('here', () => {
    wake();
    follow();
  });
  document.addEventListener('visibilitychange', () => wake());
  watch();
}
