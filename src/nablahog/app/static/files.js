/** Bytes and files: base64, pictures, downloads. */

import { make } from "./dom.js";

/** @param {string} base64 */
export function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** @param {string} base64 */
export const pngOf = (base64) => new Blob([bytesOf(base64)], { type: "image/png" });

/** @param {string} base64 of a PNG */
export const addressOf = (base64) => `data:image/png;base64,${base64}`;

/** @param {Blob} blob */
export const pictureOf = (blob) => createImageBitmap(blob);

/**
 * Draws a picture as it is.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {ImageBitmap} picture
 */
export function paint(canvas, picture) {
  canvas.width = picture.width;
  canvas.height = picture.height;
  canvas.getContext("2d")?.drawImage(picture, 0, 0);
}

/**
 * Lets the browser save something.
 *
 * @param {Blob} blob
 * @param {string} name
 */
export function save(blob, name) {
  const address = URL.createObjectURL(blob);
  make("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** @param {string} name of a file; without folder and ending */
export const stem = (name) => name.replace(/^.*[/\\]/, "").replace(/\.[^.]*$/, "") || "image";
