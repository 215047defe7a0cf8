// Helpers that create and find elements and format numbers.

/**
 * @template {keyof HTMLElementTagNameMap} Name
 * @param {Name} name
 * @param {Record<string, string | number>} [attributes]
 * @param {(Node | string)[]} inside
 */
export function element(name, attributes = {}, ...inside) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  made.append(...inside);
  return made;
}

/**
 * Finds an element of `sheet.html`.
 * @template {HTMLElement} Kind
 * @param {string} id
 * @param {new () => Kind} kind
 */
export function elementById(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`the page has no ${id}`);
  return found;
}

/**
 * @param {HTMLElement} made
 * @param {() => void} act
 */
export function onClick(made, act) {
  made.addEventListener("click", () => made.ariaDisabled !== "true" && act());
  return made;
}

/** @param {number} seconds */
export function formatSeconds(seconds) {
  if (seconds < 1) return `${(1000 * seconds).toFixed(0)} ms`;
  if (seconds < 60) return `${Math.min(seconds, 59.9).toPrecision(3)} s`;
  const minutes = Math.floor(seconds / 60);
  return minutes < 60 ? `${minutes} min ${Math.floor(seconds % 60)} s` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** @param {number} bytes */
export function formatBytes(bytes) {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Creates an element for a text of the data, which may be written from left to right or from right to left. */
export const plainText = (/** @type {string} */ text, kind = "") => element("bdi", kind ? { class: kind } : {}, text);

/**
 * A value as RON, with a swatch if it is a color.
 * @param {string} text
 */
export function shownValue(text) {
  const color = /^"(#[0-9a-f]{6})"$/i.exec(text)?.[1];
  if (color === undefined) return text ? plainText(text) : element("span", { class: "quiet" }, "empty");
  return element("bdi", {}, element("span", { class: "swatch", style: `background: ${color}` }), text);
}
