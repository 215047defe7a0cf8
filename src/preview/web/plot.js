// Line plots of series of numbers over one axis.

import { shape } from "./element.js";

/** @typedef {import("./types").Series} Series */

/** Colors of series, the same as those of `maquette render`. */
const COLORS = ["#5c98e8", "#be5028", "#468c5a", "#d6aa3c"];

/** The margins for labels, in pixels. */
const [LEFT, TOP, RIGHT, BOTTOM] = [70, 34, 20, 34];

/** The axis of numbers is logarithmic if the maximum is more than this many times the minimum and all are positive. */
const LOG_RATIO = 100;

const format = (/** @type {number} */ x) => (x !== 0 && (Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3) ? x.toExponential(1).replace(".0", "") : String(Number(x.toPrecision(4))));

/**
 * Returns round numbers from `low` to `high`.
 * @param {number} low
 * @param {number} high
 */
function ticks(low, high) {
  const rough = (high - low) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5, 10].find((step) => step * power >= rough) ?? 10) * power;
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.max(0, Math.floor(high / step) - first + 1) }, (_, k) => (first + k) * step);
}

/**
 * The range of some numbers, widened by 0.5 on both sides if they are all equal.
 * @param {number[]} numbers
 */
function rangeOf(numbers) {
  const [low, high] = numbers.reduce(([low, high], x) => [Math.min(low, x), Math.max(high, x)], [Infinity, -Infinity]);
  return low < high ? [low, high] : low === high ? [low - 0.5, high + 0.5] : [0, 1];
}

export class Plot {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.place = place;
    this.drawn = "";
  }

  /**
   * Draws series, and dashed those that are held for comparison. Hides the plot if `series` is null.
   * @param {Series[] | null} series
   * @param {Series[]} held
   */
  show(series, held) {
    this.place.hidden = series === null;
    if (series === null) return;
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    const drawn = JSON.stringify([series, held, width, height]);
    if (drawn === this.drawn || width < LEFT + RIGHT + 20 || height < TOP + BOTTOM + 20) return;
    this.drawn = drawn;
    const known = (/** @type {any} */ x) => typeof x === "number" && Number.isFinite(x);
    const all = [...series, ...held];
    const numbers = all.flatMap((one) => one.numbers.filter(known));
    const positive = numbers.filter((x) => x > 0);
    const isLog = positive.length > 0 && positive.length === numbers.length && Math.max(...positive) > LOG_RATIO * Math.min(...positive);
    const up = (/** @type {number} */ x) => (isLog ? Math.log10(x) : x);
    const [left, right] = rangeOf(all.flatMap((one) => one.at.filter(known)));
    const [low, high] = rangeOf(numbers.map(up));
    const x = (/** @type {number} */ at) => LEFT + ((width - LEFT - RIGHT) * (at - left)) / (right - left);
    const y = (/** @type {number} */ level) => height - BOTTOM - ((height - TOP - BOTTOM) * (level - low)) / (high - low);
    const picture = shape("svg", { width, height, role: "img", "aria-label": series.map((one) => one.name).join(", ") });
    const rows = isLog ? Array.from({ length: Math.floor(high) - Math.ceil(low) + 1 }, (_, k) => Math.ceil(low) + k) : ticks(low, high);
    for (const row of rows) {
      picture.append(shape("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(row), y2: y(row) }));
      picture.append(shape("text", { x: LEFT - 8, y: y(row) + 4, "text-anchor": "end" }, format(isLog ? 10 ** row : row)));
    }
    for (const column of ticks(left, right)) {
      picture.append(shape("line", { class: "grid", x1: x(column), x2: x(column), y1: TOP, y2: height - BOTTOM }));
      picture.append(shape("text", { x: x(column), y: height - BOTTOM + 18, "text-anchor": "middle" }, format(column)));
    }
    const draw = (/** @type {Series} */ { name, at, numbers }, /** @type {number} */ k, /** @type {boolean} */ isHeld) => {
      const color = COLORS[k % COLORS.length];
      const places = at.flatMap((place, k) => (known(place) && known(numbers[k]) ? `${x(place).toFixed(1)},${y(up(numbers[k])).toFixed(1)}` : []));
      const line = shape("polyline", { points: places.join(" "), fill: "none", stroke: color, "stroke-width": 2, ...(isHeld ? { "stroke-dasharray": "5 4" } : {}) });
      picture.append(line);
      if (isHeld) return;
      const last = numbers.findLast(known);
      picture.append(shape("rect", { x: width - RIGHT - 170 * (series.length - k), y: 10, width: 10, height: 10, fill: color }));
      picture.append(shape("text", { x: width - RIGHT - 170 * (series.length - k) + 16, y: 19 }, last === undefined ? name : `${name}, last ${format(last)}`));
    };
    held.forEach((one, k) => draw(one, k, true));
    series.forEach((one, k) => draw(one, k, false));
    this.place.replaceChildren(picture);
  }
}
