/** The WebSocket of a fit. */

import { openSocket, ServerError } from "./api.js";

export class Session {
  /** @type {WebSocket | null} */
  #socket = null;

  /**
   * @param {(message: any) => void} received
   * @param {() => void} lost the connection ended and the page had not asked for it
   */
  constructor(received, lost) {
    this.received = received;
    this.lost = lost;
  }

  /** @returns {Promise<void>} */
  open() {
    if (this.#socket?.readyState === WebSocket.OPEN) return Promise.resolve();
    this.close();
    const socket = openSocket("api/fit");
    this.#socket = socket;
    socket.addEventListener("message", (event) => { if (socket === this.#socket) this.received(JSON.parse(event.data)); });
    return new Promise((resolve, reject) => {
      let opened = false;
      socket.addEventListener("open", () => { opened = true; resolve(); });
      socket.addEventListener("close", () => {
        reject(new ServerError(0, "The server does not open the connection: press “Show the mesh” again."));
        if (socket !== this.#socket) return;
        this.#socket = null;
        if (opened) this.lost();
      });
    });
  }

  /** @param {object} message */
  send(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }

  close() {
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
  }
}
