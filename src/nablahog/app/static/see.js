/** The view “See”: the photograph, its glyphs, and each cell. */

import { getBlob, getJson, postJson } from "./api.js";
import { showCell } from "./cell.js";
import { element } from "./dom.js";
import { paint, pictureOf, pngOf, save, stem } from "./files.js";
import { Options } from "./options.js";
import { announce, clearError, LatestRequest, debounceBusy, waiting } from "./progress.js";
import { showSnippets } from "./snippets.js";
import { Stage } from "./stage.js";

export class See {
  #picture = new Stage("picture", HTMLCanvasElement);
  #glyphs = new Stage("glyphs", HTMLCanvasElement);
  #newest = new LatestRequest("see-progress");
  #newestCell = new LatestRequest("see-progress");
  #options;
  #shown = false;
  #stale = true;
  /** @type {import("./types.js").Hog | null} */
  #hog = null;
  /** Id of what is shown. */
  #of = "";
  /** @type {[number, number] | null} row, column */
  #at = null;
  /** @type {Map<string, import("./types.js").Cell>} */
  #cells = new Map();
  #askCell = debounceBusy(() => void this.#readCell(), 30);

  /** @param {import("./main.js").App} app */
  constructor(app) {
    this.app = app;
    this.#options = new Options("see", app.about, app.address, () => this.refresh());
    element("see-download", HTMLButtonElement).addEventListener("click", () => void this.#download());
    for (const stage of [this.#picture, this.#glyphs]) {
      const look = (/** @type {PointerEvent} */ event) => this.#lookAt(stage.at(event));
      stage.picture.addEventListener("pointermove", look);
      stage.picture.addEventListener("pointerdown", look);
      stage.picture.addEventListener("keydown", (event) => this.#key(event));
    }
  }

  restore() {
    this.#options.restore();
  }

  /** @param {boolean} shown */
  show(shown) {
    this.#shown = shown;
    if (shown && (this.#stale || this.#of !== this.app.source.value?.id)) this.refresh();
  }

  /** Describes the source again. */
  refresh() {
    this.#stale = true;
    const source = this.app.source.value;
    if (!this.#shown || !source) return;
    this.#stale = false;
    void this.#draw(source);
  }

  /** @param {NonNullable<import("./main.js").App["source"]["value"]>} source */
  async #draw(source) {
    const options = this.#options.value;
    let failed = false;
    const result = await this.#newest.run("Computing the descriptor", async (signal) => {
      /** @type {[Promise<[import("./types.js").Hog, ImageBitmap]>, Promise<ImageBitmap | null>]} */
      const both = [
        this.#describe({ ...this.app.source.named, ...this.app.dialect.value, ...options }, signal),
        source.kind === "photo" ? this.app.source.picture(source.id, Number(options.size), signal) : Promise.resolve(null),
      ];
      return Promise.all(both).catch((error) => {
        failed = !signal.aborted;
        throw error;
      });
    });
    if (!result) return failed ? this.#blank() : undefined;
    clearError();
    this.#of = source.id;
    element("see-shown", HTMLElement).hidden = false;
    const [[hog, glyphs], picture] = result;
    this.#hog = hog;
    this.#cells.clear();
    const [height, width] = hog.image_size;
    const [tall, wide] = [hog.glyphs.rows * hog.glyphs.cell[0], hog.glyphs.cols * hog.glyphs.cell[1]];
    element("picture-figure", HTMLElement).hidden = !picture;
    if (picture) {
      paint(this.#picture.picture, picture);
      this.#picture.fit(width, height, Math.max(width, wide), Math.max(height, tall));
      this.#picture.picture.setAttribute("aria-label", `The photograph ${source.name}, ${width} by ${height} pixels`);
    }
    paint(this.#glyphs.picture, glyphs);
    this.#glyphs.fit(wide, tall, picture ? Math.max(width, wide) : wide, picture ? Math.max(height, tall) : tall);
    this.#glyphs.picture.setAttribute("aria-label",
      `Glyphs of ${source.name}: ${hog.glyphs.rows} rows and ${hog.glyphs.cols} columns of cells`);
    element("picture-caption", HTMLElement).textContent = `Photograph, ${width} × ${height} pixels`;
    element("glyphs-caption", HTMLElement).textContent = `Glyphs, ${hog.glyphs.rows} × ${hog.glyphs.cols} cells`;
    const isTemplate = source.kind === "descriptor" && source.template;
    const shape = `${isTemplate ? "Weights of a detector, preset" : "Descriptor"} ${hog.name}: ${hog.shape.join(" × ")}, ` +
      `${hog.numbers.toLocaleString("en")} numbers, ${hog.signed ? "signed" : "unsigned"} directions, ` +
      `${hog.milliseconds.toFixed(hog.milliseconds < 10 ? 1 : 0)} ms`;
    element("shape", HTMLElement).textContent = shape;
    announce(shape);
    element("see-download", HTMLButtonElement).disabled = false;
    showSnippets(element("see-snippets", HTMLElement), hog.snippets, this.app.source.sample);
    this.#glyphs.picture.dataset.key = hog.key;
    if (this.#at) this.#mark(Math.min(this.#at[0], hog.glyphs.rows - 1), Math.min(this.#at[1], hog.glyphs.cols - 1));
  }

  /**
   * @param {object} asked
   * @param {AbortSignal} signal
   * @returns {Promise<[import("./types.js").Hog, ImageBitmap]>} with the picture of its glyphs
   */
  async #describe(asked, signal) {
    /** @type {import("./types.js").Hog} */
    const hog = await postJson("api/hog", asked, signal);
    return [hog, await pictureOf(pngOf(hog.glyphs.image))];
  }

  /** Takes away what is shown: it is of another source, or of other parameters. */
  #blank() {
    this.#of = "";
    element("see-shown", HTMLElement).hidden = true;
    this.#hog = null;
    for (const stage of [this.#picture, this.#glyphs]) {
      stage.picture.width = stage.picture.height = 2;
      stage.picture.setAttribute("aria-label", "Nothing is shown");
      stage.mark([]);
    }
    delete this.#glyphs.picture.dataset.key;
    element("cell", HTMLElement).replaceChildren();
    element("see-download", HTMLButtonElement).disabled = true;
  }

  /** @param {[number, number]} point in pixels of the image */
  #lookAt([x, y]) {
    if (!this.#hog) return;
    const row = Math.floor(y / this.#hog.glyphs.cell[0]), col = Math.floor(x / this.#hog.glyphs.cell[1]);
    if (row < 0 || col < 0 || row >= this.#hog.glyphs.rows || col >= this.#hog.glyphs.cols) return;
    if (row !== this.#at?.[0] || col !== this.#at?.[1]) this.#mark(row, col);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const hog = this.#hog;
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!hog || !step || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const [row, col] = this.#at ?? [Math.floor(hog.glyphs.rows / 2), Math.floor(hog.glyphs.cols / 2)];
    const [down = 0, right = 0] = this.#at ? step : [];
    this.#mark(Math.min(hog.glyphs.rows - 1, Math.max(0, row + down)), Math.min(hog.glyphs.cols - 1, Math.max(0, col + right)));
  }

  /**
   * @param {number} row
   * @param {number} col
   */
  #mark(row, col) {
    if (!this.#hog) return;
    this.#at = [row, col];
    const [height, width] = this.#hog.glyphs.cell;
    this.#marks([col * width, row * height, (col + 1) * width, (row + 1) * height]);
    if (this.#cells.has(`${row},${col}`)) void this.#readCell();
    else this.#askCell();
  }

  /**
   * @param {import("./types.js").Box} cell
   * @param {import("./types.js").Box} [block]
   */
  #marks(cell, block) {
    const marks = [...block ? [{ box: block, strong: false }] : [], { box: cell, strong: true }];
    this.#picture.mark(marks);
    this.#glyphs.mark(marks);
  }

  async #readCell() {
    if (!this.#at || !this.#hog) return;
    const [row, col] = this.#at;
    const { key, signed } = this.#hog;
    let cell = this.#cells.get(`${row},${col}`);
    if (!cell) {
      cell = await this.#newestCell.run("Reading the cell", (signal) =>
        getJson(`api/hog/${encodeURIComponent(key)}/cell?row=${row}&col=${col}`, signal));
      if (!cell || this.#hog?.key !== key) return;
      this.#cells.set(`${row},${col}`, cell);
    }
    if (this.#at[0] !== row || this.#at[1] !== col) return;
    showCell(cell, signed);
    this.#marks(cell.box, cell.block?.box);
  }

  async #download() {
    const hog = this.#hog;
    if (!hog) return;
    const blob = await waiting("see-progress", "Getting the descriptor", (signal) =>
      getBlob(`api/hog/${encodeURIComponent(hog.key)}/file`, signal));
    if (blob) save(blob, `${stem(this.app.source.value?.name ?? "")}.npz`);
  }
}
