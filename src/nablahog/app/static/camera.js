/** The camera of the photograph: its focal length, where that comes from, and its principal point. */

import { element, numberOf } from "./dom.js";

export class CameraInput {
  #focal = element("focal", HTMLInputElement);
  #point = ["principal-x", "principal-y"].map((id) => element(id, HTMLInputElement));

  /**
   * @param {import("./source.js").SourceChooser} source
   * @param {() => void} changed
   */
  constructor(source, changed) {
    this.source = source;
    for (const input of [this.#focal, ...this.#point]) {
      input.addEventListener("change", () => {
        this.#explain();
        if (this.#isWhole()) changed();
      });
    }
  }

  /** In pixels; null if it is not known. */
  get focal() {
    return numberOf(this.#focal);
  }

  /** x and y in pixels; null for the middle of the photograph. */
  get principalPoint() {
    const [x, y] = this.#point.map(numberOf);
    return this.focal == null || x == null || y == null ? null : [x, y];
  }

  /**
   * @param {number} focal any that is not positive is unknown
   * @param {number[] | null} point
   */
  set(focal, point) {
    this.#focal.value = focal > 0 ? String(Math.round(focal * 10) / 10) : "";
    for (const [i, input] of this.#point.entries()) input.value = point ? String(point[i]) : "";
    this.#explain();
  }

  /** Whether both coordinates of the point are there, or none. */
  #isWhole() {
    return new Set(this.#point.map((input) => input.value === "")).size === 1;
  }

  #explain() {
    for (const input of this.#point) {
      input.disabled = this.#focal.value === "";
      input.required = !this.#isWhole();
    }
    const source = this.source.value;
    const said = source?.kind === "photo" && source.focal && Math.abs(source.focal - this.#focal.valueAsNumber) < 0.1;
    element("focal-about", HTMLElement).textContent = said ? "Read from the photograph’s EXIF data."
      : "Only if you know it: then the distance is the true one.";
  }
}
