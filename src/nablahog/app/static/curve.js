/** The similarity over all azimuths, as the server draws it, with the present pose on it and the steps of a search. */

import { element, make } from "./dom.js";
import { debounceBusy } from "./progress.js";

/** @typedef {import("./types.js").Pose} Pose */

export class Curve {
  #figure = element("curve", HTMLElement);
  #image = make("img", { alt: "Similarity over all azimuths: not computed yet", draggable: "false", hidden: true });
  #across = [0, 1];
  /** What the curve was asked for: all of the pose but the azimuth. */
  #asked = "";

  /**
   * @param {(azimuth: number) => void} picked where the pointer pressed
   * @param {(pose: Pose) => void} ask
   * @param {() => void} resized the chart is to be drawn anew, so that texts keep their size
   */
  constructor(picked, ask, resized) {
    this.#figure.append(this.#image);
    this.#image.addEventListener("click", (event) => {
      const box = this.#image.getBoundingClientRect();
      const [from = 0, to = 1] = this.#across;
      const share = ((event.clientX - box.left) / box.width - from) / (to - from);
      if (share >= 0 && share <= 1) picked(360 * share);
    });
    let width = 0;
    new ResizeObserver(() => {
      if (width && this.width && this.width !== width) resized();
      width = this.width;
    }).observe(this.#figure);
    this.later = debounceBusy((/** @type {Pose} */ pose) => {
      if (this.fits(pose)) return;
      this.#asked = rest(pose);
      ask(pose);
    }, 500);
  }

  /** In pixels. */
  get width() {
    return Math.round(this.#figure.clientWidth);
  }

  /**
   * @param {Pose} pose
   * @returns {boolean} whether the curve that is computed is that of this pose
   */
  fits(pose) {
    return rest(pose) === this.#asked;
  }

  /** @param {import("./types.js").SimilarityChart} chart */
  show({ svg, description, across }) {
    this.#image.src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
    this.#image.alt = description;
    this.#image.hidden = false;
    this.#across = across;
  }

  clear() {
    this.#image.hidden = true;
    this.#asked = "";
  }
}

/** @param {Pose} pose */
const rest = (pose) => pose.slice(1).map((value) => value.toFixed(2)).join();
