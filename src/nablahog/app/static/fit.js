/** The view “Fit”: a mesh over a photograph, and the search for its pose. */

import { ServerError } from "./api.js";
import { BoxPicker } from "./box.js";
import { CameraInput } from "./camera.js";
import { Curve } from "./curve.js";
import { bringIntoSight, checked, debounce, element, enable, figure, make, onPress, prefersReducedMotion } from "./dom.js";
import { addressOf } from "./files.js";
import { FitResult } from "./fit_result.js";
import { MeshChooser } from "./mesh.js";
import { Options } from "./options.js";
import { PoseControls, proper } from "./pose.js";
import { announce, clearError, showError, LatestRequest, debounceBusy, Waits } from "./progress.js";
import { Scene } from "./scene.js";
import { Session } from "./session.js";

/** @typedef {import("./types.js").Pose} Pose */

const FIRST_POSE = [30, 15, 2.5, 0, 0, 0];

export class Fit {
  #session = new Session((message) => this.#received(message), () => this.#lost());
  #box = new BoxPicker(() => this.#boxed());
  #controls = new PoseControls((pose) => this.#turn(proper(pose)));
  #scene = new Scene(() => this.#controls.value, (pose) => this.#turn(pose));
  #curve;
  #photoGlyphs = element("photo-glyphs", HTMLImageElement);
  #renderGlyphs = element("render-glyphs", HTMLImageElement);
  #photo = new LatestRequest("fit-progress");
  #options;
  #result;
  #camera;
  #start = element("fit-start", HTMLButtonElement);
  #stop = element("fit-stop", HTMLButtonElement);
  #shown = false;
  /** Id of the photograph of what is shown. */
  #of = "";
  #ready = false;
  #n = 0;
  #drawn = 0;
  #placing = 0;
  #frame = 0;
  #lastStep = 0;
  /** For an answer to each kind of message. */
  #waits = new Waits();
  #reopen = debounceBusy(() => { if (this.#ready) void this.#open(); }, 300);
  #remember = debounce(() => this.app.address.set({ pose: this.#controls.value.map((value) => Number(value.toFixed(3))).join(",") }), 100);

