/** A slider between two pictures of one size. */

import { element, make } from "./dom.js";

/**
 * @param {string} id of the figure
 * @param {{source: string, name: string}} before
 * @param {{source: string, name: string}} after
 */
export function showWipe(id, before, after) {
  const place = element(id, HTMLElement);
  const range = make("input", { type: "range", min: 0, max: 100, value: 50, "aria-label": `${before.name} or ${after.name}` });
  const show = () => place.style.setProperty("--at", `${range.value}%`);
  const pictures = make("div", {}, make("img", { src: before.source, alt: before.name, draggable: "false" }),
    make("img", { src: after.source, alt: after.name, draggable: "false" }));
  const drag = (/** @type {PointerEvent} */ event) => {
    const box = pictures.getBoundingClientRect();
    range.value = String(100 * (event.clientX - box.left) / box.width);
    show();
  };
  pictures.addEventListener("pointerdown", drag);
  pictures.addEventListener("pointermove", (event) => { if (event.buttons) drag(event); });
  range.addEventListener("input", show);
  place.replaceChildren(pictures, range,
    make("figcaption", {}, make("span", {}, before.name), make("span", {}, after.name)));
  show();
}
