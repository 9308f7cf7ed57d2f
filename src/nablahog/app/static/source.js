/** The photograph or descriptor that all views look at: dropped, pasted, picked, or a sample. */

import { getBlob, postFile, ServerError } from "./api.js";
import { element, fill, make } from "./dom.js";
import { pictureOf, stem } from "./files.js";
import { clearError, showError, LatestRequest, waiting } from "./progress.js";
import * as question from "./question.js";

/**
 * @typedef {{kind: "photo"} & import("./types.js").PhotoInfo} PhotoSource
 * @typedef {{kind: "descriptor", id: string, whole: string, name: string, template: boolean,
 *   parts: import("./types.js").Named[], decided?: string}} DescriptorSource id: of the part that is looked at
 */

const ARRAYS = /\.(npy|npz|mat)$/i;
const STORAGES = /\.(ya?ml|xml|json)(\.gz)?$/i;
const MESHES = /\.(off|obj|ply|stl|glb|gltf)$/i;
/** How a file of COLMAP's cameras, and one of a detector or an SVM that OpenCV saved, begin. */
const CAMERA = /^\s*\d+\s+[A-Z_]+\s+\d+\s+\d+\s/m, DETECTOR = /object-detector-hog|ml_svm/;

/**
 * Whether a file is, by its name and beginning, the calibration of a camera.
 *
 * @param {File} file
 */
async function isCamera(file) {
  if (!/\.(txt|ya?ml|xml|json)$/i.test(file.name)) return false;
  const text = await file.slice(0, 2 ** 16).text();
  return /\.txt$/i.test(file.name) ? CAMERA.test(text) : !DETECTOR.test(text);
}

export class SourceChooser extends EventTarget {
  /** @type {PhotoSource | DescriptorSource | null} */
  #chosen = null;
  #newest = new LatestRequest("source-progress");
  /** @type {{key: string, picture: ImageBitmap}[]} */
  #pictures = [];

  /**
   * @param {import("./types.js").About} about
   * @param {import("./address.js").Address} address
   * @param {(file: File) => void} openMesh
   * @param {(file: File) => void} openCamera
   */
  constructor(about, address, openMesh, openCamera) {
    super();
    this.about = about;
    this.address = address;
    this.openMesh = openMesh;
    this.openCamera = openCamera;
    this.#thumbnails();
    this.#listen();
    this.restore();
  }

