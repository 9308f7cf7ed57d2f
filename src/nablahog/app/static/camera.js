/** The camera of the photograph: its focal length and principal point, or all numbers of a calibration. */

import { postFile } from "./api.js";
import { element, numberOf } from "./dom.js";
import { clearError, LatestRequest } from "./progress.js";

export class CameraInput {
  #focal = element("focal", HTMLInputElement);
  #point = ["principal-x", "principal-y"].map((id) => element(id, HTMLInputElement));
  #intrinsics = element("intrinsics", HTMLInputElement);
  #distortion = element("distortion", HTMLInputElement);
  #file = element("camera-file", HTMLInputElement);
  #newest = new LatestRequest("fit-progress");

  /**
   * @param {import("./source.js").SourceChooser} source
   * @param {() => void} changed
   */
  constructor(source, changed) {
    this.source = source;
    this.changed = changed;
    for (const input of [this.#focal, ...this.#point, this.#intrinsics, this.#distortion]) {
      input.addEventListener("change", () => {
        this.#explain();
        if (this.#isWhole()) changed();
      });
    }
    this.#file.addEventListener("change", () => { if (this.#file.files?.[0]) void this.read(this.#file.files[0]); });
  }

  /** As a request has it: in pixels; null for what is not known. */
  get value() {
    const intrinsics = numbersIn(this.#intrinsics.value), distortion = numbersIn(this.#distortion.value);
    const [x, y] = this.#point.map(numberOf);
    const focal = intrinsics ? null : numberOf(this.#focal);
    return { focal, principal_point: focal == null || x == null || y == null ? null : [x, y], intrinsics, distortion };
  }

  /** As the address has it. */
  get state() {
    const { focal, principal_point: point } = this.value;
    return { focal: focal ?? "none", axis: point?.join(",") ?? null, intrinsics: this.#intrinsics.value.trim(),
      distortion: this.#distortion.value.trim() };
  }

  /**
   * @param {number} focal any that is not positive is unknown
   * @param {number[] | null} point
   * @param {string} intrinsics
   * @param {string} distortion
   */
  set(focal, point, intrinsics, distortion) {
    this.#newest.abort();
    this.#focal.value = focal > 0 ? String(Math.round(focal * 10) / 10) : "";
    for (const [i, input] of this.#point.entries()) input.value = point ? String(point[i]) : "";
    this.#intrinsics.value = intrinsics;
    this.#distortion.value = distortion;
    this.#file.value = "";
    element("calibrated", HTMLDetailsElement).open ||= intrinsics !== "" || distortion !== "";
    this.#explain();
  }

  /** @param {File} file of a camera, whose numbers are written into the fields */
  async read(file) {
    clearError();
    const query = { name: file.name, photo: this.source.value?.id ?? "" };
    /** @type {{intrinsics: number[], distortion: number[] | null} | undefined} */
    const camera = await this.#newest.run(`Reading ${file.name}`, (signal) => postFile("api/cameras", query, file, signal));
    this.#file.value = "";  // so that the same file can be chosen again
    if (!camera) return;
    element("calibrated", HTMLDetailsElement).open = true;
    this.#intrinsics.value = camera.intrinsics.join(", ");
    this.#distortion.value = camera.distortion?.join(", ") ?? "";
    this.#explain();
    this.changed();
  }

  /** Whether both coordinates of the point are there, or none. */
  #isWhole() {
    return new Set(this.#point.map((input) => input.value === "")).size === 1;
  }

  #explain() {
    const calibrated = this.#intrinsics.value.trim() !== "";
    this.#focal.disabled = calibrated;
    for (const input of this.#point) {
      input.disabled = calibrated || this.#focal.value === "";
      input.required = !this.#isWhole();
    }
    const source = this.source.value;
    const said = source?.kind === "photo" && source.focal && Math.abs(source.focal - this.#focal.valueAsNumber) < 0.1;
    element("focal-about", HTMLElement).textContent = calibrated ? "The intrinsics below have it."
      : said ? "Read from the photograph’s EXIF data." : "Only if you know it: then the distance is the true one.";
  }
}

/**
 * The numbers in a text, a camera matrix as rows; words in between as they are, so that the server says what is wrong.
 *
 * @param {string} text
 */
function numbersIn(text) {
  const numbers = text.split(/[\s,;[\]()]+/).filter(Boolean).map((word) => Number.isFinite(Number(word)) ? Number(word) : word);
  if (numbers.length === 9) return [0, 3, 6].map((first) => numbers.slice(first, first + 3));
  return numbers.length ? numbers : null;
}
