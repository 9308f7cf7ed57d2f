/** One inversion: the request and its events. */

import { postEvents, ServerError } from "./api.js";

/**
 * @param {object} body of the request
 * @param {AbortSignal} signal
 * @param {{queued: (waiting: number) => void, start: (start: import("./types.js").InvertStart) => void,
 *   frame: (frame: import("./types.js").InvertFrame) => void}} on
 * @returns {Promise<import("./types.js").InvertDone>}
 */
export async function invert(body, signal, on) {
  for await (const { event, data } of postEvents("api/invert", body, signal)) {
    if (event === "queued") on.queued(data.waiting);
    else if (event === "start") on.start(data);
    else if (event === "frame") on.frame(data);
    else if (event === "done") return data;
    else if (event === "error") throw new ServerError(422, data.error);
  }
  throw new ServerError(0, "The server ended the inversion before it was done: press “Start” again.");
}
