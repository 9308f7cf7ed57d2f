/** The command line and the lines of Python that do the same, with buttons to copy them. */

import { getBlob } from "./api.js";
import { make } from "./dom.js";
import { save } from "./files.js";
import { waiting } from "./progress.js";

/**
 * @param {HTMLElement} place
 * @param {import("./types.js").Snippets} snippets
 * @param {import("./types.js").PhotoInfo | null} sample the photograph, if the reader has no file of it
 */
export function showSnippets(place, snippets, sample) {
  const blocks = [["Command line", snippets.command], ["Python", snippets.python]].map(([title = "", text = ""]) => {
    const pre = make("pre", { tabindex: 0, role: "region", "aria-label": title }, text);
    const button = make("button", { type: "button", "aria-label": `Copy: ${title}` }, "Copy");
    button.addEventListener("click", async () => {
      button.textContent = await copied(text, pre) ? "Copied" : "Press Ctrl+C";
      setTimeout(() => { button.textContent = "Copy"; }, 2000);
    });
    return make("div", { class: "snippet" }, make("h3", {}, title), make("div", {}, pre, button));
  });
  const saved = make("button", { type: "button" }, `Save ${sample?.name}`);
  saved.addEventListener("click", async () => {
    const blob = sample && await waiting("source-progress", "Getting the photograph", (signal) =>
      getBlob(`api/photos/${encodeURIComponent(sample.id)}`, signal));
    if (sample && blob) save(blob, sample.name);
  });
  place.replaceChildren(make("h2", {}, "The same without this page"), ...blocks,
    ...sample ? [make("p", { class: "note" }, "Both read the sample photograph from a file: ", saved)] : []);
}

/**
 * @param {string} text
 * @param {HTMLElement} shown is selected where the browser does not let a page copy, as without HTTPS
 */
async function copied(text, shown) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    getSelection()?.selectAllChildren(shown);
    return document.execCommand("copy");
  }
}
