/** Glyphs: the strokes of each cell, one for each orientation, as bright as its votes. */

import { bytesOf } from "./files.js";

/**
 * The pixels of a stroke within its cell, as offsets from the cell's first pixel, and how much of each it covers.
 *
 * @param {number} angle of the gradient; the stroke is perpendicular to it
 * @param {number} height of a cell
 * @param {number} width
 * @param {number} stride pixels of a row of the whole picture
 */
function stroke(angle, height, width, stride) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  const side = Math.min(height, width);
  const [halfLength, halfWidth] = [side / 2 - 0.5, Math.max(0.5, side / 24)];
  const offsets = [], weights = [];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const [dx, dy] = [x + 0.5 - width / 2, y + 0.5 - height / 2];
      const along = Math.abs(dy * cos - dx * sin), across = Math.abs(dx * cos + dy * sin);
      const covered = Math.min(1, Math.max(0, halfLength + 0.5 - along)) * Math.min(1, Math.max(0, halfWidth + 0.5 - across));
      if (covered < 0.02) continue;
      offsets.push(y * stride + x);
      weights.push(Math.round(256 * covered));
    }
  }
  return { offsets: Int32Array.from(offsets), weights: Int32Array.from(weights) };
}

/**
 * Draws glyphs, white on black, into a canvas whose cells have whole pixels; style sheets scale it.
 *
 * Pixels are set here and not by the lines of the canvas: a large grid has tens of thousands of strokes.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {import("./types.js").Votes} glyphs
 * @param {number} [wide] pixels of the whole picture, roughly
 */
export function drawGlyphs(canvas, glyphs, wide = 900) {
  const { rows, cols, cell, angles } = glyphs;
  const votes = bytesOf(glyphs.votes);
  const scale = wide / Math.max(cols * cell[1], rows * cell[0], 1);
  const height = Math.max(5, Math.round(scale * cell[0])), width = Math.max(5, Math.round(scale * cell[1]));
  const stride = cols * width;
  const gray = new Uint8Array(stride * rows * height);
  angles.forEach((angle, orientation) => {
    const { offsets, weights } = stroke(angle, height, width, stride);
    const count = offsets.length;
    for (let row = 0, vote = orientation; row < rows; row++) {
      for (let col = 0; col < cols; col++, vote += angles.length) {
        const bright = votes[vote] ?? 0;
        if (bright < 3) continue;
        const first = row * height * stride + col * width;
        for (let i = 0; i < count; i++) {
          const at = first + /** @type {number} */ (offsets[i]);
          const value = (bright * /** @type {number} */ (weights[i])) >> 8;
          if (value > /** @type {number} */ (gray[at])) gray[at] = value;
        }
      }
    }
  });
  canvas.width = stride;
  canvas.height = rows * height;
  const context = canvas.getContext("2d");
  if (!context || !gray.length) return;
  const picture = context.createImageData(canvas.width, canvas.height);
  const pixels = new Uint32Array(picture.data.buffer);
  for (let i = 0; i < pixels.length; i++) pixels[i] = 0xff000000 | (/** @type {number} */ (gray[i]) * 0x010101);
  context.putImageData(picture, 0, 0);
}
