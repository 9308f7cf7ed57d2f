/** The focal length of the camera, and where it comes from. */

import { element, numberOf } from "./dom.js";

export class FocalInput {
  #input = element("focal", HTMLInputElement);

  /**
   * @param {import("./source.js").SourceChooser} source
   * @param {(text: string) => void} changed
   */
  constructor(source, changed) {
    this.source = source;
    this.#input.addEventListener("change", () => {
      this.#explain();
      changed(this.#input.value);
    });
  }

  /** In pixels; null if it is not known. */
  get value() {
    return numberOf(this.#input);
  }

  /** @param {number} focal any that is not positive is unknown */
  set(focal) {
    this.#input.value = focal > 0 ? String(Math.round(focal * 10) / 10) : "";
    this.#explain();
  }

  #explain() {
    const source = this.source.value;
    const said = source?.kind === "photo" && source.focal && Math.abs(source.focal - this.#input.valueAsNumber) < 0.1;
    element("focal-about", HTMLElement).textContent = said ? "Read from the photograph’s EXIF data."
      : "Only if you know it: then the distance is the true one.";
  }
}
