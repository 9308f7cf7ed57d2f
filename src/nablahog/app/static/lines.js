/** The command line and the lines of Python that do the same, with buttons to copy them. */

import { make } from "./dom.js";

/**
 * @param {HTMLElement} place
 * @param {import("./types.js").Lines} lines
 */
export function showLines(place, lines) {
  const blocks = [["Command line", lines.command], ["Python", lines.python]].map(([title = "", text = ""]) => {
    const pre = make("pre", { tabindex: 0, role: "region", "aria-label": title }, text);
    const button = make("button", { type: "button", "aria-label": `Copy: ${title}` }, "Copy");
    button.addEventListener("click", async () => {
      button.textContent = await copied(text, pre) ? "Copied" : "Press Ctrl+C";
      setTimeout(() => { button.textContent = "Copy"; }, 2000);
    });
    return make("div", { class: "lines" }, make("h3", {}, title), make("div", {}, pre, button));
  });
  place.replaceChildren(make("h2", {}, "The same without this page"), ...blocks);
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
