/** A cell: its histogram as a rose, its block, and the entries of the descriptor. */

import { draw, element, figure, make, scrolling, debounce, table } from "./dom.js";

const SIDE = 240;

const say = debounce((/** @type {string} */ text) => { element("cell-said", HTMLElement).textContent = text; }, 500);

/**
 * @param {import("./types.js").Cell} cell
 * @param {boolean} signed whether directions go over 360°
 */
export function showCell(cell, signed) {
  const place = element("cell", HTMLElement);
  const block = cell.block;
  const left = make("div", {},
    make("p", {}, make("strong", {}, `Row ${cell.row}, column ${cell.col}`), make("br"), `pixels ${pixels(cell.box)}`),
    cell.histogram ? rose(cell.angles, cell.histogram, signed)
      : make("p", { class: "note" }, "The descriptor leaves this cell out."),
    make("p", { class: "note" }, block ? `Block: row ${block.row}, column ${block.col}, pixels ${pixels(block.box)}`
      : "This descriptor has no blocks."));
  const scrolled = place.querySelector(".scroll")?.scrollTop ?? 0;
  const region = scrolling("Entries of the descriptor", table("Entries of the descriptor", ["Index", "Name", "Value"],
    cell.entries.map((entry) => [String(entry.index), entry.name, figure(entry.value, 4)]), [2]));
  place.replaceChildren(left, cell.entries.length ? region : make("p", { class: "note" }, "No entries."));
  region.scrollTop = scrolled;
  const strongest = cell.histogram ? cell.histogram.indexOf(Math.max(...cell.histogram)) : -1;
  say(`Row ${cell.row}, column ${cell.col}` + (strongest < 0 ? "" : `, largest at ${Math.round(cell.angles[strongest] ?? 0)} degrees`));
}

/** @param {import("./types.js").Box} box */
const pixels = ([x0, y0, x1, y1]) => `${short(x0)}…${short(x1)} × ${short(y0)}…${short(y1)}`;

/** @param {number} value */
const short = (value) => String(Math.round(10 * value) / 10).replace("-", "−");

/**
 * A sector for each orientation bin, as long as its vote, in the direction of the gradient.
 *
 * @param {number[]} angles in degrees
 * @param {number[]} histogram
 * @param {boolean} signed
 */
function rose(angles, histogram, signed) {
  const middle = SIDE / 2, radius = SIDE / 2 - 24;
  const most = Math.max(...histogram, 1e-12);
  const half = Math.PI / angles.length * (signed ? 1 : 0.5) * 0.85;
  const strongest = histogram.indexOf(Math.max(...histogram));
  const picture = draw("svg", { viewBox: `0 0 ${SIDE} ${SIDE}`, role: "img",
    "aria-label": Math.max(...histogram) > 0
      ? `Histogram of ${angles.length} orientation bins; the largest is at ${Math.round(angles[strongest] ?? 0)} degrees`
      : "Histogram: empty" },
  draw("circle", { cx: middle, cy: middle, r: radius, class: "axis" }),
  draw("circle", { cx: middle, cy: middle, r: radius / 2, class: "axis" }));
  const places = [[middle + radius + 3, middle + 4, "0°", "start"], [middle, SIDE - 10, "90°", "middle"]];
  for (const [x, y, text, anchor] of places) picture.append(draw("text", { x, y, "text-anchor": anchor }, String(text)));
  angles.forEach((angle, bin) => {
    for (const turn of signed ? [0] : [0, Math.PI]) {
      const direction = angle * Math.PI / 180 + turn, length = radius * (histogram[bin] ?? 0) / most;
      if (length < 0.5) continue;
      const corner = (/** @type {number} */ at) => `${middle + length * Math.cos(at)},${middle + length * Math.sin(at)}`;
      picture.append(draw("path", { class: "bar-fill",
        d: `M${middle},${middle}L${corner(direction - half)}A${length},${length} 0 0 1 ${corner(direction + half)}Z` },
      draw("title", {}, `${Math.round(angle)}°: ${figure(histogram[bin], 4)}`)));
    }
  });
  return picture;
}
