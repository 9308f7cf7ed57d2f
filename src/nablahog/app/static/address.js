/** The state of the page in the part of its address after "#": `#/VIEW?key=value&…`. */

/** @typedef {"see" | "invert" | "fit"} View */

const VIEWS = /** @type {const} */ (["see", "invert", "fit"]);

/** Browsers refuse to change the address very often. */
const PAUSE = 200;

export class Address extends EventTarget {
  /** @type {View} */
  view = "see";
  #values = new URLSearchParams();
  #timer = 0;

  constructor() {
    super();
    this.#read();
    addEventListener("hashchange", () => {
      const [view, values] = [this.view, this.#values.toString()];
      // a hash that is no state, such as that of the link that skips to the view, changes nothing
      if (!location.hash.startsWith("#/") && location.hash !== "") return this.#write();
      clearTimeout(this.#timer);
      this.#read();
      if (this.#values.toString() !== values) this.dispatchEvent(new Event("restore"));
      if (this.view !== view) this.dispatchEvent(new Event("view"));
      this.#links();
    });
    addEventListener("pagehide", () => this.#write());
  }

  /** @param {string} key */
  get(key) {
    return this.#values.get(key);
  }

  /**
   * @param {string} key
   * @param {number} count
   * @returns {number[] | null} numbers divided by commas
   */
  numbers(key, count) {
    const values = this.#values.get(key)?.split(",").map(Number);
    return values?.length === count && values.every(Number.isFinite) ? values : null;
  }

  /** @param {{[key: string]: string | number | null}} values null removes */
  set(values) {
    for (const [key, value] of Object.entries(values)) {
      if (value === null || value === "") this.#values.delete(key);
      else this.#values.set(key, String(value));
    }
    this.#links();
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#write(), PAUSE);
  }

  /** @param {View} view */
  go(view) {
    if (view !== this.view) location.hash = this.#text(view);
  }

  #read() {
    const [path = "", query = ""] = location.hash.replace(/^#\//, "").split("?", 2);
    this.view = VIEWS.find((view) => view === path) ?? "see";
    this.#values = new URLSearchParams(query);
  }

  /** @param {View} view */
  #text(view) {
    const query = this.#values.toString().replaceAll("%2C", ",");
    return `#/${view}${query && "?"}${query}`;
  }

  #write() {
    clearTimeout(this.#timer);
    const text = this.#text(this.view);
    if (text !== location.hash) history.replaceState(null, "", location.pathname + location.search + text);
  }

  #links() {
    for (const view of VIEWS) document.getElementById(`tab-${view}`)?.setAttribute("href", this.#text(view));
  }
}
