// A recording of what happens from now on, as a file that the browser saves.

import { on, request } from './daemon.js';
import { attempt, byId, write } from './parts.js';

/** Ends the recording that is made, if one is. */
let quit;

const clock = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, '0')}`;

function save(pieces) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob(pieces, { type: 'application/octet-stream' }));
  link.download = `praxi-${new Date().toISOString().slice(0, 19).replaceAll(':', '-')}.mcap`;
  link.click();
  // The browser has begun to read it by then.
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

async function record(seconds) {
  const began = performance.now();
  quit = new AbortController();
  const pieces = [];
  let bytes = 0;
  try {
    const answer = await request(`recording.mcap?seconds=${seconds}`, { signal: quit.signal });
    for (const reader = answer.body.getReader(); ;) {
      const { done, value } = await reader.read();
      if (done) break;
      pieces.push(value);
      bytes += value.length;
      const passed = Math.min((performance.now() - began) / 1000, seconds);
      write('record-says', `${clock(passed)} of ${clock(seconds)}, ${(bytes / 1e6).toFixed(1)} MB`);
    }
  } catch (error) {
    // What came until it was stopped, or the daemon went away, can be read.
    if (pieces.length === 0 && !quit.signal.aborted) throw error;
  }
  if (pieces.length > 0) save(pieces);
  write('record-says', pieces.length > 0 ? `Saved: ${(bytes / 1e6).toFixed(1)} MB. praxi replay tells it again.` : '');
}

export function start() {
  const button = byId('record');
  button.addEventListener('click', async () => {
    if (quit) {
      quit.abort();
      return;
    }
    write(button, 'Stop recording');
    byId('record-seconds').disabled = true;
    await attempt('record-error', () => record(Number(byId('record-seconds').value)));
    quit = undefined;
    write(button, 'Record');
    byId('record-seconds').disabled = false;
  });
  on('here', () => (button.disabled = false));
  on('gone', () => (button.disabled = true));
}