  /** @returns {PhotoSource | DescriptorSource | null} what was chosen, or the photograph that the view begins with */
  get value() {
    if (this.#chosen) return this.#chosen;
    const { samples } = this.about;
    const object = this.address.view === "fit" ? samples.find((each) => each.box) : undefined;
    const first = samples.find((each) => each.own) ?? object ?? samples[0];
    return first ? { kind: "photo", ...first } : null;
  }

  /** The photograph, if it is one that the reader has no file of. */
  get sample() {
    return this.about.samples.find((each) => each.id === this.value?.id && !each.own) ?? null;
  }

  /** @returns {{photo: string} | {descriptor: string}} as requests name it */
  get named() {
    if (!this.value) throw new Error("no source");
    return this.value.kind === "photo" ? { photo: this.value.id } : { descriptor: this.value.id };
  }

  /** Takes the source from the address. */
  restore() {
    const [photo, descriptor] = [this.address.get("photo"), this.address.get("descriptor")];
    const sample = this.about.samples.find((each) => each.id === photo);
    const name = this.address.get("name") ?? "";
    if (descriptor) {
      const parts = (this.address.get("parts") ?? "").split(",").filter(Boolean).map((text, i) =>
        ({ id: text, name: `part ${i + 1}` }));
      this.#take({ kind: "descriptor", id: this.address.get("part") ?? descriptor, whole: descriptor, name, parts,
        template: this.address.get("template") === "1" }, false);
    } else if (sample) {
      this.#take({ kind: "photo", ...sample }, false);
    } else if (photo) {
      const [width = 0, height = 0] = this.address.numbers("pixels", 2) ?? [];
      this.#take({ kind: "photo", id: photo, name, width, height }, false);
    } else {
      this.#take(null, false);
    }
  }

  /**
   * The photograph, at most `size` pixels on its longer side.
   *
   * @param {string} id
   * @param {number} size
   * @param {AbortSignal} signal
   */
  async picture(id, size, signal) {
    const key = `${id} ${size}`;
    const known = this.#pictures.find((each) => each.key === key);
    if (known) return known.picture;
    const picture = await pictureOf(await getBlob(`api/photos/${encodeURIComponent(id)}?size=${size}`, signal));
    this.#pictures.push({ key, picture });
    if (this.#pictures.length > 8) this.#pictures.shift();
    return picture;
  }

  /**
   * @param {PhotoSource | DescriptorSource | null} source
   * @param {boolean} told whether the address is to follow
   */
  #take(source, told = true) {
    this.#leave();
    const other = source?.id !== this.value?.id;
    this.#chosen = source;
    const photo = source?.kind === "photo" ? source : null, array = source?.kind === "descriptor" ? source : null;
    if (source && told) {
      const sample = this.about.samples.some((each) => each.id === photo?.id);
      this.address.set({
        photo: photo?.id ?? null, pixels: photo && !sample ? `${photo.width},${photo.height}` : null,
        name: sample ? null : source.name,
        descriptor: array?.whole ?? null, part: array && array.id !== array.whole ? array.id : null,
        template: array?.template ? "1" : null, parts: array && array.parts.length > 1 ? array.parts.map((part) => part.id).join(",") : null,
        ...other ? { box: null, pose: null, axis: null, intrinsics: null, distortion: null,
          focal: sample ? null : photo?.focal ?? null } : {},
      });
      scrollTo({ top: 0, behavior: "instant" });
    }
    this.dispatchEvent(new Event("change"));
  }

  /** Says which one it is; each view may begin with another. */
  say() {
    const source = this.value;
    const photo = source?.kind === "photo" ? source : null, array = source?.kind === "descriptor" ? source : null;
    const size = photo?.width ? `, ${photo.width} × ${photo.height} pixels` : "";
    const kind = photo ? "" : array?.template ? ", detector template" : `, descriptor${array?.decided ?? ""}`;
    const name = source?.name || "Photograph";
    element("source-name", HTMLElement).textContent = `${name}${size}${kind}`;
    // where the choice is folded away, above the view
    element("decided", HTMLElement).textContent = array?.decided ? `${name}${kind}` : "";
    element("chosen", HTMLElement).textContent = name;
    for (const button of document.querySelectorAll("#samples button")) {
      button.setAttribute("aria-pressed", String(button instanceof HTMLElement && button.dataset.id === photo?.id));
    }
    const part = element("part", HTMLSelectElement);
    element("part-line", HTMLElement).hidden = !array || array.parts.length < 2;
    if (array) fill(part, array.parts, array.id);
  }

  #thumbnails() {
    const place = element("samples", HTMLElement);
    for (const sample of this.about.samples) {
      const name = stem(sample.name);
      const image = make("img", { alt: name, width: 70, height: 70 });
      const button = make("button", { type: "button", "data-id": sample.id, title: name, "aria-pressed": false }, image);
      button.addEventListener("click", () => this.#take({ kind: "photo", ...sample }));
      place.append(button);
      void waiting("source-progress", "Loading the samples", (signal) =>
        getBlob(`api/photos/${encodeURIComponent(sample.id)}?size=160`, signal)).then((blob) => {
        if (blob) image.src = URL.createObjectURL(blob);
      });
    }
    place.hidden = !this.about.samples.length;
  }

  #listen() {
    const input = element("file", HTMLInputElement);
    input.addEventListener("change", () => {
      const file = input.files?.[0];
      if (file) void this.open(file);
      // so that the same file can be chosen again
      input.value = "";
    });
    document.addEventListener("paste", (event) => {
      if (!event.clipboardData?.files.length) return;
      event.preventDefault();
      this.#openOne(event.clipboardData.files);
    });
    let depth = 0;
    const over = (/** @type {number} */ now) => {
      depth = Math.max(0, now);
      document.body.classList.toggle("dropping", depth > 0);
    };
    document.addEventListener("dragenter", (event) => { event.preventDefault(); over(depth + 1); });
    document.addEventListener("dragleave", () => over(depth - 1));
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      over(0);
      if (event.dataTransfer?.files.length) this.#openOne(event.dataTransfer.files);
    });
    element("part", HTMLSelectElement).addEventListener("change", (event) => {
      if (this.value?.kind !== "descriptor" || !(event.target instanceof HTMLSelectElement)) return;
      this.#take({ ...this.value, id: event.target.value });
    });
  }

  /** @param {FileList} files that were dropped or pasted: one is opened, more are refused */
  #openOne(files) {
    const [file] = files;
    if (files.length > 1) {
      this.#leave();
      showError(`Expected one file, got ${files.length}: open one at a time. The command takes many: nablahog invert FOLDER -o results`);
    } else if (file) {
      void this.open(file);
    }
  }

  /** Ends what was begun with another file: its question, its upload, its error. */
  #leave() {
    question.close();
    this.#newest.abort();
    clearError();
  }

  /** @param {File} file a photograph, an array, a detector, a mesh or a camera */
  async open(file) {
    this.#leave();
    if (MESHES.test(file.name)) {
      this.openMesh(file);
    } else if (await isCamera(file)) {
      this.openCamera(file);
    } else if (ARRAYS.test(file.name) || STORAGES.test(file.name)) {
      void this.#describe(file, { as: "", preset: "", settings: "", image_size: "", key: "" });
    } else {
      void this.#upload(file);
    }
  }

  /**
   * An error of a file that was to take the place of what is open, which it says then, too.
   *
   * @param {unknown} error
   */
  #refusal(error) {
    const name = this.value?.name;
    if (!(error instanceof ServerError) || !error.status || !name) return error;
    return new ServerError(error.status, `${error.message.replace(/\.$/, "")}. ${name} stays open.`, error.answer);
  }

  /** @param {File} file */
  async #upload(file) {
    /** @type {import("./types.js").PhotoInfo | undefined} */
    const photo = await this.#newest.run(`Sending ${file.name}`, (signal) =>
      postFile("api/photos", { name: file.name }, file, signal).catch((error) => { throw this.#refusal(error); }));
    if (photo) this.#take({ kind: "photo", ...photo });
  }

  /**
   * @param {File} file
   * @param {question.Answers} answers
   */
  async #describe(file, answers) {
    const result = await this.#newest.run(`Sending ${file.name}, and finding out which HOG it is`, async (signal) => {
      try {
        return await postFile("api/descriptors", { name: file.name, ...answers }, file, signal);
      } catch (error) {
        if (!(error instanceof ServerError) || !error.answer?.question) throw this.#refusal(error);
        return error;
      }
    });
    if (result instanceof ServerError) {
      clearError();
      question.ask(result.message, result.answer.question, answers, this.about, (next) => void this.#describe(file, next));
    } else if (result) {
      /** @type {import("./types.js").DescriptorInfo} */
      const info = result;
      this.#take({ kind: "descriptor", id: info.parts[0]?.id ?? info.id, whole: info.id, name: info.name,
        template: info.template, parts: info.parts,
        decided: info.decided_by ? ` of ${info.preset}, because ${info.decided_by}` : info.remark && `; ${info.remark}` });
    }
  }
}
