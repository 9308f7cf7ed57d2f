/** A canvas with another one over it, for marks in pixels of an image. */

import { element } from "./dom.js";

/** Part of the window's height that a picture takes at most. */
const TALLEST = 75;

export class Stage {
  /** @type {[number, number]} width, height in pixels of the image */
  extent = [1, 1];
  #over;
  /** @type {{box: import("./types.js").Box, strong: boolean}[]} */
  #marks = [];

  /** @param {string} id of the canvas */
  constructor(id) {
    this.canvas = element(id, HTMLCanvasElement);
    this.#over = this.canvas.parentElement?.querySelector("canvas.over") ?? null;
    new ResizeObserver(() => this.#draw()).observe(this.canvas);
  }

  /**
   * @param {number} width of what the canvas shows, in pixels of the image
   * @param {number} height
   * @param {number} [widest] of what stands beside it, so that both have one scale
   * @param {number} [highest]
   */
  fit(width, height, widest = width, highest = height) {
    this.extent = [width, height];
    const stage = this.canvas.parentElement;
    if (!stage) return;
    stage.style.width = `min(${100 * width / widest}%, ${TALLEST * width / highest}vh)`;
    stage.style.aspectRatio = `${width} / ${height}`;
    this.#draw();
  }

  /**
   * @param {MouseEvent} event
   * @returns {[number, number]} in pixels of the image
   */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * this.extent[0], (event.clientY - box.top) / box.height * this.extent[1]];
  }

  /** @param {{box: import("./types.js").Box, strong: boolean}[]} marks */
  mark(marks) {
    this.#marks = marks;
    this.#draw();
  }

  #draw() {
    if (!(this.#over instanceof HTMLCanvasElement)) return;
    const box = this.canvas.getBoundingClientRect();
    const ratio = devicePixelRatio || 1;
    this.#over.width = Math.round(box.width * ratio);
    this.#over.height = Math.round(box.height * ratio);
    const context = this.#over.getContext("2d");
    if (!context) return;
    const [sx, sy] = [this.#over.width / this.extent[0], this.#over.height / this.extent[1]];
    for (const { box: [x0, y0, x1, y1], strong } of this.#marks) {
      // dark under bright, to be seen on every picture
      for (const [style, wide] of /** @type {[string, number][]} */ ([["#000", strong ? 4 : 3], [strong ? "#ffd23f" : "#fff", strong ? 2 : 1]])) {
        context.strokeStyle = style;
        context.lineWidth = wide * ratio;
        context.strokeRect(x0 * sx, y0 * sy, (x1 - x0) * sx, (y1 - y0) * sy);
      }
    }
  }
}
