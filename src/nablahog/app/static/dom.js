/** Elements: to get them by id with their type, and to make them. */

/**
 * @template {Element} T
 * @param {string} id
 * @param {new () => T} kind
 * @returns {T}
 */
export function element(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`no ${kind.name} #${id}`);
  return found;
}

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {{[name: string]: string | number | boolean | null | undefined}} [attributes] true: present; false, null: absent
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  assign(made, attributes);
  made.append(...children);
  return made;
}

/**
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {{[name: string]: string | number | boolean | null | undefined}} [attributes]
 * @param {...(Node | string)} children
 * @returns {SVGElementTagNameMap[K]}
 */
export function draw(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  assign(made, attributes);
  made.append(...children);
  return made;
}

/**
 * @param {Element} made
 * @param {{[name: string]: string | number | boolean | null | undefined}} attributes
 */
function assign(made, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    made.setAttribute(name, value === true ? "" : String(value));
  }
}

/**
 * @param {HTMLSelectElement} select
 * @param {(string | {id: string, name: string})[]} choices
 * @param {string} [value]
 */
export function fill(select, choices, value) {
  select.replaceChildren(...choices.map((each) => typeof each === "string"
    ? make("option", { value: each }, each)
    : make("option", { value: each.id }, each.name)));
  if (value !== undefined) select.value = value;
}

/**
 * A table; the columns named in `numbers` are aligned to the right.
 *
 * @param {string} caption
 * @param {string[]} head
 * @param {string[][]} rows the first entry of each heads its row
 * @param {number[]} [numbers]
 * @param {{[heading: string]: string}} [about] a few words below the headings of rows
 */
export function table(caption, head, rows, numbers = [], about = {}) {
  const kind = (/** @type {number} */ column) => numbers.includes(column) ? "number" : null;
  return make("table", {},
    make("caption", {}, caption),
    make("thead", {}, make("tr", {}, ...head.map((each, i) => make("th", { scope: "col", class: kind(i) }, each)))),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((each, i) => i === 0
      ? make("th", { scope: "row", class: kind(0) }, each, ...about[each] ? [make("small", { class: "note" }, about[each])] : [])
      : make("td", { class: kind(i) }, each))))));
}

/**
 * A region that scrolls, and can be scrolled by keyboard.
 *
 * @param {string} label
 * @param {...Node} children
 */
export function scrolling(label, ...children) {
  return make("div", { class: "scroll", role: "region", tabindex: 0, "aria-label": label }, ...children);
}

/**
 * @param {number | null | undefined} value
 * @param {number} [digits] after the point
 */
export function figure(value, digits = 3) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits).replace(/^-/, "−");
}

const reduced = matchMedia("(prefers-reduced-motion: reduce)");

/** Whether the reader asked for less motion. */
export const prefersReducedMotion = () => reduced.matches;

/**
 * @param {(...values: any[]) => void} work
 * @param {number} milliseconds
 * @returns {(...values: any[]) => void} runs `work` once no call has come for that long
 */
export function debounce(work, milliseconds) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => work(...values), milliseconds);
  };
}

/**
 * Switches a button on or off; off it keeps the focus, unlike a disabled one.
 *
 * @param {HTMLButtonElement} button
 * @param {boolean} on
 */
export const enable = (button, on) => button.setAttribute("aria-disabled", String(!on));

/**
 * @param {HTMLButtonElement} button
 * @param {() => unknown} work what it does, unless it is off
 */
export const onPress = (button, work) =>
  button.addEventListener("click", () => { if (button.ariaDisabled !== "true") work(); });

/**
 * Takes elements away; a focus in them goes to the view, not to the start of the page.
 *
 * @param {Element} parent whose children go
 * @param {HTMLElement} [next]
 */
export function clear(parent, next = element("views", HTMLElement)) {
  const inside = parent.contains(document.activeElement);
  parent.replaceChildren();
  if (inside) next.focus({ preventScroll: true });
}

/** Pixels that a line of progress may need. */
const SPARE = 90;

/**
 * Scrolls until two elements are in sight together, unless they are.
 *
 * @param {Element} upper
 * @param {Element} lower
 */
export function bringIntoSight(upper, lower) {
  const { top } = upper.getBoundingClientRect();
  if (top < 0 || lower.getBoundingClientRect().bottom + SPARE > innerHeight) scrollBy({ top: top - 8, behavior: "instant" });
}

/**
 * Whether all controls in these elements have values that they allow; the first one that does not says so.
 *
 * @param {...Element} places
 */
export function checked(...places) {
  const controls = places.flatMap((place) => [...place.querySelectorAll("input")]);
  const wrong = controls.find((control) => !control.closest("[hidden]") && !control.checkValidity());
  const details = wrong?.closest("details");
  if (details) details.open = true;
  return wrong?.reportValidity() ?? true;
}

/**
 * A number input's value, or null where it is not one that the input allows.
 *
 * @param {HTMLInputElement} input
 */
export function numberOf(input) {
  return input.value !== "" && input.checkValidity() ? input.valueAsNumber : null;
}
