// What the color of a box says: what became of its nodes, or their share of the time or of the memory.

/** @typedef {import("./types").NodeState} NodeState */

const KEPT = "maquette-profile";

/** @param {number} seconds */
export function inTime(seconds) {
  if (seconds >= 1) return `${seconds.toFixed(2)} s`;
  return `${(1000 * seconds).toFixed(seconds < 0.01 ? 1 : 0)} ms`;
}

/** @param {number} bytes */
export function inBytes(bytes) {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/**
 * What can be measured of a node, and how it is said.
 * @type {Record<string, {of: (known: NodeState) => number, say: (value: number) => string}>}
 */
const MEASURES = {
  time: { of: (known) => known.seconds ?? 0, say: inTime },
  bytes: { of: (known) => known.bytes ?? 0, say: inBytes },
};

export class Profile {
  /**
   * @param {HTMLSelectElement} select what is measured
   * @param {HTMLElement} legend says what the strongest color stands for
   * @param {() => void} changed is called when something else is to be measured
   */
  constructor(select, legend, changed) {
    this.select = select;
    this.legend = legend;
    const kept = sessionStorage.getItem(KEPT);
    if (kept !== null && kept in MEASURES) select.value = kept;
    select.addEventListener("change", () => {
      sessionStorage.setItem(KEPT, select.value);
      changed();
    });
  }

  /**
   * Each box's share of the largest measure, from 0 to 1.
   * @param {[string, NodeState][]} boxes
   * @returns {Map<string, number>}
   */
  shares(boxes) {
    const measure = MEASURES[this.select.value];
    const values = boxes.map(([name, known]) => /** @type {const} */ ([name, measure?.of(known) ?? 0]));
    const most = values.reduce((most, value) => (value[1] > most[1] ? value : most), /** @type {const} */ (["", 0]));
    this.legend.hidden = measure === undefined;
    if (measure !== undefined) {
      this.legend.textContent = most[1] > 0 ? `most: ${measure.say(most[1])}, ${most[0]}` : "nothing was measured";
    }
    return new Map(values.map(([name, value]) => [name, most[1] > 0 ? value / most[1] : 0]));
  }
}
