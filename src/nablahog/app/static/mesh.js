/** Which mesh is fitted: one of the server's, or one from a file. */

import { postFile } from "./api.js";
import { element, fill, make } from "./dom.js";
import { clearError, LatestRequest } from "./progress.js";

const AXES = [{ id: "", name: "as its format" }, ...["x", "y", "z", "-x", "-y", "-z"].map((id) => ({ id, name: id.replace("-", "−") }))];

export class MeshChooser {
  #select = element("mesh", HTMLSelectElement);
  #up = element("mesh-up", HTMLSelectElement);
  #front = element("mesh-front", HTMLSelectElement);
  #newest = new LatestRequest("fit-progress");
  /** @type {File | null} the last one, to be sent again with other axes */
  #file = null;

  /**
   * @param {import("./types.js").About} about
   * @param {import("./address.js").Address} address
   * @param {() => void} changed
   */
  constructor(about, address, changed) {
    this.about = about;
    this.address = address;
    this.changed = changed;
    fill(this.#select, about.meshes);
    fill(this.#up, AXES);
    fill(this.#front, AXES);
    this.restore();
    this.#select.addEventListener("change", () => {
      this.#newest.abort();
      element("mesh-about", HTMLElement).textContent = "";
      this.#remember();
      changed();
    });
    const input = element("mesh-file", HTMLInputElement);
    input.addEventListener("change", () => { if (input.files?.[0]) void this.open(input.files[0]); });
    for (const axis of [this.#up, this.#front]) axis.addEventListener("change", () => { if (this.#file) void this.#send(this.#file); });
  }

  get value() {
    return this.#select.value;
  }

  restore() {
    const id = this.address.get("mesh");
    if (id) this.#add(id, this.address.get("mesh_name") ?? "mesh from a file");
    this.#select.value = id ?? this.about.meshes[0]?.id ?? "";
  }

  /** @param {File} file */
  async open(file) {
    this.#file = file;
    element("mesh-axes", HTMLElement).hidden = false;
    await this.#send(file);
  }

  /** @param {File} file */
  async #send(file) {
    clearError();
    const query = { name: file.name, up: this.#up.value, front: this.#front.value };
    /** @type {{id: string, name: string, vertices: number, faces: number} | undefined} */
    const mesh = await this.#newest.run(`Sending ${file.name}`, (signal) => postFile("api/meshes", query, file, signal));
    if (!mesh) return;
    this.#add(mesh.id, mesh.name);
    this.#select.value = mesh.id;
    element("mesh-about", HTMLElement).textContent =
      `${mesh.name}: ${mesh.vertices.toLocaleString("en")} vertices, ${mesh.faces.toLocaleString("en")} faces`;
    this.#remember();
    this.changed();
  }

  /**
   * @param {string} id
   * @param {string} name
   */
  #add(id, name) {
    if (![...this.#select.options].some((option) => option.value === id)) this.#select.append(make("option", { value: id }, name));
  }

  #remember() {
    const known = this.about.meshes.some((mesh) => mesh.id === this.value);
    this.address.set({ mesh: this.value, mesh_name: known ? null : this.#select.selectedOptions[0]?.text ?? null });
  }
}
