/** Waits: a line with progress and a button to cancel for all that takes longer than a moment, and errors. */

import { ServerError } from "./api.js";
import { clear, debounce, element, make } from "./dom.js";

const MOMENT = 300;
let running = 0;

/** Says a sentence to those who do not see the page; of several at once, the last. */
export const announce = debounce((/** @type {string} */ text) => { element("status", HTMLElement).textContent = text; }, 700);

/** @param {1 | -1} change */
function count(change) {
  running += change;
  document.body.dataset.busy = String(running > 0);
}

/** A line that appears in `place` after a moment, unless it is closed before; its first text is announced, no other. */
export class Wait {
  #line = make("div", { class: "progress" });
  #bar = make("progress", { "aria-label": "Progress" });
  #text = make("span");
  #timer;
  #open = true;

  /**
   * @param {string} place id of the element
   * @param {string} text
   * @param {() => void} cancel
   */
  constructor(place, text, cancel) {
    count(1);
    const button = make("button", { type: "button" }, "Cancel");
    button.addEventListener("click", cancel);
    this.#text.append(text);
    this.#line.append(this.#bar, this.#text, button);
    this.#timer = setTimeout(() => {
      element(place, HTMLElement).replaceChildren(this.#line);
      announce(text);
    }, MOMENT);
  }

  /**
   * @param {string} text
   * @param {number | null} [done] null: unknown; left out: as before
   * @param {number | null} [total]
   */
  say(text, done, total) {
    if (this.#text.textContent !== text) this.#text.textContent = text;
    if (done === undefined) return;
    if (done === null || !total) return this.#bar.removeAttribute("value");
    this.#bar.max = total;
    this.#bar.value = done;
  }

  close() {
    if (!this.#open) return;
    this.#open = false;
    clearTimeout(this.#timer);
    clear(this.#line);
    this.#line.remove();
    count(-1);
  }
}

/** Waits for several kinds of work, one of each. */
export class Waits {
  /** @type {Map<string, Wait>} */
  #waits = new Map();

  /** @param {string} kind */
  get(kind) {
    return this.#waits.get(kind);
  }

  /**
   * @param {string} kind
   * @param {ConstructorParameters<typeof Wait>} about
   */
  begin(kind, ...about) {
    this.end(kind);
    this.#waits.set(kind, new Wait(...about));
  }

  /** @param {string} kind */
  end(kind) {
    this.#waits.get(kind)?.close();
    this.#waits.delete(kind);
  }

  endAll() {
    for (const kind of [...this.#waits.keys()]) this.end(kind);
  }
}

/**
 * Does work that can be cancelled; errors are shown.
 *
 * @template T
 * @param {string} place
 * @param {string} text
 * @param {(signal: AbortSignal, wait: Wait) => Promise<T>} work
 * @param {AbortController} [controller]
 * @returns {Promise<T | undefined>} undefined where it was cancelled or failed
 */
export async function waiting(place, text, work, controller = new AbortController()) {
  const wait = new Wait(place, text, () => controller.abort());
  try {
    const result = await work(controller.signal, wait);
    return controller.signal.aborted ? undefined : result;
  } catch (error) {
    if (!controller.signal.aborted) showError(error);
    return undefined;
  } finally {
    wait.close();
  }
}

/** Work of which only the newest counts: older work is aborted. */
export class LatestRequest {
  /** @type {AbortController | null} */
  #controller = null;

  /** @param {string} place */
  constructor(place) {
    this.place = place;
  }

  abort() {
    this.#controller?.abort();
    this.#controller = null;
  }

  /**
   * @template T
   * @param {string} text
   * @param {(signal: AbortSignal, wait: Wait) => Promise<T>} work
   * @returns {Promise<T | undefined>}
   */
  run(text, work) {
    this.abort();
    this.#controller = new AbortController();
    return waiting(this.place, text, work, this.#controller);
  }
}

/**
 * As `debounce`; the page counts as busy until the work has begun.
 *
 * @param {(...values: any[]) => void} work
 * @param {number} milliseconds
 * @returns {(...values: any[]) => void}
 */
export function debounceBusy(work, milliseconds) {
  let timer = 0;
  return (...values) => {
    if (timer) clearTimeout(timer);
    else count(1);
    timer = setTimeout(() => {
      timer = 0;
      work(...values);
      count(-1);
    }, milliseconds);
  };
}

/** @param {unknown} error */
export function showError(error) {
  const sentence = error instanceof Error ? error.message : String(error);
  if (!(error instanceof ServerError)) console.error(error);
  const button = make("button", { type: "button" }, "Close");
  button.addEventListener("click", clearError);
  element("alert", HTMLElement).replaceChildren(
    make("span", {}, sentence), button);
}

/** Takes the error away. */
export function clearError() {
  clear(element("alert", HTMLElement));
}
