/** The chart of distances, as SVG. */

import { draw, element } from "./dom.js";

const MARGIN = { left: 52, right: 12, top: 10, bottom: 34 };
const HEIGHT = 220;

export class DistanceChart {
  #svg = draw("svg", { role: "img" });
  /** @type {Parameters<DistanceChart["show"]>} */
  #last = [[], "No points yet"];

  /** @param {string} place id of a figure */
  constructor(place) {
    this.figure = element(place, HTMLElement);
    this.figure.append(this.#svg);
    // drawn anew at each width, so that texts keep their size
    new ResizeObserver(() => this.show(...this.#last)).observe(this.figure);
  }

  /**
   * @param {[number, number][]} points evaluations and distance
   * @param {string} words what the chart shows
   */
  show(points, words) {
    this.#last = [points, words];
    const width = Math.round(this.figure.clientWidth) || 480;
    const [right, bottom] = [width - MARGIN.right, HEIGHT - MARGIN.bottom];
    const [most, largest] = [Math.max(1, ...points.map(([x]) => x)), Math.max(1e-6, ...points.map(([, y]) => y))];
    const x = (/** @type {number} */ value) => MARGIN.left + value / most * (right - MARGIN.left);
    const y = (/** @type {number} */ value) => bottom - value / largest * (bottom - MARGIN.top);
    const line = points.map(([across, up]) => `${x(across).toFixed(1)},${y(up).toFixed(1)}`).join("L");
    const middle = (bottom + MARGIN.top) / 2;
    this.#svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    this.#svg.setAttribute("aria-label", words);
    this.#svg.replaceChildren(
      ...ticks(most).flatMap((value) => [
        draw("path", { class: "axis", d: `M${x(value)},${MARGIN.top}V${bottom}` }),
        draw("text", { x: x(value), y: bottom + 15, "text-anchor": value === most ? "end" : "middle" }, String(value))]),
      ...ticks(largest).flatMap((value) => [
        draw("path", { class: "axis", d: `M${MARGIN.left},${y(value)}H${right}` }),
        draw("text", { x: MARGIN.left - 6, y: y(value) + 4, "text-anchor": "end" }, String(value))]),
      draw("text", { x: (MARGIN.left + right) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, "evaluations"),
      draw("text", { x: 12, y: middle, transform: `rotate(-90 12 ${middle})`, "text-anchor": "middle" }, "distance"),
      ...points.length ? [draw("path", { class: "line", d: `M${line}` })] : []);
  }
}

/**
 * Round numbers from 0 on, some four.
 *
 * @param {number} most
 */
function ticks(most) {
  const power = 10 ** Math.floor(Math.log10(most / 4));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= most / 4) ?? 10);
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  return Array.from({ length: Math.floor(most / step + 1e-9) + 1 }, (_, i) => Number((i * step).toFixed(digits)));
}
