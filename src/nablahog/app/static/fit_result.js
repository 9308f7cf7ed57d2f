/** What a search for the pose has found: the outline on the photograph, the figures, and files of both. */

import { element, figure } from "./dom.js";
import { addressOf, pngOf, save, stem } from "./files.js";
import { poseTables } from "./pose.js";
import { showSnippets } from "./snippets.js";

export class FitResult {
  #place = element("fit-result", HTMLElement);
  /** @type {any} the message that ended the search */
  #message = null;

  /** @param {import("./source.js").SourceChooser} source */
  constructor(source) {
    this.source = source;
    element("pose-download", HTMLButtonElement).addEventListener("click", () => {
      const text = JSON.stringify(this.#message.result, null, 2);
      save(new Blob([text], { type: "application/json" }), `${this.#stem}_pose.json`);
    });
    element("overlay-download", HTMLButtonElement).addEventListener("click", () =>
      save(pngOf(this.#message.overlay), `${this.#stem}_overlay.png`));
  }

  get #stem() {
    return stem(this.source.value?.name ?? "");
  }

  hide() {
    this.#place.hidden = true;
  }

  /** @param {any} message */
  show(message) {
    this.#message = message;
    const { result } = message;
    const turned = `azimuth ${figure(result.azimuth, 1)}, elevation ${figure(result.elevation, 1)}`;
    const sure = result.confidence === null ? "" : `, confidence ${figure(result.confidence, 2)}`;
    element("fit-said", HTMLElement).textContent = `Done: ${turned}${sure}.`;
    const overlay = element("overlay", HTMLImageElement);
    overlay.src = addressOf(message.overlay);
    overlay.alt = `The outline of the mesh on ${result.photograph}, ${turned}`;
    element("overlay-about", HTMLElement).textContent =
      `The outline of the mesh on the ${result.photograph_camera ? "undistorted " : ""}photograph`;
    this.#showSecond(result.second, message.second_overlay);
    const warning = element("fit-warning", HTMLElement);
    warning.hidden = !message.warning;
    warning.textContent = message.warning ?? "";
    element("fit-figures", HTMLElement).replaceChildren(...poseTables(result));
    showSnippets(element("fit-snippets", HTMLElement), message.snippets, this.source.sample);
    this.#place.hidden = false;
  }

  /**
   * The runner-up that may be right, too.
   *
   * @param {any} second its figures, or null
   * @param {string | null} overlay
   */
  #showSecond(second, overlay) {
    element("second", HTMLElement).hidden = second === null;
    if (second === null || overlay === null) return;
    const where = `azimuth ${figure(second.azimuth, 1)}, elevation ${figure(second.elevation, 1)}`;
    const image = element("second-overlay", HTMLImageElement);
    image.src = addressOf(overlay);
    image.alt = `The outline of the mesh at the second answer, ${where}`;
    element("second-about", HTMLElement).textContent = `The second answer: ${where}, confidence ${figure(second.confidence, 2)}`;
  }
}
