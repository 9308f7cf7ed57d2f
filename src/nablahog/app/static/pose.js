/** A pose: six numbers with sliders. */

import { element, figure, make, numberOf, table } from "./dom.js";

/** @typedef {import("./types.js").Pose} Pose */

const NAMES = ["azimuth", "elevation", "distance", "theta", "x", "y"];

const RANGES = [[0, 360, 0.5], [-90, 90, 0.5], [1, 10, 0.01], [-180, 180, 0.5], [-64, 64, 0.25], [-64, 64, 0.25]];
const UNITS = ["degrees", "degrees", "diagonals", "degrees", "pixels of the crop, to the right", "pixels of the crop, down"];

const FILE_UNITS = "position in the units of the mesh's file";
const ABOUT = { azimuth: "degrees", elevation: "degrees", theta: "degrees", distance: "diagonals of the model",
  x: "pixels of the photograph, from its middle to the right", y: "pixels of the photograph, from its middle down",
  [FILE_UNITS]: "x, y, z: right, down and forward from the camera",
  similarity: "of smaller cells than the one beside the sliders" };

/** @param {number} angle */
export const round360 = (angle) => ((angle % 360) + 360) % 360;

/**
 * Within the ranges, angles wrapped.
 *
 * @param {Pose} pose
 * @returns {Pose}
 */
export function proper(pose) {
  const [azimuth = 0, elevation = 0, distance = 1, theta = 0, x = 0, y = 0] = pose;
  return [round360(azimuth), Math.min(90, Math.max(-90, elevation)), Math.min(100, Math.max(1, distance)),
    round360(theta + 180) - 180, x, y];
}

/**
 * A pose that was found: its figures, how sure it is, and the best poses from other sides.
 *
 * @param {{[name: string]: any}} result
 */
export function poseTables(result) {
  const { confidence, half_turn: halfTurn, runners_up: others, focal_length_from: from } = result;
  const deviations = result.standard_deviations ?? {};
  /** @param {string} name @param {number} digits */
  const measured = (name, digits) =>
    figure(result[name], digits) + (deviations[name] == null ? "" : ` ± ${figure(deviations[name], digits)}`);
  const azimuths = [measured("azimuth", 1), ...result.equivalent_azimuths.map((/** @type {number} */ each) => figure(each, 1))];
  const focal = from === "assumed" ? "assumed" : `${figure(result.focal_length, 1)} pixels`;
  const position = result.position.map((/** @type {number} */ value) => figure(value, 3)).join(", ");
  /** @type {HTMLElement[]} */
  const nodes = [table("The pose in the photograph", ["Figure", "Value"], [
    ["azimuth", result.any_azimuth ? "any" : azimuths.join(" or ")],
    ...NAMES.slice(1).map((name) => [name, measured(name, name === "distance" ? 3 : 1)]),
    ...from === "assumed" ? [] : [[FILE_UNITS, position]], ["focal length", focal],
    ["similarity", figure(result.similarity, 4)], ...confidence === null ? [] : [["confidence", figure(confidence, 2)]]], [1], ABOUT)];
  const same = result.any_azimuth ? "The mesh looks the same from all sides: no photograph tells its azimuth. " : "";
  nodes.push(make("p", { class: "note" }, `${same}${confidence === null
    ? "This method does not say how sure it is; “best” does."
    : `Confidence ${figure(confidence, 2)}: of earlier poses with this confidence, about ${Math.min(99, Math.round(100 * confidence))} % were right, `
      + "the whole rotation within 15° of the true one, or of one from which the mesh looks the same; "
      + "rarely, it is high although the photograph does not show the object; then no pose is right. "
      + `That it is seen from the opposite side: ${figure(halfTurn, 2)}. `
      + "If the pose is right, the true value is within ± (one standard deviation) in 68 of 100."}`));
  if (others.length) {
    nodes.push(table("Runners-up: the best poses from other sides, their share of the best similarity, and the probability that they are right",
      ["Azimuth", "Elevation", "Share", "Confidence"], others.map((/** @type {any} */ each) =>
        [each.azimuth, each.elevation, each.share, each.confidence].map((value, i) => figure(value, i < 2 ? 1 : 2))), [0, 1, 2, 3]));
  }
  return nodes;
}

export class PoseControls {
  /** @type {{input: HTMLInputElement, slider: HTMLInputElement}[]} */
  #fields = [];

  /** @param {(pose: Pose, which: number) => void} changed */
  constructor(changed) {
    /** @type {Pose} */
    this.value = [0, 0, 2, 0, 0, 0];
    const nodes = NAMES.map((name, i) => {
      const [least, most, step] = RANGES[i] ?? [];
      const input = make("input", { type: "number", id: `pose-${name}`, name, step: "any", required: true });
      const slider = make("input", { type: "range", id: `pose-${name}-slider`, min: least, max: most, step,
        "aria-label": `${name}, slider` });
      for (const each of [input, slider]) {
        each.addEventListener("input", () => {
          const value = numberOf(each);
          if (value === null) return;
          (each === input ? slider : input).value = String(value);
          changed(this.value.map((old, j) => j === i ? value : old), i);
        });
      }
      this.#fields.push({ input, slider });
      return make("div", { class: "field" }, make("label", { for: input.id }, name, " ",
        make("small", { class: "note" }, UNITS[i] ?? "")), input, slider);
    });
    element("pose", HTMLElement).append(...nodes);
  }

  /** @param {Pose} pose */
  write(pose) {
    this.value = pose;
    pose.forEach((value, i) => {
      const field = this.#fields[i];
      if (!field) return;
      // what is being typed stays as it is
      if (document.activeElement !== field.input || Math.abs(field.input.valueAsNumber - value) > 1e-3) {
        field.input.value = String(Math.round(value * 100) / 100);
      }
      field.slider.value = String(value);
    });
  }
}
