/** The view “Invert”: the pre-image while it is made. */

import { getBlob, postFile, postJson } from "./api.js";
import { DistanceChart } from "./distance_chart.js";
import { bringIntoSight, checked, element, enable, figure, make, onPress, prefersReducedMotion, table } from "./dom.js";
import { addressOf, pngOf, save, stem } from "./files.js";
import { invert } from "./inversion.js";
import { Options } from "./options.js";
import { clearError, LatestRequest, waiting } from "./progress.js";
import { showSnippets } from "./snippets.js";
import { Stage } from "./stage.js";
import { wipe } from "./wipe.js";

/** Milliseconds between frames for readers who want less motion. */
const REDUCED = 500;

const ABOUT = { Distance: "of the descriptors, 0 if equal", CC: "correlation with the photograph, −1 … 1",
  SSIM: "structural similarity, 1 if equal", MI: "mutual information, bits", PSNR: "signal to noise" };

export class Invert {
  #options;
  #start = element("invert-start", HTMLButtonElement);
  #stop = element("invert-stop", HTMLButtonElement);
  #goOn = element("invert-go-on", HTMLButtonElement);
  #otherSeed = element("invert-other-seed", HTMLButtonElement);
  #stage = new Stage("preimage", HTMLImageElement);
  #image = this.#stage.picture;
  #chart = new DistanceChart("distance-chart");
  #newest = new LatestRequest("invert-progress");
  /** @type {import("./types.js").InvertDone | null} */
  #done = null;
  /** @type {string | null} base64 of the newest frame */
  #frame = null;
  #frames = 0;
  #painted = 0;
  /** @type {[number, number][]} */
  #curve = [];
  #drawing = 0;
  #runs = 0;
  /** Id of the source of what is shown. */
  #of = "";

