/** A form that asks about an array what its file does not say. */

import { clear, element, fill, make } from "./dom.js";

/** @typedef {{as: string, preset: string, settings: string, image_size: string, key: string}} Answers */

/**
 * @param {string} sentence what the server said
 * @param {import("./types.js").Question} question
 * @param {Answers} before what was answered already
 * @param {import("./types.js").About} about
 * @param {(answers: Answers) => void} send
 */
export function ask(sentence, question, before, about, send) {
  const form = element("question", HTMLFormElement);
  const answers = { ...before };
  const cancel = make("button", { type: "button" }, "Cancel");
  form.replaceChildren(make("h3", { id: "question-title" }, "What is in this file?"), make("p", {}, why(sentence, question, before)));

  /** @type {(() => void)[]} */
  const reads = [];
  reads.push(choice(form, "as", "It is",
    [{ id: "descriptor", name: "a descriptor" }, { id: "template", name: "the weights of a detector" }], answers));
  if (question.keys) reads.push(choice(form, "key", "Array", question.keys, answers));
  const fits = question.fitting.map((each) => ({ id: Object.keys(each.settings).length ? JSON.stringify(each) : each.preset,
    name: [each.preset, ...Object.entries(each.settings).map(([name, value]) => `${name} ${value}`), "(fits)"].join(" ") }));
  const others = about.presets.map((each) => each.name).filter((name) => !fits.some((each) => each.id === name));
  reads.push(choice(form, "preset", "Preset", [...fits, ...others], answers, fits[0]?.id ?? about.default_preset));
  const input = make("input", { type: "text", id: "question-image_size", name: "image_size",
    pattern: "\\d+\\s*[x×,]\\s*\\d+", placeholder: "128x64", title: "height x width in pixels, such as 128x64", value: answers.image_size, autocomplete: "off" });
  form.append(field("question-image_size", "Size of its image, height x width (if needed)", input));
  reads.push(() => {
    answers.image_size = input.value.replaceAll(/\s/g, "").replace(/[×,]/, "x");
    answers.settings = "{}";
    if (!answers.preset.startsWith("{")) return;
    /** @type {import("./types.js").FittingPreset} */
    const { preset, settings, image_size } = JSON.parse(answers.preset);
    answers.preset = preset;
    answers.settings = JSON.stringify(settings);
    answers.image_size ||= (image_size ?? []).join("x");
  });
  form.append(make("div", { class: "bar" }, make("button", { class: "main", type: "submit" }, "Send"), cancel));
  form.onsubmit = (event) => {
    event.preventDefault();
    for (const read of reads) read();
    close();
    send(answers);
  };
  cancel.addEventListener("click", close);
  form.hidden = false;
  element("choose", HTMLDetailsElement).open = true;
  const first = form.querySelector("select, input");
  if (first instanceof HTMLElement) first.focus();
}

/**
 * @param {string} sentence
 * @param {import("./types.js").Question} question
 * @param {Answers} before
 */
function why(sentence, { keys, shape, fitting }, before) {
  if (keys) return "It holds several arrays: choose one.";
  const first = before.preset ? `${sentence}.` : "It does not say which library made it.";
  return fitting.length ? `${first} Presets whose descriptors have this shape come first, the likeliest on top.`
    : `${first} With default parameters, no preset makes an array of ${shape?.join(" × ")} numbers: enter the size of its ` +
      "image, or save it by nablahog.save_descriptor, which keeps all parameters, and open that file.";
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
 * @param {(string | {id: string, name: string})[]} choices
 * @param {Answers} answers
 * @param {string} [first]
 */
function choice(form, name, label, choices, answers, first) {
  const select = make("select", { id: `question-${name}`, name });
  fill(select, choices, answers[name] || first);
  form.append(field(select.id, label, select));
  return () => { answers[name] = select.value; };
}
