/** The similarity over all azimuths, with the present pose on it and the steps of a search. */

import { Chart } from "./chart.js";
import { figure } from "./dom.js";
import { round360 } from "./pose.js";
import { debounceBusy } from "./progress.js";

/** @typedef {import("./types.js").Pose} Pose */

const MOST_STEPS = 300;

export class Curve {
  #chart = new Chart("curve", { x: "azimuth, degrees", y: "similarity", across: [0, 360] });
  /** @type {Map<number, number>} */
  #points = new Map();
  /** What the curve was asked for: all of the pose but the azimuth. */
  #asked = "";
  #old = false;
  #frame = 0;
  /** @type {{x: number, y: number, slope: number} | null} */
  #here = null;
  /** @type {[number, number][]} */
  steps = [];

  /**
   * @param {(azimuth: number) => void} picked
   * @param {(pose: Pose) => void} ask
   */
  constructor(picked, ask) {
    this.#chart.onPick(picked);
    this.later = debounceBusy((/** @type {Pose} */ pose) => {
      const key = rest(pose);
      if (key === this.#asked) return;
      this.#asked = key;
      ask(pose);
    }, 500);
  }

  /**
   * @param {Pose} pose
   * @returns {boolean} whether the curve that is computed is that of this pose
   */
  fits(pose) {
    return rest(pose) === this.#asked;
  }

  /** @param {Pose} pose its curve is asked for once it stays */
  want(pose) {
    this.#old = rest(pose) !== this.#asked;
    this.later(pose);
    this.#draw();
  }

  /**
   * @param {{azimuths: number[], similarities: number[], done: boolean}} message
   * @returns {boolean} whether it was the last
   */
  add(message) {
    if (message.azimuths[0] === 0) this.#points.clear(); // a sweep begins there
    message.azimuths.forEach((azimuth, i) => this.#points.set(round360(azimuth), message.similarities[i] ?? NaN));
    this.#old = false;
    this.#draw();
    return message.done;
  }

  /**
   * @param {Pose} pose
   * @param {{similarity: number, slope: number} | null} view null: not known yet
   */
  here(pose, view) {
    const x = round360(pose[0] ?? 0);
    if (view) this.#here = { x, y: view.similarity, slope: view.slope };
    this.#draw();
  }

  /**
   * @param {Pose} pose
   * @param {number} similarity
   */
  step(pose, similarity) {
    this.steps.push([round360(pose[0] ?? 0), similarity]);
    if (this.steps.length > MOST_STEPS) this.steps.shift();
    this.#draw();
  }

  clear() {
    this.#points.clear();
    this.steps = [];
    this.#here = null;
    this.#asked = "";
    this.#draw();
  }

  #draw() {
    cancelAnimationFrame(this.#frame);
    this.#frame = requestAnimationFrame(() => {
      const points = [...this.#points].sort((a, b) => a[0] - b[0]);
      const first = points[0];
      // the circle is closed
      if (first && first[0] === 0) points.push([360, first[1]]);
      const best = points.reduce((a, b) => b[1] > a[1] ? b : a, [0, -Infinity]);
      const words = points.length
        ? `Similarity over all azimuths; the largest is ${figure(best[1])} at ${Math.round(best[0])} degrees`
        : "Similarity over all azimuths: not computed yet";
      this.#chart.show([{ points, kind: this.#old ? "old" : "line" }, { points: this.steps, kind: "dots" }],
        this.#here ? `${words}; here ${figure(this.#here.y)} at ${Math.round(this.#here.x)} degrees` : words, this.#here);
    });
  }
}

/** @param {Pose} pose */
const rest = (pose) => pose.slice(1).map((value) => value.toFixed(2)).join();
