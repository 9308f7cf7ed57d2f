/** Controls of parameters and options: numbers, pairs, choices and checkboxes. */

import { fill, make, numberOf } from "./dom.js";

/** @typedef {import("./types.js").Parameter} Parameter */

/**
 * A control of one parameter.
 *
 * @typedef {{nodes: HTMLElement, read: () => string | null, write: (text: string) => void}} Control
 * read: null if the entry is not valid
 */

/**
 * @param {Parameter} parameter
 * @param {string} preset
 * @param {string} id
 * @returns {Control}
 */
export function controlOf(parameter, preset, id) {
  const control = { integer: numeric, number: numeric, boolean: ticked, choice: chosen, pair: paired }[parameter.kind](
    parameter, id, preset);
  control.write(parameter.default);
  return control;
}

/**
 * @param {Parameter} parameter
 * @param {string} id
 */
function labelled(parameter, id) {
  return make("label", { for: id, title: parameter.help || null }, parameter.label);
}

/**
 * @param {Parameter} parameter
 * @param {string} id
 * @returns {Control}
 */
function numeric(parameter, id) {
  const { least, most, optional, slider: slides } = parameter;
  const step = parameter.kind === "integer" ? 1 : "any";
  const input = make("input", { type: "number", id, name: parameter.name, min: least, max: most, step,
    required: !optional, placeholder: optional ? "none" : null });
  const nodes = make("div", { class: "field" }, labelled(parameter, id), input);
  /** @type {HTMLInputElement | null} */
  let slider = null;
  if (slides && least !== null && most !== null && !optional) {
    const fine = parameter.kind === "integer" ? 1 : (most - least) / 200;
    slider = make("input", { type: "range", "aria-label": `${parameter.name}, slider`, min: least, max: most, step: fine });
    slider.addEventListener("input", () => { input.value = slider?.value ?? ""; });
    input.addEventListener("input", () => { if (slider) slider.value = input.value; });
    nodes.append(slider);
  }
  return {
    nodes,
    read: () => optional && input.value === "" && !input.validity.badInput ? "none"
      : numberOf(input) === null ? null : sameNumber(input.value, parameter.default),
    write: (text) => {
      input.value = text === "none" ? "" : text;
      if (slider) slider.value = text;
    },
  };
}

/**
 * "1" for a default of "1.0" is the default.
 *
 * @param {string} text
 * @param {string} other
 */
const sameNumber = (text, other) => other !== "" && Number(text) === Number(other) ? other : text;

/**
 * @param {Parameter} parameter
 * @param {string} id
 * @returns {Control}
 */
function ticked(parameter, id) {
  const input = make("input", { type: "checkbox", id, name: parameter.name });
  return {
    nodes: make("div", { class: "field" }, labelled(parameter, id), input),
    read: () => String(input.checked),
    write: (text) => { input.checked = text === "true"; },
  };
}

/**
 * @param {Parameter} parameter
 * @param {string} id
 * @returns {Control}
 */
function chosen(parameter, id) {
  const select = make("select", { id, name: parameter.name });
  fill(select, [...parameter.choices ?? [], ...parameter.optional && !parameter.choices?.includes("none") ? ["none"] : []]);
  return {
    nodes: make("div", { class: "field" }, labelled(parameter, id), select),
    read: () => select.value || null,
    write: (text) => { if ([...select.options].some((option) => option.value === text)) select.value = text; },
  };
}

/**
 * @param {Parameter} parameter
 * @param {string} id
 * @param {string} preset
 * @returns {Control}
 */
function paired(parameter, id, preset) {
  // OpenCV's own order
  const sides = preset === "opencv" ? ["width", "height"] : ["height", "width"];
  const inputs = sides.map((side, i) => make("input", { type: "number", id: i ? `${id}-2` : id, required: true, step: 1,
    name: i ? `${parameter.name}-2` : parameter.name, min: parameter.least, max: parameter.most,
    "aria-label": `${parameter.name}, ${side}` }));
  const [first, second] = inputs;
  return {
    nodes: make("div", { class: "field", role: "group", "aria-label": parameter.name },
      make("span", { class: "name" }, parameter.name, make("br"), make("small", { class: "note" }, sides.join(" × "))),
      ...inputs),
    read: () => {
      const values = inputs.map(numberOf);
      if (values.includes(null)) return null;
      // a default may be one number for both sides
      return values[0] === values[1] && parameter.default === String(values[0]) ? parameter.default : values.join("x");
    },
    write: (text) => {
      const [a = "", b = a] = text.split(/[x,]/);
      if (first) first.value = a;
      if (second) second.value = b;
    },
  };
}
