/** The box around the object: drawn on the photograph, or written as four numbers. */

import { element, numberOf } from "./dom.js";
import { paint } from "./files.js";
import { Stage } from "./stage.js";

/** Pixels on the longer side of the photograph on which the box is drawn. */
const SHOWN = 640;

export class BoxPicker {
  #stage = new Stage("box-canvas", HTMLCanvasElement);
  #inputs = ["box-x0", "box-y0", "box-x1", "box-y1"].map((id) => element(id, HTMLInputElement));
  /** @type {import("./types.js").Box | null} */
  value = null;
  #width = 1;
  #height = 1;

  /** @param {() => void} changed */
  constructor(changed) {
    this.changed = changed;
    /** @type {[number, number] | null} */
    let from = null;
    const canvas = this.#stage.picture;
    canvas.addEventListener("pointerdown", (event) => {
      from = this.#stage.at(event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => { if (from) this.#between(from, this.#stage.at(event)); });
    canvas.addEventListener("pointerup", (event) => {
      if (from && this.#between(from, this.#stage.at(event))) this.changed();
      from = null;
    });
    canvas.addEventListener("pointercancel", () => { from = null; });
    for (const input of this.#inputs) {
      input.addEventListener("input", () => {
        const some = this.#inputs.some((each) => each.value);
        for (const each of this.#inputs) each.required = some;
        const [left, top, right, bottom] = this.#inputs;
        right?.setCustomValidity(some && right.valueAsNumber <= (left?.valueAsNumber ?? 0) ? "It must be larger than Left." : "");
        bottom?.setCustomValidity(some && bottom.valueAsNumber <= (top?.valueAsNumber ?? 0) ? "It must be larger than Top." : "");
        const [x0, y0, x1, y1] = this.#inputs.map(numberOf);
        if (some && (x0 == null || y0 == null || x1 == null || y1 == null)) return;
        this.value = some ? [x0 ?? 0, y0 ?? 0, x1 ?? 0, y1 ?? 0] : null;
        this.#mark();
        this.changed();
      });
    }
    element("box-clear", HTMLButtonElement).addEventListener("click", () => {
      this.set(null);
      this.changed();
    });
  }

  /**
   * @param {import("./source.js").PhotoSource} photo
   * @param {import("./source.js").SourceChooser} source
   * @param {AbortSignal} signal
   */
  async show(photo, source, signal) {
    const picture = await source.picture(photo.id, SHOWN, signal);
    [this.#width, this.#height] = photo.width ? [photo.width, photo.height] : [picture.width, picture.height];
    const canvas = this.#stage.picture;
    paint(canvas, picture);
    canvas.setAttribute("aria-label", `The photograph ${photo.name}, ${this.#width} by ${this.#height} pixels`);
    this.#stage.fit(this.#width, this.#height);
    this.#inputs.forEach((input, i) => { input.max = String(i % 2 ? this.#height : this.#width); });
    this.#mark();
  }

  /** @param {import("./types.js").Box | null} box */
  set(box) {
    this.value = box;
    this.#inputs.forEach((input, i) => {
      input.value = box ? String(box[i]) : "";
      input.required = box !== null;
      input.setCustomValidity("");
    });
    this.#mark();
  }

  /**
   * @param {[number, number]} a
   * @param {[number, number]} b
   * @returns {boolean} whether there is a box between these two points; a mere click makes none
   */
  #between([ax, ay], [bx, by]) {
    const inside = (/** @type {number} */ value, /** @type {number} */ most) => Math.min(most, Math.max(0, Math.round(value)));
    const x = [inside(ax, this.#width), inside(bx, this.#width)], y = [inside(ay, this.#height), inside(by, this.#height)];
    const least = Math.max(this.#width, this.#height) / 100;
    const [x0, x1, y0, y1] = [Math.min(...x), Math.max(...x), Math.min(...y), Math.max(...y)];
    if (x1 - x0 < least || y1 - y0 < least) return false;
    this.set([x0, y0, x1, y1]);
    return true;
  }

  #mark() {
    this.#stage.mark(this.value ? [{ box: this.value, strong: true }] : []);
  }
}
