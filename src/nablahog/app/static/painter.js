/** Pictures that come one after the other. */

import { prefersReducedMotion } from "./dom.js";
import { paint, pictureOf, pngOf } from "./files.js";

/** Milliseconds between frames for readers who want less motion. */
const REDUCED = 500;

/** Draws the newest of the pictures that it is given; those that come too fast are left out. */
export class Painter {
  /** @type {string | null} */
  #next = null;
  #busy = false;
  #last = 0;
  #generation = 0;

  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
  }

  /**
   * @param {string} base64
   * @param {boolean} [now] the last picture is never left out
   */
  show(base64, now = false) {
    if (!now && prefersReducedMotion() && performance.now() - this.#last < REDUCED) return;
    this.#next = base64;
    if (!this.#busy) void this.#paint();
  }

  /** Drops the pictures that have come until now. */
  forget() {
    this.#next = null;
    this.#generation++;
  }

  async #paint() {
    this.#busy = true;
    while (this.#next !== null) {
      const base64 = this.#next;
      this.#next = null;
      const generation = this.#generation;
      const picture = await pictureOf(pngOf(base64));
      if (generation === this.#generation) paint(this.canvas, picture);
      picture.close();
      this.#last = performance.now();
    }
    this.#busy = false;
  }
}