  /** @param {import("./main.js").App} app */
  constructor(app) {
    this.app = app;
    this.#options = new Options("invert", app.about, app.address, () => this.explain());
    this.explain();
    onPress(this.#start, () => this.#run(null));
    onPress(this.#stop, () => this.#newest.abort());
    onPress(this.#goOn, () => this.#further());
    onPress(this.#otherSeed, () => {
      this.#options.set("seed", String(Number(this.#options.value.seed) + 1));
      void this.#run(null);
    });
    element("preimage-download", HTMLButtonElement).addEventListener("click", () => {
      if (this.#done) save(pngOf(this.#done.image), `${this.#stem}_preimage.png`);
    });
    element("invert-descriptor", HTMLButtonElement).addEventListener("click", () => void this.#descriptor());
    app.source.addEventListener("change", () => this.show());
  }

  /** Forgets what was made from another source. */
  show() {
    const id = this.app.source.value?.id ?? "";
    if (id !== this.#of) this.#reset();
    this.#of = id;
    this.explain();
  }

  get #stem() {
    return stem(this.app.source.value?.name ?? "");
  }

  restore() {
    this.#options.restore();
    this.explain();
  }

  /** Says which options count, and whether there is a prior; called when the view is shown, and when preset or parameters change. */
  explain() {
    const kind = this.app.dialect.preset.signed ? "signed" : "unsigned";
    const template = this.#isTemplate;
    this.#options.disable(template ? ["quality", "method", "prior"] : []);
    const { method, prior } = this.#options.value;
    const asked = method === "default" && prior === "default" && !template, learned = this.app.about.priors[kind];
    element("method-about", HTMLElement).textContent =
      template ? "A detector’s weights are searched in one way, without a prior: only the seed can be chosen."
      : !asked ? ""
      : learned ? "A search from the learned prior draws no random numbers: the seed changes nothing."
      : `There is no learned prior for presets with ${kind} directions: the search does without one.`;
    enable(this.#otherSeed, !(asked && learned));
  }

  /** Whether the source is the weights of a detector. */
  get #isTemplate() {
    const source = this.app.source.value;
    return source?.kind === "descriptor" && source.template;
  }

  /** What a request says about the source and the descriptor. */
  get #asked() {
    return { ...this.app.source.named, ...this.app.dialect.value, size: this.#options.value.size };
  }

  #reset() {
    this.#newest.abort();
    this.#runs++;
    this.#done = this.#frame = null;
    this.#frames = 0;
    this.#curve = [];
    this.#image.removeAttribute("src");
    this.#image.dataset.frames = "0";
    this.#state("", "The pre-image appears here: an image that has the same descriptor.");
    this.#image.setAttribute("aria-label", "No pre-image yet");
    this.#chart.show([], "No points yet");
    element("figures", HTMLElement).replaceChildren();
    element("invert-said", HTMLElement).textContent = "";
    element("invert-result", HTMLElement).hidden = true;
    this.#stage.fit(4, 3);
  }

  /**
   * @param {"" | "running" | "done" | "stopped"} state
   * @param {string} caption
   */
  #state(state, caption) {
    this.#image.dataset.state = state;
    element("preimage-caption", HTMLElement).textContent = caption;
    enable(this.#stop, state === "running");
    enable(this.#start, state !== "running");
    enable(this.#goOn, state !== "running" && !this.#isTemplate && Boolean(this.#done ?? this.#frame));
  }

  async #further() {
    let start = this.#done?.id;
    if (!start && this.#frame) {
      const frame = pngOf(this.#frame);
      start = (await this.#newest.run("Sending the last frame", (signal) =>
        postFile("api/photos", { name: "frame.png" }, frame, signal)))?.id;
    }
    if (start) await this.#run(start);
  }

  /** @param {string | null} start id of the picture to start from */
  async #run(start) {
    const source = this.app.source.value;
    if (!source || !checked(...document.querySelectorAll("#invert .bar, #dialect"))) return;
    clearError();
    const run = ++this.#runs;
    const before = start ? this.#curve.at(-1)?.[0] ?? 0 : 0;
    if (!start) {
      this.#curve = [];
      this.#frame = null;
    }
    this.#done = null;
    this.#frames = 0;
    this.#image.dataset.frames = "0";
    element("invert-result", HTMLElement).hidden = true;
    element("invert-said", HTMLElement).textContent = "";
    this.#state("running", "The pre-image is being made.");
    /** @type {string | null} */
    let photograph = null;
    const body = { ...this.#asked, ...this.#options.value, start };
    const controls = this.#start.closest(".bar") ?? this.#start;
    bringIntoSight(controls, this.#image);
    const result = await this.#newest.run("Making the pre-image", (signal, wait) => invert(body, signal, {
      queued: (count) => wait.say(count ? `Waiting: ${count} before this one` : "Waiting for the server"),
      start: (data) => {
        photograph = data.photograph;
        this.#stage.fit(data.image_size[1], data.image_size[0]);
        bringIntoSight(controls, this.#image);
        wait.say("Making the pre-image", 0, data.most);
      },
      frame: (data) => {
        if (signal.aborted) return;
        this.#frames++;
        this.#frame = data.image;
        this.#image.dataset.frames = String(this.#frames);
        this.#curve.push([before + data.evaluations, data.distance]);
        this.#paint(data.image);
        wait.say(`Making the pre-image: ${data.evaluations} evaluations`, data.evaluations, data.most);
        this.#later(data);
      },
    }));
    // a newer run, or another photograph, has taken over
    if (run !== this.#runs) return;
    cancelAnimationFrame(this.#drawing);
    if (result) this.#finish(result, photograph, before, source.name);
    else if (this.#frame) this.#stopped();
    else this.#reset();
  }

  /** @param {string} base64 a frame; those that come too fast for readers who want less motion are left out */
  #paint(base64) {
    if (prefersReducedMotion() && performance.now() - this.#painted < REDUCED) return;
    this.#image.src = addressOf(base64);
    this.#painted = performance.now();
  }

  /** @param {import("./types.js").InvertFrame} frame draws curve and figures with the next picture of the screen */
  #later(frame) {
    cancelAnimationFrame(this.#drawing);
    this.#drawing = requestAnimationFrame(() => {
      this.#drawCurve();
      this.#figures([["Distance", figure(frame.distance)], ["CC", figure(frame.cc)], ["SSIM", figure(frame.ssim)],
        ["Evaluations", frame.most ? `${frame.evaluations} of at most ${frame.most}` : String(frame.evaluations)]]);
    });
  }

  #stopped() {
    if (this.#frame) this.#image.src = addressOf(this.#frame);
    this.#drawCurve();
    this.#state("stopped", "Stopped. This is the last frame.");
    this.#image.setAttribute("aria-label", "The last frame of the pre-image");
    element("invert-said", HTMLElement).textContent = `Stopped after ${this.#frames} frames.`;
  }

  /**
   * @param {import("./types.js").InvertDone} done
   * @param {string | null} photograph
   * @param {number} before evaluations of earlier runs that this one goes on from
   * @param {string} name
   */
  #finish(done, photograph, before, name) {
    this.#done = done;
    this.#frame = done.image;
    this.#image.src = addressOf(done.image);
    if (this.#curve.length < 2 && done.history.length > 1) {
      const step = done.evaluations / (done.history.length - 1);
      this.#curve = done.history.map((distance, i) => [before + i * step, distance]);
    }
    this.#drawCurve();
    this.#state("done", `Pre-image, distance ${figure(done.distance)}`);
    this.#image.setAttribute("aria-label", `The pre-image of ${name || "the descriptor"}`);
    this.#figures([["Distance", figure(done.distance)], ["CC", figure(done.cc)], ["SSIM", figure(done.ssim)],
      ["MI", figure(done.mi)], ["PSNR", done.psnr === null ? "–" : `${figure(done.psnr, 1)} dB`],
      ["Evaluations", String(done.evaluations)], ["Seconds", figure(done.seconds, 1)], ["Stopped because", done.stop_reason]]);
    const known = done.cc === null ? "" : ` CC ${figure(done.cc)}, SSIM ${figure(done.ssim)}.`;
    element("invert-said", HTMLElement).textContent = `Done: distance ${figure(done.distance)}.${known}` + (done.negative
      ? ` The descriptor hardly says what is dark and what is bright (confidence ${figure(done.polarity, 2)}): the negative fits almost as well.`
      : "");
    this.#showBeside("faded", done.faded, "The pre-image, gray where it is not sure what is bright",
      "Gray where it is not sure what is bright");
    this.#showBeside("negative", done.negative, "The negative of the pre-image", "The negative");
    this.#showWipe(photograph, done.image);
    const definitions = Object.entries(done.definitions).filter(([name]) => name in done);
    element("definitions", HTMLElement).hidden = !definitions.length;
    document.querySelector("#definitions dl")?.replaceChildren(
      ...definitions.flatMap(([name, text]) => [make("dt", {}, name.toUpperCase()), make("dd", {}, text)]));
    showSnippets(element("invert-snippets", HTMLElement), done.snippets, this.app.source.sample);
    element("invert-result", HTMLElement).hidden = false;
  }

  /**
   * @param {string} id of the figure
   * @param {string | null} picture
   * @param {string} alt
   * @param {string} caption
   */
  #showBeside(id, picture, alt, caption) {
    const beside = element(id, HTMLElement);
    beside.hidden = !picture;
    beside.replaceChildren();
    if (picture) beside.append(make("img", { src: addressOf(picture), alt }), make("figcaption", {}, caption));
  }

  /**
   * @param {string | null} photograph
   * @param {string} preimage
   */
  #showWipe(photograph, preimage) {
    const place = element("wipe", HTMLElement);
    place.hidden = !photograph;
    if (!photograph) return;
    const [before, after] = ["Photograph", "Pre-image"];
    place.replaceChildren(
      make("div", {}, make("img", { src: addressOf(photograph), alt: before, draggable: "false" }),
        make("img", { src: addressOf(preimage), alt: after, draggable: "false" })),
      make("input", { type: "range", min: 0, max: 100, value: 50, "aria-label": `${before} or ${after}` }),
      make("figcaption", {}, make("span", {}, before), make("span", {}, after)));
    wipe(place);
  }

  #drawCurve() {
    const last = this.#curve.at(-1);
    this.#chart.show(this.#curve, last
      ? `The distance falls from ${figure(this.#curve[0]?.[1])} to ${figure(last[1])} in ${Math.round(last[0])} evaluations`
      : "No points yet");
  }

  /** @param {[string, string][]} rows */
  #figures(rows) {
    element("figures", HTMLElement).replaceChildren(
      table("Figures", ["Figure", "Value"], rows.filter(([, value]) => value !== "–"), [1], ABOUT));
  }

  async #descriptor() {
    const blob = await waiting("invert-progress", "Getting the descriptor", async (signal) => {
      /** @type {import("./types.js").Hog} */
      const hog = await postJson("api/hog", this.#asked, signal);
      return getBlob(`api/hog/${encodeURIComponent(hog.key)}/file`, signal);
    });
    if (blob) save(blob, `${this.#stem}.npz`);
  }
}
