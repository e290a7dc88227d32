// The scenes: chosen, uploaded, deleted.

import { here, on, order, pause, request, upload } from './daemon.js';
import { ask, fill, held, isAsked, whenHeld } from './controls.js';
import { attempt, byId, show, write } from './parts.js';

const LOOK_EVERY_MS = 5000;

let scenes = [];

function megabytes(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

function look() {
  const entries = scenes.map(({ name, bytes }) => [name, bytes ? `${name}, ${megabytes(bytes)}` : name]);
  // What somebody has just chosen stays chosen until the daemon has answered.
  fill('scene', entries, isAsked('scene') ? byId('scene').value || undefined : held('scene'));
  const isOwn = scenes.find(({ name }) => name === held('scene'))?.origin === 'folder';
  byId('delete').disabled = !isOwn;
}

async function refresh() {
  scenes = await (await request('scenes')).json();
  look();
}

/** Other pages upload and delete, too. */
async function keepFresh() {
  for (;;) {
    if (here() && !document.hidden) await refresh().catch(() => {});
    await pause(LOOK_EVERY_MS);
  }
}

/** A file's name as a scene's: letters, digits, - and _. */
function nameOf(file) {
  const plain = file.name.replace(/\.[^.]*$/, '').replaceAll(/[^A-Za-z0-9_-]/g, '_').replace(/^[-_]+/, '');
  return (plain || 'scene').slice(0, 64);
}

async function send(file) {
  if (!file || !here()) return;
  const name = nameOf(file);
  const progress = byId('progress');
  byId('choose').disabled = true;
  progress.hidden = false;
  const content = await attempt('upload-error', () => {
    write('upload-says', `Sending ${file.name}, ${megabytes(file.size)}`);
    progress.value = 0;
    return upload(name, file, (share) => {
      progress.value = share;
      if (share === 1) {
        progress.removeAttribute('value');
        write('upload-says', `The daemon reads ${file.name}`);
      }
    });
  });
  byId('choose').disabled = false;
  progress.hidden = true;
  write('upload-says', content ? `${name} is there: ${content.triangles.toLocaleString('en')} triangles. ${content.notes.join('. ')}`.trim() : '');
  if (!content) return;
  await refresh().catch(() => {});
  ask('scene', () => ({ scene: name }), 'scene-error');
}

/** What is on the display cannot be deleted: the first built-in scene takes its place. */
async function remove() {
  const name = held('scene');
  if (!confirm(`Delete the scene ${name}?`)) return;
  await attempt('scene-error', async () => {
    await order('PATCH', 'display', { scene: scenes[0].name });
    await order('DELETE', `scenes/${encodeURIComponent(name)}`);
    await refresh();
  });
}

function bindUpload() {
  const [drop, file] = [byId('drop'), byId('file')];
  byId('choose').addEventListener('click', () => file.click());
  file.addEventListener('change', () => {
    send(file.files[0]);
    file.value = '';
  });
  // A file that misses the place must not replace the page.
  for (const kind of ['dragover', 'drop']) document.addEventListener(kind, (event) => event.preventDefault());
  drop.addEventListener('dragover', () => drop.classList.add('over'));
  for (const kind of ['dragleave', 'drop']) drop.addEventListener(kind, () => drop.classList.remove('over'));
  drop.addEventListener('drop', (event) => send(event.dataTransfer.files[0]));
}

/** Begins; the page calls it once. */
export function start() {
  byId('scene').addEventListener('change', () => {
    const scene = byId('scene').value;
    ask('scene', () => ({ scene }), 'scene-error');
  });
  byId('delete').addEventListener('click', remove);
  bindUpload();
  whenHeld(look);
  on('here', () => refresh().catch(() => {}));
  on('telemetry', ({ loading, scene, triangles, scene_error: error }) => {
    const shown = scene ? `${triangles.toLocaleString('en')} triangles` : '';
    write('scene-says', loading ? `${loading} is being read …` : shown);
    if (error) show('scene-error', error);
    else if (byId('scene-error').dataset.told) show('scene-error', '');
    byId('scene-error').dataset.told = error ?? '';
  });
  keepFresh();
}