  /** @param {import("./main.js").App} app */
  constructor(app) {
    this.app = app;
    this.mesh = new MeshChooser(app.about, app.address, () => this.#reopen());
    this.#curve = new Curve((azimuth) => this.#turn(this.#controls.value.map((old, i) => i ? old : azimuth)),
      (pose) => this.#askCurve(pose), () => this.#turn(this.#controls.value));
    this.#options = new Options("fit", app.about, app.address);
    this.#result = new FitResult(app.source);
    this.#camera = new CameraInput(app.source, () => {
      app.address.set(this.#camera.state);
      this.#reopen();
    });
    this.restore();
    app.source.addEventListener("change", () => this.show(this.#shown));
    addEventListener("pagehide", () => this.#leave());
    element("fit-open", HTMLButtonElement).addEventListener("click", () => void this.#open());
    element("pose-place", HTMLButtonElement).addEventListener("click", () => this.#turn(this.#controls.value, true));
    onPress(this.#start, () => this.#fit());
    onPress(this.#stop, () => this.#session.send({ type: "stop" }));
  }

  restore() {
    const { address } = this.app;
    this.#restoreObject();
    this.#controls.write(proper(address.numbers("pose", 6) ?? FIRST_POSE));
    this.#options.restore();
    this.mesh.restore();
    if (this.#ready) this.#reopen();
  }

  /** Takes box and camera from the address, or else from the photograph. */
  #restoreObject() {
    const { address, source: { value } } = this.app;
    const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = address.numbers("box", 4) ?? [];
    const photo = value?.kind === "photo" ? value : null;
    this.#box.set(x1 > x0 ? [x0, y0, x1, y1] : address.get("box") === null ? photo?.box ?? null : null);
    this.#camera.set(Number(address.get("focal") ?? photo?.focal), address.numbers("axis", 2),
      address.get("intrinsics") ?? "", address.get("distortion") ?? "");
  }

  /** @param {boolean} shown */
  show(shown) {
    this.#shown = shown;
    const source = this.app.source.value;
    element("fit-needs", HTMLElement).hidden = source?.kind === "photo";
    element("fit-ask", HTMLElement).hidden = source?.kind !== "photo";
    if (!shown || source?.id === this.#of) return;
    this.#leave();
    this.#of = source?.id ?? "";
    this.#restoreObject();
    if (source?.kind !== "photo") return;
    void this.#photo.run("Loading the photograph", (signal) => this.#box.show(source, this.app.source, signal)).then(() => {
      if (this.#of === source.id && this.app.address.get("pose") !== null) void this.#open(); // a reload returns to it
    });
  }

  /** @param {File} file of a mesh that was dropped */
  openMesh(file) {
    void this.mesh.open(file);
  }

  /** @param {File} file of a camera that was dropped */
  openCamera(file) {
    if (this.app.source.value?.kind === "photo") void this.#camera.read(file);
    else showError(new ServerError(0, `${file.name}: a camera’s file is for a photograph; choose that first.`));
  }

  #boxed() {
    this.app.address.set({ box: this.#box.value?.join(",") ?? "none" });
    if (!this.#ready) return;
    // the old pose is for another crop
    this.app.address.set({ pose: null });
    this.#reopen();
  }

  async #open() {
    const source = this.app.source.value;
    if (source?.kind !== "photo" || !checked(element("fit-ask", HTMLElement))) return;
    clearError();
    this.#waits.begin("open", "fit-progress", "Opening the mesh", () => this.#leave());
    try {
      await this.#session.open();
      this.#session.send({ type: "open", photo: source.id, mesh: this.mesh.value, box: this.#box.value,
        ...this.#camera.value });
    } catch (error) {
      this.#waits.end("open");
      showError(error);
    }
  }

  /** Ends the session. */
  #leave() {
    this.#session.close();
    this.#ready = false;
    this.#waits.endAll();
    this.#searching(false);
    this.#curve.clear();
    element("fit-room", HTMLElement).hidden = true;
    this.#result.hide();
  }

  #lost() {
    this.#leave();
    showError(new ServerError(0, "The connection to the server has ended. Press “Show the mesh” to open it again."));
  }

  /** @param {any} message */
  #received(message) {
    switch (message.type) {
      case "ready": return void this.#opened(message);
      case "view": return void this.#view(message);
      case "curve":
        this.#curve.show(message.chart);
        if (message.done) this.#waits.end("curve");
        return;
      case "progress": return this.#waits.get("fit")?.say(`Searching for the pose: ${message.what}`, message.done, message.total);
      case "step": return this.#step(message);
      case "fitted": return this.#finish(message);
      case "stopped":
        this.#waits.end("curve");
        if (this.#waits.get("fit")) element("fit-said", HTMLElement).textContent = "Stopped.";
        return this.#searching(false);
      case "error":
        showError(new ServerError(422, message.error));
        if (this.#waits.get("open")) return this.#leave();
        this.#waits.endAll();
        return this.#searching(false);
    }
  }

  /** @param {{crop: {side: number}, photo_glyphs: import("./types.js").Glyphs, image: string}} message */
  async #opened(message) {
    this.#waits.end("open");
    this.#ready = true;
    this.#curve.clear();
    const room = element("fit-room", HTMLElement);
    if (room.hidden) {
      room.hidden = false;
      this.#intoSight();
    }
    this.#result.hide();
    this.#photoGlyphs.src = addressOf(message.photo_glyphs.image);
    await this.#scene.setCrop(message.image, message.crop.side);
    this.#turn(this.#controls.value, this.app.address.get("pose") === null);
  }

  #intoSight() {
    bringIntoSight(this.#start.closest(".bar") ?? this.#start, this.#scene.canvas);
  }

  /**
   * @param {Pose} pose
   * @param {boolean} [place]
   */
  #turn(pose, place = false) {
    this.#controls.write(pose);
    this.#remember();
    if (!this.#ready) return;
    if (this.#waits.get("curve") && !this.#curve.fits(pose)) this.#session.send({ type: "stop" });
    cancelAnimationFrame(this.#frame);
    this.#frame = requestAnimationFrame(() => this.#send(pose, place || this.#placing > this.#drawn));
  }

  /**
   * @param {Pose} pose
   * @param {boolean} place
   */
  #send(pose, place) {
    this.#n++;
    if (place) this.#placing = this.#n;
    if (!this.#waits.get("view")) this.#waits.begin("view", "curve-progress", "Rendering", () => this.#waits.end("view"));
    this.#session.send({ type: "pose", n: this.#n, pose, place, width: this.#curve.width });
  }

  /**
   * @param {{n: number, pose: Pose, similarity: number, derivative: number[], image: string,
   *   glyphs: import("./types.js").Glyphs, chart: import("./types.js").SimilarityChart, milliseconds: number}} message
   */
  async #view(message) {
    if (message.n < this.#drawn) return;
    this.#drawn = message.n;
    if (message.n === this.#n) {
      this.#waits.end("view");
      // the server has moved the mesh
      if (message.n === this.#placing) {
        this.#controls.write(proper(message.pose));
        this.#remember();
      }
    }
    const [azimuth = 0, elevation = 0] = message.pose;
    const words = `azimuth ${figure(azimuth, 1)}, elevation ${figure(elevation, 1)}: similarity ${figure(message.similarity)}`;
    element("similarity", HTMLElement).replaceChildren(make("strong", {}, `Similarity ${figure(message.similarity, 4)}`),
      make("br"), `Derivative per degree: azimuth ${figure(message.derivative[0], 4)}, elevation ${figure(message.derivative[1], 4)}`,
      make("br"), make("small", { class: "note" }, `${figure(message.milliseconds, 0)} ms`));
    this.#renderGlyphs.src = addressOf(message.glyphs.image);
    this.#curve.show(message.chart);
    if (!this.#waits.get("fit")) {
      this.#curve.later(message.pose);
      announce(`At ${words}.`);
    }
    await this.#scene.setView(message.image, message.pose, message.derivative);
    this.#scene.canvas.setAttribute("aria-label", `The mesh on the photograph, ${words}`);
    this.#scene.canvas.dataset.n = String(message.n);
  }

  /** @param {Pose} pose */
  #askCurve(pose) {
    if (!this.#ready || this.#waits.get("fit")) return;
    this.#waits.begin("curve", "curve-progress", "Computing the curve over 360°", () => this.#session.send({ type: "stop" }));
    this.#session.send({ type: "curve", pose });
  }

  #fit() {
    if (!checked(element("fit-room", HTMLElement))) return;
    clearError();
    this.#intoSight();
    this.#waits.end("curve");
    this.#waits.begin("fit", "search-progress", "Searching for the pose", () => this.#session.send({ type: "stop" }));
    this.#searching(true);
    this.#result.hide();
    element("fit-said", HTMLElement).textContent = "";
    const here = element("fit-from-here", HTMLInputElement).checked;
    this.#session.send({ type: "fit", ...this.#options.value, initial: here ? this.#controls.value.slice(0, 2) : null });
  }

  /** @param {boolean} now */
  #searching(now) {
    if (!now) this.#waits.end("fit");
    enable(this.#start, !now);
    enable(this.#stop, now);
  }

  /** @param {{pose: Pose, similarity: number}} message */
  #step(message) {
    this.#waits.get("fit")?.say(`Searching for the pose: similarity ${figure(message.similarity)}`);
    const now = performance.now();
    if (this.#waits.get("view") || now - this.#lastStep < (prefersReducedMotion() ? 500 : 50)) return;
    this.#lastStep = now;
    this.#controls.write(proper(message.pose));
    this.#send(message.pose, false);
  }

  /** @param {any} message */
  #finish(message) {
    this.#searching(false);
    this.#turn(proper(message.pose));
    this.#result.show(message);
  }
}
