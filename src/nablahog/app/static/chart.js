/** Line charts as SVG. */

import { draw, element } from "./dom.js";

/** @typedef {{points: [number, number][], kind: "line" | "old" | "dots"}} Series */

const MARGIN = { left: 52, right: 12, top: 10, bottom: 34 };

export class Chart {
  #svg = draw("svg", { role: "img" });
  #wide = 480;
  #high = 220;
  /** @type {Parameters<Chart["show"]>} */
  #last = [[], "No points yet"];
  /** @type {[number, number]} */
  #across = [0, 1];

  /**
   * @param {string} place id of a figure
   * @param {{x: string, y: string, across?: [number, number]}} options labels of the axes; the range of x
   */
  constructor(place, options) {
    this.options = options;
    this.figure = element(place, HTMLElement);
    this.figure.classList.add("chart");
    this.figure.append(this.#svg);
    // drawn anew at each width, so that texts keep their size
    new ResizeObserver(() => {
      const wide = Math.round(this.figure.clientWidth);
      if (wide && wide !== this.#wide) this.#wide = wide;
      this.show(...this.#last);
    }).observe(this.figure);
  }

  /** @param {(x: number) => void} picked where the pointer pressed */
  onPick(picked) {
    this.#svg.addEventListener("click", (event) => {
      const box = this.#svg.getBoundingClientRect();
      const x = (event.clientX - box.left) / box.width * this.#wide;
      const share = (x - MARGIN.left) / (this.#wide - MARGIN.left - MARGIN.right);
      if (share >= 0 && share <= 1) picked(this.#across[0] + share * (this.#across[1] - this.#across[0]));
    });
  }

  /**
   * @param {Series[]} series
   * @param {string} words what the chart shows
   * @param {{x: number, y: number, slope: number} | null} [here] a point with its tangent
   */
  show(series, words, here = null) {
    this.#last = [series, words, here];
    const wide = this.#wide, high = this.#high;
    const points = series.flatMap((each) => each.points);
    const ys = [...points.map((point) => point[1]), ...here ? [here.y] : []].filter(Number.isFinite);
    const xs = points.map((point) => point[0]);
    const [x0, x1] = this.options.across ?? [Math.min(0, ...xs), Math.max(1, ...xs)];
    this.#across = [x0, x1];
    let [y0, y1] = ys.length ? [Math.min(...ys), Math.max(...ys)] : [0, 1];
    if (this.options.across) [y0, y1] = [y0 - 0.08 * (y1 - y0) - 1e-9, y1 + 0.08 * (y1 - y0) + 1e-9];
    else y0 = 0;
    if (y1 - y0 < 1e-6) [y0, y1] = [y0 - 0.5, y1 + 0.5];
    const x = (/** @type {number} */ value) => MARGIN.left + (value - x0) / (x1 - x0) * (wide - MARGIN.left - MARGIN.right);
    const y = (/** @type {number} */ value) => high - MARGIN.bottom - (value - y0) / (y1 - y0) * (high - MARGIN.top - MARGIN.bottom);
    const middle = (MARGIN.left + wide - MARGIN.right) / 2;
    const nodes = [];
    const across = this.options.across ? [0, 90, 180, 270, 360] : ticks(x0, x1);
    for (const value of across) {
      nodes.push(draw("path", { class: "axis", d: `M${x(value)},${MARGIN.top}V${high - MARGIN.bottom}` }),
        draw("text", { x: x(value), y: high - MARGIN.bottom + 15, "text-anchor": value === x1 ? "end" : "middle" },
          String(value)));
    }
    for (const value of ticks(y0, y1)) {
      nodes.push(draw("path", { class: "axis", d: `M${MARGIN.left},${y(value)}H${wide - MARGIN.right}` }),
        draw("text", { x: MARGIN.left - 6, y: y(value) + 4, "text-anchor": "end" }, String(value).replace("-", "−")));
    }
    nodes.push(draw("text", { x: middle, y: high - 4, "text-anchor": "middle" }, this.options.x),
      draw("text", { x: 12, y: high / 2 - 12, transform: `rotate(-90 12 ${high / 2 - 12})`, "text-anchor": "middle" },
        this.options.y));
    for (const { points: each, kind } of series) {
      const places = each.filter((point) => point.every(Number.isFinite));
      if (kind === "dots") {
        nodes.push(...places.map((point) => draw("circle", { class: "dot", r: 3, cx: x(point[0]), cy: y(point[1]) })));
      } else if (places.length) {
        nodes.push(draw("path", { class: kind === "old" ? "line old" : "line",
          d: `M${places.map((point) => `${x(point[0]).toFixed(1)},${y(point[1]).toFixed(1)}`).join("L")}` }));
      }
    }
    if (here) {
      const reach = (x1 - x0) / 24;
      nodes.push(draw("path", { class: "tangent", d: `M${x(here.x - reach)},${y(here.y - reach * here.slope)}` +
        `L${x(here.x + reach)},${y(here.y + reach * here.slope)}` }),
      draw("circle", { class: "here", r: 5, cx: x(here.x), cy: y(here.y) }));
    }
    this.#svg.setAttribute("viewBox", `0 0 ${wide} ${high}`);
    this.#svg.setAttribute("aria-label", words);
    this.#svg.replaceChildren(...nodes);
  }
}

/**
 * Round numbers between two, some four.
 *
 * @param {number} from
 * @param {number} to
 */
function ticks(from, to) {
  const rough = (to - from) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((each) => each * power >= rough) ?? 10);
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  const values = [];
  for (let value = Math.ceil(from / step - 1e-9) * step; value <= to + 1e-9 * step; value += step) {
    values.push(Number(value.toFixed(digits)));
  }
  return values;
}
