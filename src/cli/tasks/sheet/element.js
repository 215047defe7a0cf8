// Elements, made and found, and how numbers are told.

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
 * The element that the page has from the start.
 * @template {HTMLElement} Kind
 * @param {string} id
 * @param {new () => Kind} kind
 */
export function the(id, kind) {
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
export function inTime(seconds) {
  if (seconds < 1) return `${(1000 * seconds).toFixed(0)} ms`;
  if (seconds < 60) return `${Math.min(seconds, 59.9).toPrecision(3)} s`;
  const minutes = Math.floor(seconds / 60);
  return minutes < 60 ? `${minutes} min ${Math.floor(seconds % 60)} s` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** @param {number} bytes */
export function inBytes(bytes) {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** A text of the data, whatever its direction. */
export const plain = (/** @type {string} */ text, kind = "") => element("bdi", kind ? { class: kind } : {}, text);

/**
 * A value as its author wrote it; a color is also seen.
 * @param {string} text
 */
export function shownValue(text) {
  const color = /^"(#[0-9a-f]{6})"$/i.exec(text)?.[1];
  if (color === undefined) return text ? plain(text) : element("span", { class: "quiet" }, "empty");
  return element("bdi", {}, element("span", { class: "swatch", style: `background: ${color}` }), text);
}
