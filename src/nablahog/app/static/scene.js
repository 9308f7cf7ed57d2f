/** The crop of the photograph with the rendering over it, turned by pointer, wheel and keys. */

import { element } from "./dom.js";
import { pictureOf, pngOf } from "./files.js";
import { proper } from "./pose.js";

/** @typedef {import("./types.js").Pose} Pose */

const DEGREES_PER_PIXEL = 0.5;
const DEGREES_PER_KEY = 2;
/** Slope of the similarity per degree at which the arrow has half its length. */
const HALF = 0.1;

export class Scene {
  canvas = element("scene", HTMLCanvasElement);
  #opacity = element("opacity", HTMLInputElement);
  /** @type {ImageBitmap | null} */
  #crop = null;
  /** @type {ImageBitmap | null} */
  #rendering = null;
  #side = 128;
  /** @type {Pose} */
  #pose = [];
  /** @type {number[]} */
  #derivative = [];
  /** @type {Map<number, [number, number]>} */
  #fingers = new Map();

  /**
   * @param {() => Pose} pose
   * @param {(pose: Pose) => void} turn
   */
  constructor(pose, turn) {
    this.pose = pose;
    this.turn = (/** @type {Pose} */ next) => turn(proper(next));
    this.#opacity.addEventListener("input", () => this.draw());
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.#fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    this.canvas.addEventListener("pointermove", (event) => this.#drag(event));
    for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) {
      this.canvas.addEventListener(name, (event) => this.#fingers.delete(event.pointerId));
    }
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#change({ 2: this.#at(2) * Math.exp(0.001 * event.deltaY * (event.deltaMode === 1 ? 30 : 1)) });
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  /** @param {number} i */
  #at(i) {
    return this.pose()[i] ?? 0;
  }

  /** @param {{[i: number]: number}} values */
  #change(values) {
    this.turn(this.pose().map((old, i) => values[i] ?? old));
  }

  /** @param {PointerEvent} event */
  #drag(event) {
    const before = this.#fingers.get(event.pointerId);
    if (!before) return;
    const spread = this.#spread();
    this.#fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.#fingers.size > 1) {
      const now = this.#spread();
      if (spread > 1 && now > 1) this.#change({ 2: this.#at(2) * spread / now });
      return;
    }
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    if (event.shiftKey) this.#change({ 3: this.#at(3) + this.#swing(before, [event.clientX, event.clientY]) });
    // what is near follows the pointer
    else this.#change({ 0: this.#at(0) - DEGREES_PER_PIXEL * dx, 1: this.#at(1) + DEGREES_PER_PIXEL * dy });
  }

  /** The distance between two fingers. */
  #spread() {
    const [a, b] = [...this.#fingers.values()];
    return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
  }

  /**
   * Degrees, counter-clockwise, by which a pointer goes around the object.
   *
   * @param {[number, number]} a
   * @param {[number, number]} b
   */
  #swing(a, b) {
    const box = this.canvas.getBoundingClientRect();
    const x = box.left + (0.5 + this.#at(4) / this.#side) * box.width, y = box.top + (0.5 + this.#at(5) / this.#side) * box.height;
    const angle = (/** @type {[number, number]} */ point) => Math.atan2(y - point[1], point[0] - x) * 180 / Math.PI;
    const swing = angle(b) - angle(a);
    return swing - 360 * Math.round(swing / 360);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const [azimuth, elevation, distance, theta] = [0, 1, 2, 3].map((i) => this.#at(i));
    if (azimuth === undefined || elevation === undefined || distance === undefined || theta === undefined) return;
    /** @type {{[key: string]: {[i: number]: number}}} */
    const keys = event.shiftKey
      ? { ArrowLeft: { 3: theta + DEGREES_PER_KEY }, ArrowRight: { 3: theta - DEGREES_PER_KEY } }
      : { ArrowLeft: { 0: azimuth + DEGREES_PER_KEY }, ArrowRight: { 0: azimuth - DEGREES_PER_KEY },
        ArrowUp: { 1: elevation - DEGREES_PER_KEY }, ArrowDown: { 1: elevation + DEGREES_PER_KEY } };
    const change = { "+": { 2: distance / 1.03 }, "=": { 2: distance / 1.03 }, "-": { 2: distance * 1.03 } }[event.key] ?? keys[event.key];
    if (!change) return;
    event.preventDefault();
    this.#change(change);
  }

  /**
   * @param {string} base64
   * @param {number} side pixels of the crop
   */
  async setCrop(base64, side) {
    this.#crop = await pictureOf(pngOf(base64));
    this.#rendering = null;
    this.#side = side;
    this.draw();
  }

  /**
   * @param {string} base64
   * @param {Pose} pose
   * @param {number[]} derivative
   */
  async setView(base64, pose, derivative) {
    this.#rendering = await pictureOf(pngOf(base64));
    this.#pose = pose;
    this.#derivative = derivative;
    this.draw();
  }

  draw() {
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const { width, height } = this.canvas;
    context.clearRect(0, 0, width, height);
    if (this.#crop) context.drawImage(this.#crop, 0, 0, width, height);
    if (!this.#rendering) return;
    context.globalAlpha = Number(this.#opacity.value) / 100;
    context.drawImage(this.#rendering, 0, 0, width, height);
    context.globalAlpha = 1;
    this.#arrow(context);
  }

  /** @param {CanvasRenderingContext2D} context */
  #arrow(context) {
    const [azimuth = 0, elevation = 0] = this.#derivative;
    const size = Math.hypot(azimuth, elevation);
    if (!(size > 0)) return;
    const scale = this.canvas.width / this.#side;
    const x = (this.#side / 2 + (this.#pose[4] ?? 0)) * scale, y = (this.#side / 2 + (this.#pose[5] ?? 0)) * scale;
    const length = 0.4 * this.canvas.width * size / (size + HALF);
    // where to drag the pointer: to the left the azimuth grows, downwards the elevation
    const [dx, dy] = [-azimuth / size, elevation / size];
    const head = Math.min(18, length / 2);
    const [ex, ey] = [x + length * dx, y + length * dy];
    const path = new Path2D();
    path.moveTo(x, y);
    path.lineTo(ex, ey);
    path.moveTo(ex - head * (dx - 0.6 * dy), ey - head * (dy + 0.6 * dx));
    path.lineTo(ex, ey);
    path.lineTo(ex - head * (dx + 0.6 * dy), ey - head * (dy - 0.6 * dx));
    context.lineCap = context.lineJoin = "round";
    for (const [style, wide] of /** @type {[string, number][]} */ ([["#000", 8], ["#ffd23f", 4]])) {
      context.strokeStyle = style;
      context.lineWidth = wide;
      context.stroke(path);
    }
  }
}
