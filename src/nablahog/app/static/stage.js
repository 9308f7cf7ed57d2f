/** A picture with marks over it, in pixels of the image. */

import { draw, element } from "./dom.js";

/** Part of the window's height that a picture takes at most. */
const TALLEST = 75;

/** @template {HTMLElement} T a canvas or an image */
export class Stage {
  /** @type {[number, number]} width, height in pixels of the image */
  extent = [1, 1];

  /**
   * @param {string} id of the picture
   * @param {new () => T} kind
   */
  constructor(id, kind) {
    this.picture = element(id, kind);
    this.over = this.picture.parentElement?.querySelector("svg.over") ?? null;
  }

  /**
   * @param {number} width of what the picture shows, in pixels of the image
   * @param {number} height
   * @param {number} [widest] of what stands beside it, so that both have one scale
   * @param {number} [highest]
   */
  fit(width, height, widest = width, highest = height) {
    this.extent = [width, height];
    this.over?.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const stage = this.picture.parentElement;
    if (!stage) return;
    stage.style.width = `min(${100 * width / widest}%, ${TALLEST * width / highest}vh)`;
    stage.style.aspectRatio = `${width} / ${height}`;
  }

  /**
   * @param {MouseEvent} event
   * @returns {[number, number]} in pixels of the image
   */
  at(event) {
    const box = this.picture.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * this.extent[0], (event.clientY - box.top) / box.height * this.extent[1]];
  }

  /** @param {{box: import("./types.js").Box, strong: boolean}[]} marks */
  mark(marks) {
    // dark under bright, to be seen on every picture
    this.over?.replaceChildren(...marks.flatMap(({ box: [x0, y0, x1, y1], strong }) => ["dark", "bright"].map((shade) =>
      draw("rect", { class: `${shade} ${strong ? "strong" : ""}`, x: x0, y: y0, width: x1 - x0, height: y1 - y0 }))));
  }
}
