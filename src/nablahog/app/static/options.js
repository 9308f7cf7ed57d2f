/** The presets and options that the page offers, from what the server says about them; the address keeps them. */

import { controlOf } from "./controls.js";
import { element, fill, make } from "./dom.js";

/** @typedef {import("./types.js").Parameter} Parameter */
/** @typedef {import("./controls.js").Control} Control */

/** A preset and its parameters, which the address keeps under `preset` and their own names. */
export class Dialects {
  /** @type {Map<string, Control>} */
  #controls = new Map();
  #select = element("preset", HTMLSelectElement);
  #place = element("controls", HTMLElement);

  /**
   * @param {import("./types.js").About} about
   * @param {import("./address.js").Address} address
   * @param {() => void} changed
   */
  constructor(about, address, changed) {
    this.about = about;
    this.address = address;
    this.changed = changed;
    fill(this.#select, about.presets.map((preset) => preset.name));
    this.#select.addEventListener("change", () => {
      this.#forget();
      this.#build();
      this.#remember();
      this.changed();
    });
    this.restore();
  }

  get preset() {
    const found = this.about.presets.find((preset) => preset.name === this.#select.value) ?? this.about.presets[0];
    if (!found) throw new Error("the server has no presets");
    return found;
  }

  /** @returns {import("./types.js").Dialect} */
  get value() {
    /** @type {import("./types.js").Settings} */
    const settings = {};
    for (const parameter of this.preset.parameters) {
      const text = this.#controls.get(parameter.name)?.read();
      if (text !== undefined && text !== null && text !== parameter.default) settings[parameter.name] = text;
    }
    return { preset: this.preset.name, settings };
  }

  /** Takes preset and parameters from the address. */
  restore() {
    const names = this.about.presets.map((preset) => preset.name);
    const wanted = [this.address.get("preset"), this.about.default_preset].find((name) => name && names.includes(name));
    this.#select.value = wanted ?? names[0] ?? "";
    this.#build();
    for (const [parameter, control] of this.#controls) {
      const text = this.address.get(parameter);
      if (text !== null) control.write(text);
    }
  }

  #build() {
    element("preset-about", HTMLElement).textContent = this.preset.title.replaceAll("``", "");
    this.#controls = new Map(this.preset.parameters.map((parameter) =>
      [parameter.name, controlOf(parameter, this.preset.name, `controls-${parameter.name}`)]));
    for (const control of this.#controls.values()) {
      control.nodes.addEventListener("input", () => {
        if (control.read() === null) return;
        this.#remember();
        this.changed();
      });
    }
    this.#place.replaceChildren(...[...this.#controls.values()].map((control) => control.nodes));
    if (!this.#controls.size) this.#place.append(make("p", { class: "note" }, "This preset has no parameters."));
  }

  /** Removes the parameters of all presets. */
  #forget() {
    const names = this.about.presets.flatMap((preset) => preset.parameters.map((each) => each.name));
    this.address.set(Object.fromEntries(names.map((name) => [name, null])));
  }

  #remember() {
    const { preset, settings } = this.value;
    this.#forget();
    this.address.set({ preset, ...settings });
  }
}

/** What the address calls options, where it is not their name. */
const KEYS = new Map([["invert-size", "invert_size"], ["fit-method", "pose_method"]]);

/** The options of a view, in its element `VIEW-options`; the address keeps them. */
export class Options {
  /** @type {Map<Parameter, Control>} */
  #controls = new Map();
  /** @type {string[]} names of the options that are disabled */
  #disabled = [];

  /**
   * @param {string} view
   * @param {import("./types.js").About} about
   * @param {import("./address.js").Address} address
   * @param {() => void} [changed]
   */
  constructor(view, about, address, changed = () => {}) {
    this.view = view;
    this.address = address;
    this.place = element(`${view}-options`, HTMLElement);
    for (const option of about.options[view] ?? []) {
      const control = controlOf(option, "", `${view}-${option.name}`);
      control.nodes.className = "inline";
      if (option.name === "size") control.nodes.dataset.photoOnly = "";
      control.nodes.addEventListener("input", () => {
        if (control.read() === null) return;
        this.#remember(option, control);
        changed();
      });
      this.#controls.set(option, control);
      this.place.append(control.nodes);
    }
    this.restore();
  }

  /** The values as a request has them; an entry that is not valid, or disabled, counts as the default. */
  get value() {
    /** @type {{[name: string]: string | number | boolean | null}} */
    const values = {};
    for (const [option, control] of this.#controls) {
      const text = this.#disabled.includes(option.name) ? null : control.read();
      values[option.name] = valueOf(option, text ?? option.default);
    }
    return values;
  }

  /** @param {string[]} names of the options to disable; the others are enabled */
  disable(names) {
    this.#disabled = names;
    for (const [option, control] of this.#controls) {
      for (const each of control.nodes.querySelectorAll("input, select")) {
        each.toggleAttribute("disabled", names.includes(option.name));
      }
    }
  }

  /** Takes the options from the address. */
  restore() {
    for (const [option, control] of this.#controls) {
      control.write(option.default);
      const text = this.address.get(this.#key(option));
      if (text !== null) control.write(text);
    }
  }

  /**
   * @param {string} name
   * @param {string} text
   */
  set(name, text) {
    for (const [option, control] of this.#controls) {
      if (option.name !== name) continue;
      control.write(text);
      this.#remember(option, control);
    }
  }

  /**
   * @param {Parameter} option
   * @param {Control} control
   */
  #remember(option, control) {
    this.address.set({ [this.#key(option)]: control.read() });
  }

  /** @param {Parameter} option */
  #key(option) {
    return KEYS.get(`${this.view}-${option.name}`) ?? option.name;
  }
}

/**
 * @param {Parameter} option
 * @param {string} text
 */
function valueOf(option, text) {
  if (option.optional && text === "none") return null;
  if (option.kind === "boolean") return text === "true";
  return option.kind === "integer" || option.kind === "number" ? Number(text) : text;
}
