// A daemon with a simulated display, and a browser that looks at its page.

import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';

const PRAXI = process.env.PRAXI ?? fileURLToPath(new URL('../../target/debug/praxi', import.meta.url));
/** Far more than anything takes on a busy machine: what does not come at all fails by it. */
export const PATIENCE_MS = 120_000;
const LOOK_EVERY_MS = 50;

/** Waits until `condition` gives something, and gives it; `what` says in words what did not come. */
export async function until(what, condition) {
  const end = Date.now() + PATIENCE_MS;
  for (;;) {
    const outcome = await condition();
    if (outcome) return outcome;
    if (Date.now() > end) throw new Error(`it did not come to this: ${what}`);
    await new Promise((done) => setTimeout(done, LOOK_EVERY_MS));
  }
}

/** A port that nobody has; the same one after a restart. */
async function freePort() {
  const server = createServer();
  await new Promise((done) => server.listen(0, '127.0.0.1', done));
  const { port } = server.address();
  await new Promise((done) => server.close(done));
  return port;
}

export class Display {
  folder = mkdtempSync(join(tmpdir(), 'praxi-page-'));
  log = '';

  /** Runs `praxi run` with these arguments beside its own, until it answers. */
  async start(...more) {
    this.port ??= await freePort();
    const state = join(this.folder, 'state');
    const all = ['run', '--listen', `127.0.0.1:${this.port}`, '--state-dir', state, ...more];
    this.process = spawn(PRAXI, all, { stdio: ['ignore', 'ignore', 'pipe'] });
    this.process.stderr.on('data', (text) => (this.log += text));
    this.ended = new Promise((done) => this.process.on('exit', done));
    await until('the daemon answers', async () => {
      if (this.process.exitCode !== null) throw new Error(`praxi ended: ${this.log}`);
      return fetch(`${this.url}healthz`).catch(() => undefined);
    });
  }

  /** Its exit code. */
  async stop() {
    this.process.kill('SIGTERM');
    return this.ended;
  }

  async remove() {
    if (this.process?.exitCode === null) await this.stop();
    rmSync(this.folder, { recursive: true, force: true });
  }

  get url() {
    return `http://127.0.0.1:${this.port}/`;
  }

  async ask(path, method = 'GET', body = undefined) {
    const answer = await fetch(`${this.url}api/v1/${path}`, { method, body: body && JSON.stringify(body) });
    if (!answer.ok) throw new Error(`${method} ${path}: ${answer.status} ${await answer.text()}`);
    return answer.status === 200 ? answer.json() : undefined;
  }

  wish() {
    return this.ask('display');
  }

  async telemetry() {
    return (await this.ask('status')).telemetry;
  }
}

/** What stands in the page's picture: its key, and 96 × 96 greys. Nothing while there is none. */
export function picture(page) {
  return page.evaluate(() => {
    const eye = document.getElementById('eye');
    if (!eye.dataset.shown || !eye.complete || !eye.naturalWidth) return undefined;
    const canvas = new OffscreenCanvas(96, 96);
    const pen = canvas.getContext('2d');
    pen.drawImage(eye, 0, 0, 96, 96);
    const bytes = pen.getImageData(0, 0, 96, 96).data;
    const grey = Array.from({ length: 96 * 96 }, (_, place) => (bytes[4 * place] * bytes[4 * place + 3]) / 255);
    return { shown: eye.dataset.shown, grey };
  });
}

/** The mean difference of two such pictures, of 255. */
export function difference(a, b) {
  return a.grey.reduce((sum, grey, place) => sum + Math.abs(grey - b.grey[place]), 0) / a.grey.length;
}

/** The mean brightness of one, of 255. */
export function brightness(a) {
  return a.grey.reduce((sum, grey) => sum + grey, 0) / a.grey.length;
}

/** Whether two pictures of the page are the same but for rounding: edges may be a grey level off from one drawing to the next. */
export function looksLike(page, ...pictures) {
  return page.evaluate(async (texts) => {
    const [a, b] = await Promise.all(texts.map(async (text) => {
      const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${text}`)).blob());
      const pen = new OffscreenCanvas(image.width, image.height).getContext('2d');
      pen.drawImage(image, 0, 0);
      return pen.getImageData(0, 0, image.width, image.height);
    }));
    return a.width === b.width && a.height === b.height && a.data.every((value, place) => Math.abs(value - b.data[place]) <= 2);
  }, pictures.map((picture) => picture.toString('base64')));
}
