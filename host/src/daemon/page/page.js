// The page: begins its parts, and asks for the token where the daemon wants one.

import * as controls from './controls.js';
import { giveToken, listen, on } from './daemon.js';
import { byId, show } from './parts.js';
import * as plots from './plots.js';
import * as recording from './recording.js';
import * as scenes from './scenes.js';
import * as state from './state.js';
import * as viewer from './viewer.js';

function bindToken() {
  const dialog = byId('token');
  on('token', (reason) => {
    show('token-error', reason ?? '');
    byId('token-text').value = '';
    if (!dialog.open) dialog.showModal();
  });
  dialog.querySelector('form').addEventListener('submit', (event) => {
    event.preventDefault();
    dialog.close();
    giveToken(byId('token-text').value.trim());
  });
  // Without it there is nothing to see.
  dialog.addEventListener('cancel', (event) => event.preventDefault());
}

bindToken();
// A small page begins with what is used most.
if (matchMedia('(max-width: 60rem)').matches) for (const id of ['placement', 'quality']) byId(id).open = false;
// The plots first: figures are made of what they keep.
for (const part of [plots, state, viewer, controls, scenes, recording]) part.start();
listen();
