// The way to the daemon: requests, and what it tells by itself.

/** After so long without a word the daemon is gone: it speaks ten times a second. */
const SILENT_MS = 3000;
const RETRY_MS = 1000;
/** A request that takes longer is given up. */
const ANSWER_MS = 30_000;
const TOKEN = 'praxi-token';

const listeners = {};
let token = sessionStorage.getItem(TOKEN);
let tokenGiven = () => {};
let isHere = false;

/** Has `listener` called with whatever is told of `kind`: telemetry, event, wish; begin, here, gone; token. */
export function on(kind, listener) {
  (listeners[kind] ??= []).push(listener);
}

function tell(kind, value) {
  for (const listener of listeners[kind] ?? []) {
    try {
      listener(value);
    } catch (error) {
      // One part of the page fails alone.
      reportError(error);
    }
  }
}

/** Whether the daemon is there. */
export const here = () => isHere;

export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

/** The token that requests carry from now on. */
export function giveToken(text) {
  token = text;
  sessionStorage.setItem(TOKEN, text);
  tokenGiven();
}

const authorization = () => (token ? { authorization: `Bearer ${token}` } : {});

class NeedsToken extends Error {}

/** Why the daemon refused, in its own words where it has some. */
function refusal(status, text) {
  try {
    return JSON.parse(text).error;
  } catch {
    return `the daemon answered ${status}`;
  }
}

/** The answer to a request below /api/v1/; throws an Error with the daemon's reason. */
export async function request(path, { headers, signal = AbortSignal.timeout(ANSWER_MS), ...options } = {}) {
  let answer;
  try {
    answer = await fetch(`/api/v1/${path}`, {
      cache: 'no-store', signal, ...options, headers: { ...headers, ...authorization() },
    });
  } catch {
    throw new Error('the daemon does not answer');
  }
  if (answer.status === 401) throw new NeedsToken(refusal(401, await answer.text()));
  if (!answer.ok) throw new Error(refusal(answer.status, await answer.text()));
  return answer;
}

/** An order with a body of JSON. What comes of it is told: an answer may be older than what was told since. */
export async function order(method, path, body) {
  const headers = { 'content-type': 'application/json' };
  await request(path, { method, headers, body: body === undefined ? undefined : JSON.stringify(body) });
}

/** Sends `file` as the scene `name`; `progress` hears how much of it is there, 0 to 1. `fetch` would not say. */
export function upload(name, file, progress) {
  return new Promise((done, failed) => {
    const sending = new XMLHttpRequest();
    sending.open('PUT', `/api/v1/scenes/${encodeURIComponent(name)}`);
    for (const [header, value] of Object.entries(authorization())) sending.setRequestHeader(header, value);
    sending.setRequestHeader('content-type', 'model/gltf-binary');
    sending.upload.onprogress = (event) => event.lengthComputable && progress(event.loaded / event.total);
    sending.onload = () => {
      if (sending.status === 201) done(JSON.parse(sending.responseText));
      else failed(new Error(refusal(sending.status, sending.responseText)));
    };
    // A file that is too large is refused before all of it is there, and the line is cut.
    sending.onerror = () => failed(new Error('the upload broke off: the file may be too large'));
    sending.send(file);
  });
}

/** Hears the daemon for as long as the page is open. */
export async function listen() {
  for (;;) {
    const outcome = await hear().catch((error) => error);
    if (isHere || !(outcome instanceof NeedsToken)) {
      isHere = false;
      tell('gone');
    }
    if (outcome instanceof NeedsToken) {
      const given = new Promise((done) => (tokenGiven = done));
      tell('token', token ? outcome.message : undefined);
      await given;
    } else {
      await pause(RETRY_MS);
    }
  }
}

/** One connection, until it ends. */
async function hear() {
  const quit = new AbortController();
  let silence;
  const alive = () => {
    clearTimeout(silence);
    silence = setTimeout(() => quit.abort(), SILENT_MS);
  };
  alive();
  try {
    const answer = await request('telemetry', { signal: quit.signal });
    // It tells all events anew: a daemon that lost its state counts them from one.
    tell('begin');
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = '';
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      alive();
      const messages = (text + value).split('\n\n');
      text = messages.pop();
      messages.forEach(take);
    }
  } finally {
    clearTimeout(silence);
  }
}

/** One server-sent event. */
function take(message) {
  const field = (name) => message.split('\n').find((line) => line.startsWith(`${name}: `))?.slice(name.length + 2);
  const [kind, data] = [field('event'), field('data')];
  if (!kind || !data) return;
  tell(kind, JSON.parse(data));
  if (kind === 'telemetry' && !isHere) {
    isHere = true;
    tell('here');
  }
}
