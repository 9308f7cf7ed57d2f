/** A form that asks about an array what its file does not say. */

import { clear, element, fill, make } from "./dom.js";

/** @typedef {{as: string, preset: string, settings: string, image_size: string, key: string}} Answers */

/**
 * @param {string} sentence what the server said
 * @param {import("./types.js").Question} question
 * @param {Answers} before what was answered already
 * @param {import("./types.js").About} about
 * @param {(answers: Answers) => void} send the form stays until a file is opened: an answer may be refused
 */
export function ask(sentence, question, before, about, send) {
  const form = element("question", HTMLFormElement);
  const answers = { ...before };
  const cancel = make("button", { type: "button" }, "Cancel");
  form.replaceChildren(make("h3", { id: "question-title" }, "What is in this file?"), make("p", {}, explain(sentence, question)));

  /** @type {(() => void)[]} */
  const reads = [];
  reads.push(choice(form, "as", "It is",
    [{ id: "descriptor", name: "a descriptor" }, { id: "template", name: "the weights of a detector" }],
    before.as || (question.weights ? "template" : "descriptor"), answers));
  if (question.keys) reads.push(choice(form, "key", "Array", question.keys, before.key, answers));
  const fits = question.fitting.map((each) => ({ id: JSON.stringify(each), name: nameOf(each) }));
  const unknown = { id: "", name: "unknown" };
  reads.push(choice(form, "preset", "Preset", [...fits, ...fits.length ? [] : [unknown], ...about.presets.map(({ name }) => name)],
    fits[0]?.id ?? before.preset, answers));
  const size = entry(form, "image_size", "Size of its image, height x width (if needed)", fits.length ? "" : before.image_size,
    { pattern: "\\d+\\s*[x×,]\\s*\\d+", placeholder: "128x64", title: "height x width in pixels, such as 128x64" });
  const settings = fits.length ? [] : Object.entries(JSON.parse(before.settings || "{}"));
  const parameters = entry(form, "settings", "Parameters, unless they are the usual ones", settings.map((each) => each.join("=")).join(" "),
    { pattern: "\\s*(\\w+=\\S+(\\s+|$))*", placeholder: "cell_size=8", title: "NAME=VALUE, with spaces between several" });
  reads.push(() => {
    /** @type {import("./types.js").FittingPreset} */
    const fit = answers.preset.startsWith("{") ? JSON.parse(answers.preset) : { preset: answers.preset, settings: {}, image_size: null };
    answers.preset = fit.preset;
    answers.image_size = size.value.replaceAll(/\s/g, "").replace(/[×,]/, "x") || (fit.image_size ?? []).join("x");
    const entered = parameters.value.split(/\s+/).filter(Boolean).map((word) => word.split("="));
    answers.settings = JSON.stringify({ ...fit.settings, ...Object.fromEntries(entered) });
  });
  form.append(make("div", { class: "bar" }, make("button", { class: "main", type: "submit" }, "Send"), cancel));
  form.onsubmit = (event) => {
    event.preventDefault();
    for (const read of reads) read();
    send(answers);
  };
  cancel.addEventListener("click", close);
  form.hidden = false;
  element("choose", HTMLDetailsElement).open = true;
  const first = form.querySelector("select, input");
  if (first instanceof HTMLElement) first.focus({ preventScroll: true });
  form.scrollIntoView({ block: "nearest" });
}

/**
 * @param {string} sentence
 * @param {import("./types.js").Question} question
 */
function explain(sentence, { keys, weights, fitting }) {
  if (keys) return "It holds several arrays: choose one.";
  const seems = weights ? " It seems to hold the weights of a detector." : "";
  return `${sentence}.${seems} ` + (fitting.length ? "Presets that fit its shape come first, the likeliest on top."
    : "Enter what you know, or save it by nablahog.save_descriptor, which keeps everything, and open that file.");
}

/** @param {import("./types.js").FittingPreset} fit */
function nameOf({ preset, settings, image_size: size }) {
  const words = [preset, ...Object.entries(settings).map(([name, value]) => `${name} ${value}`)];
  return `${[...words, ...size ? [`of ${size.join("x")} pixels`] : []].join(" ")} (fits)`;
}

/** Takes the form away. */
export function close() {
  const form = element("question", HTMLFormElement);
  clear(form, element("file", HTMLInputElement));
  form.hidden = true;
}

/**
 * @param {string} id
 * @param {string} label
 * @param {HTMLElement} control
 */
const field = (id, label, control) => make("div", { class: "field" }, make("label", { for: id }, label), control);

/**
 * @param {HTMLFormElement} form
 * @param {keyof Answers} name
 * @param {string} label
 * @param {string} value
 * @param {{[name: string]: string}} attributes
 */
function entry(form, name, label, value, attributes) {
  const input = make("input", { type: "text", id: `question-${name}`, name, value, autocomplete: "off", spellcheck: "false", ...attributes });
  form.append(field(input.id, label, input));
  return input;
}

/**
 * @param {HTMLFormElement} form
 * @param {keyof Answers} name
 * @param {string} label
 * @param {(string | {id: string, name: string})[]} choices
 * @param {string} value
 * @param {Answers} answers
 */
function choice(form, name, label, choices, value, answers) {
  const select = make("select", { id: `question-${name}`, name });
  fill(select, choices, value);
  form.append(field(select.id, label, select));
  return () => { answers[name] = select.value; };
}
