/** Two presets side by side: the glyphs of the second, the distance, and the conventions behind it. */

import { postJson, ServerError } from "./api.js";
import { Dialects } from "./controls.js";
import { element, figure, make, scrolling, table } from "./dom.js";
import { drawGlyphs, votesOf } from "./glyphs.js";
import { LatestRequest, debounceBusy } from "./progress.js";
import { Stage } from "./stage.js";

const FIRST = ["skimage", "paper", "opencv"];

export class Comparer {
  #details = element("compare", HTMLDetailsElement);
  #stage = new Stage("compare-glyphs");
  #newest = new LatestRequest("compare-progress");
  #difference = new LatestRequest("compare-difference");
  #later = debounceBusy(() => void this.#compare(), 400);

  /**
   * @param {import("./main.js").App} app
   * @param {() => number} size
   */
  constructor(app, size) {
    this.app = app;
    this.size = size;
    const names = app.about.presets.map((preset) => preset.name);
    this.dialect = new Dialects({ select: "compare-preset", place: "compare-controls", title: "compare-about", key: "with",
      prefix: "with.", first: FIRST.find((name) => names.includes(name)) ?? names[0] ?? "" },
    app.about, app.address, () => this.refresh());
    this.#details.addEventListener("toggle", () => {
      if (this.#details.open) app.address.set({ with: this.dialect.value.preset });
      else app.address.set({ with: null });
      this.refresh();
    });
  }

  restore() {
    this.dialect.restore();
    this.#details.open = this.app.address.get("with") !== null;
  }

  refresh() {
    const photo = this.app.source.value?.kind === "photo";
    this.#details.hidden = !photo;
    this.#newest.abort();
    this.#difference.abort();
    if (!this.#details.open || !photo) return;
    void this.#draw();
    this.#later();
  }

  async #draw() {
    /** @type {import("./types.js").Hog | undefined} */
    const hog = await this.#newest.run("Computes the second descriptor", (signal) =>
      postJson("/api/hog", { ...this.app.source.named, ...this.dialect.value, size: this.size() }, signal));
    if (!hog) return;
    drawGlyphs(this.#stage.canvas, votesOf(hog));
    this.#stage.fit(hog.glyph_cols * hog.cell[1], hog.glyph_rows * hog.cell[0]);
    this.#stage.canvas.dataset.key = hog.key;
    this.#stage.canvas.setAttribute("aria-label", `Glyphs of ${hog.name}: ${hog.glyph_rows} rows and ${hog.glyph_cols} columns`);
    element("compare-caption", HTMLElement).textContent = `Glyphs of ${hog.name}: descriptor ${hog.shape.join(" × ")}, ` +
      `${hog.numbers.toLocaleString("en")} numbers`;
  }

  async #compare() {
    if (!this.#details.open || this.app.source.value?.kind !== "photo") return;
    const place = element("compare-result", HTMLElement);
    /** @type {import("./types.js").Comparison | ServerError | undefined} */
    const result = await this.#difference.run("Compares the two descriptors", async (signal) => {
      try {
        return await postJson("/api/compare",
          { ...this.app.source.named, size: this.size(), a: this.app.dialect.value, b: this.dialect.value }, signal);
      } catch (error) {
        // that two cannot be compared is no failure: their glyphs are there
        if (error instanceof ServerError && error.status === 422) return error;
        throw error;
      }
    });
    if (!result) return place.replaceChildren();
    if (result instanceof ServerError) return place.replaceChildren(make("p", { role: "status" }, `No distance: ${result.message}.`));
    const names = [this.app.dialect.preset.name, this.dialect.preset.name];
    place.replaceChildren(
      make("p", { role: "status" }, make("strong", {}, `Distance ${figure(result.distance)}. `), result.said ?? (result.same ? "On this photograph the two descriptors are the same." : "")),
      result.channels ? make("p", { class: "note" },
        `Channels that both have (${result.channels.names.join(", ")}): distance ${figure(result.channels.distance)}.`) : "",
      result.conventions.length ? scrolling("Conventions", table("What differs, and its share of the distance",
        ["Convention", ...names, "Share"], result.conventions.map((each) =>
          [each.name, each.a, each.b, `${(100 * each.share).toFixed(1).replace("-", "−")}\u00a0%`]), [3])) : "",
      make("p", { class: "note" }, `Distance: ${[result.definition, result.shares].filter(Boolean).map((text) => text?.replace(/[.]?$/, ".")).join(" ")}`));
  }
}
