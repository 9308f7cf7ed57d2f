/** The strip in “Invert” that compares presets and methods, one after the other. */

import { element, figure, make, numberOf } from "./dom.js";
import { invert, methodName, Painter } from "./inversion.js";
import { clearError, LatestRequest } from "./progress.js";

const PRESETS = ["uoctti", "vlfeat", "dpm", "paper", "skimage", "opencv"];
const METHODS = ["prior", "no-prior"];

export class Strip {
  #newest = new LatestRequest("strip-progress");
  #start = element("strip-start", HTMLButtonElement);
  #stop = element("strip-stop", HTMLButtonElement);
  #size = element("strip-size", HTMLInputElement);

  /**
   * @param {import("./main.js").App} app
   * @param {() => number} seed
   */
  constructor(app, seed) {
    this.app = app;
    this.seed = seed;
    this.#size.max = String(app.about.limits.invert_size);
    const boxes = (/** @type {string} */ place, /** @type {{id: string, name: string}[]} */ choices, /** @type {string[]} */ first) =>
      element(place, HTMLElement).append(...choices.map(({ id, name }) => make("label", { class: "check" },
        make("input", { type: "checkbox", value: id, checked: first.includes(id) }), ` ${name}`)));
    boxes("strip-presets", app.about.presets.map(({ name }) => ({ id: name, name })), PRESETS);
    boxes("strip-methods", app.about.methods.filter((id) => METHODS.includes(id)).map((id) => ({ id, name: methodName(id) })),
      ["prior"]);
    this.#start.addEventListener("click", () => void this.#run());
    this.#stop.addEventListener("click", () => this.#newest.abort());
    app.source.addEventListener("change", () => {
      this.#newest.abort();
      element("strip", HTMLElement).replaceChildren();
      this.show();
    });
  }

  show() {
    element("strip-details", HTMLElement).hidden = this.app.source.value?.kind !== "photo";
  }

  async #run() {
    const chosen = (/** @type {string} */ place) =>
      [...document.querySelectorAll(`#${place} input:checked`)].map((each) => each instanceof HTMLInputElement ? each.value : "");
    const jobs = chosen("strip-presets").flatMap((preset) => chosen("strip-methods").map((method) => ({ preset, method })));
    const strip = element("strip", HTMLElement);
    strip.replaceChildren();
    if (!jobs.length) {
      strip.append(make("p", {}, "Choose a preset and a method."));
      return;
    }
    clearError();
    this.#start.disabled = true;
    this.#stop.disabled = false;
    const size = numberOf(this.#size) ?? 128;
    const named = this.app.source.named;
    const own = this.app.dialect.value;
    await this.#newest.run("Compares", async (signal, wait) => {
      for (const [i, { preset, method }] of jobs.entries()) {
        wait.say(`${preset}, ${methodName(method)}: ${i + 1} of ${jobs.length}`, i, jobs.length);
        const canvas = make("canvas", { width: 2, height: 2, role: "img", "aria-label": `${preset}, ${methodName(method)}: not done yet` });
        const caption = make("figcaption", {}, make("strong", {}, preset), make("br"), methodName(method));
        strip.append(make("figure", {}, canvas, caption));
        const painter = new Painter(canvas);
        // the preset that is chosen above has its parameters
        const settings = preset === own.preset ? own.settings : {};
        try {
          const done = await invert({ ...named, preset, settings, size, method, quality: "fast", seed: this.seed(), start: null },
            signal, { frame: (frame) => painter.show(frame.image) });
          painter.show(done.image, true);
          canvas.setAttribute("aria-label", `Pre-image of ${preset}, ${methodName(method)}: CC ${figure(done.cc)}`);
          caption.append(make("br"), `CC ${figure(done.cc)}, SSIM ${figure(done.ssim)}`);
        } catch (error) {
          if (signal.aborted) throw error;
          // one that cannot be done, as a window larger than the photograph, is named; the others are done
          caption.append(make("br"), error instanceof Error ? error.message : String(error));
        }
      }
    });
    this.#start.disabled = false;
    this.#stop.disabled = true;
  }
}
