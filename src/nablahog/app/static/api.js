/** Requests to the server. */

/** Bytes of an upload, once the server has said it. */
let most = Infinity;
const token = new URLSearchParams(location.search).get("token");
/** Names of fields whose controls are called otherwise. @type {{[name: string]: string}} */
const LABELS = { settings: "Parameters", focal: "Focal length" };

/**
 * A sentence of the server with the labels of controls for the fields that it names, in backticks.
 *
 * @param {string} sentence
 */
const nameControls = (sentence) => sentence.replaceAll(/`([a-z])(\w*)`/g, (_, first, rest) =>
  `“${LABELS[first + rest] ?? first.toUpperCase() + rest.replaceAll("_", " ")}”`);

/** An answer that is an error, with the server's sentence. */
export class ServerError extends Error {
  /**
   * @param {number} status
   * @param {string} sentence
   * @param {any} answer
   */
  constructor(status, sentence, answer = null) {
    super(nameControls(sentence));
    this.status = status;
    this.answer = answer;
  }
}

/**
 * @param {string} path
 * @param {RequestInit} init
 */
async function request(path, init) {
  const headers = new Headers(init.headers);
  if (token) headers.set("X-Nablahog-Token", token);
  let response;
  try {
    response = await fetch(path, { ...init, headers, cache: "no-store" });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new ServerError(0, "The server does not answer: if “nablahog app” has ended, start it again, and load this page again.");
  }
  if (response.ok) return response;
  const answer = await response.json().catch(() => null);
  throw new ServerError(response.status, answer?.error ?? `The server answers ${response.status}: load this page again.`, answer);
}

/**
 * @param {string} path
 * @param {AbortSignal} [signal]
 * @returns {Promise<any>}
 */
export async function getJson(path, signal) {
  return (await request(path, { signal: signal ?? null })).json();
}

/**
 * @param {string} path
 * @param {AbortSignal} [signal]
 */
export async function getBlob(path, signal) {
  return (await request(path, { signal: signal ?? null })).blob();
}

/**
 * @param {string} path
 * @param {object} body
 * @param {AbortSignal} signal
 */
const posted = (path, body, signal) => request(path,
  { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal });

/**
 * @param {string} path
 * @param {object} body
 * @param {AbortSignal} signal
 * @returns {Promise<any>}
 */
export async function postJson(path, body, signal) {
  return (await posted(path, body, signal)).json();
}

/** @param {number} bytes that an upload may have */
export const limitUploads = (bytes) => { most = bytes; };

/**
 * @param {string} path
 * @param {{[key: string]: string}} query empty ones are left out
 * @param {Blob} body
 * @param {AbortSignal} signal
 * @returns {Promise<any>}
 */
export async function postFile(path, query, body, signal) {
  if (body.size > most) {
    throw new ServerError(413, `${query.name} has ${Math.ceil(body.size / 1e6)} MB; the limit is ${Math.floor(most / 1e6)} MB: choose a smaller file.`);
  }
  const values = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== ""));
  const headers = { "Content-Type": "application/octet-stream" };
  // a Blob's own type would take the place of the header
  return (await request(`${path}?${values}`, { method: "POST", headers, body: await body.arrayBuffer(), signal })).json();
}

/**
 * The server-sent events that answer a request.
 *
 * @param {string} path
 * @param {object} body
 * @param {AbortSignal} signal
 * @returns {AsyncGenerator<{event: string, data: any}>}
 */
export async function* postEvents(path, body, signal) {
  const response = await posted(path, body, signal);
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      text += value.replaceAll("\r", "");
      const parts = text.split("\n\n");
      text = parts.pop() ?? "";
      for (const part of parts) {
        let [event, data] = ["message", ""];
        for (const line of part.split("\n")) {
          if (line.startsWith("event:")) event = line.slice(6).trim();
          else if (line.startsWith("data:")) data += line.slice(5);
        }
        if (data) yield { event, data: JSON.parse(data) };
      }
    }
  } finally {
    reader.cancel().catch(() => {});
  }
}

/** @param {string} path */
export function openSocket(path) {
  const url = new URL(path, location.href);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  if (token) url.searchParams.set("token", token);
  return new WebSocket(url);
}
