// The colors of the boxes: by state, or by the fraction of the time or of the memory that a box takes.

/** @typedef {import("./types").NodeState} NodeState */

const STORAGE_KEY = "maquette-profile";

/** @param {number} seconds */
export function formatSeconds(seconds) {
  if (seconds >= 1) return `${seconds.toFixed(2)} s`;
  return `${(1000 * seconds).toFixed(seconds < 0.01 ? 1 : 0)} ms`;
}

/** @param {number} bytes */
export function formatBytes(bytes) {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/**
 * The measures of a node: how each is read from a node's state, and how it is formatted.
 * @type {Record<string, {read: (state: NodeState) => number, format: (value: number) => string}>}
 */
const MEASURES = {
  time: { read: (state) => state.seconds ?? 0, format: formatSeconds },
  bytes: { read: (state) => state.bytes ?? 0, format: formatBytes },
};

export class Profile {
  /**
   * @param {HTMLSelectElement} select the choice of the measure
   * @param {HTMLElement} legend shows the value of the strongest color
   * @param {() => void} changed is called when another measure is chosen
   */
  constructor(select, legend, changed) {
    this.select = select;
    this.legend = legend;
    const stored = sessionStorage.getItem(STORAGE_KEY);
    if (stored !== null && stored in MEASURES) select.value = stored;
    select.addEventListener("change", () => {
      sessionStorage.setItem(STORAGE_KEY, select.value);
      changed();
    });
  }

  /**
   * The measure of each box as a fraction of the largest one, from 0 to 1.
   * @param {[string, NodeState][]} boxes
   * @returns {Map<string, number>}
   */
  shares(boxes) {
    const measure = MEASURES[this.select.value];
    const values = boxes.map(([name, state]) => /** @type {const} */ ([name, measure?.read(state) ?? 0]));
    const most = values.reduce((most, value) => (value[1] > most[1] ? value : most), /** @type {const} */ (["", 0]));
    this.legend.hidden = measure === undefined;
    if (measure !== undefined) {
      this.legend.textContent = most[1] > 0 ? `most: ${measure.format(most[1])}, ${most[0]}` : "nothing was measured";
    }
    return new Map(values.map(([name, value]) => [name, most[1] > 0 ? value / most[1] : 0]));
  }
}
