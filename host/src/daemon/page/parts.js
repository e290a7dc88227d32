// What all parts of the page use.

export const byId = (id) => document.getElementById(id);

/** Element `id` says `text`. Said again only where it changed: somebody may hear it. */
export function write(id, text) {
  const element = typeof id === 'string' ? byId(id) : id;
  if (element.textContent !== text) element.textContent = text;
  return element;
}

/** The same, and it is not there where there is nothing to say. */
export function show(id, text) {
  write(id, text).hidden = !text;
}

/** Does `work`; what goes wrong is shown at `place`. */
export async function attempt(place, work) {
  show(place, '');
  try {
    return await work();
  } catch (error) {
    show(place, error.message);
    return undefined;
  }
}
