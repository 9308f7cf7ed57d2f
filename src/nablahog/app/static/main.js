/** The start of the page, and its views. */

import { Address } from "./address.js";
import { getJson, limitUploads, ServerError } from "./api.js";
import { element } from "./dom.js";
import { Fit } from "./fit.js";
import { Invert } from "./invert.js";
import { Dialects } from "./options.js";
import { clearError, showError, waiting } from "./progress.js";
import { See } from "./see.js";
import { SourceChooser } from "./source.js";

/**
 * What the views share.
 *
 * @typedef {{about: import("./types.js").About, address: Address, source: SourceChooser, dialect: Dialects}} App
 */

const TITLES = { see: "See", invert: "Invert", fit: "Fit" };

/** @param {import("./types.js").About} about */
function start(about) {
  limitUploads(about.limits.upload_bytes);
  const address = new Address();
  const dialect = new Dialects(about, address, () => {
    see.refresh();
    invert.explain();
  });
  /** @param {(file: File) => void} open in Fit */
  const inFit = (open) => (/** @type {File} */ file) => {
    if (address.view === "fit") return open(file);
    // after the view has begun, which takes the camera from the address
    address.addEventListener("view", () => open(file), { once: true });
    address.go("fit");
  };
  const source = new SourceChooser(about, address, inFit((file) => fit.openMesh(file)), inFit((file) => fit.openCamera(file)));
  /** @type {App} */
  const app = { about, address, source, dialect };
  const see = new See(app), invert = new Invert(app), fit = new Fit(app);

  const show = () => {
    source.say();
    const described = source.value?.kind === "descriptor";
    // a descriptor from a file knows how it was made
    element("dialect", HTMLElement).hidden = address.view === "fit" || described;
    element("choose-what", HTMLElement).textContent =
      described ? "Descriptor" : address.view === "fit" ? "Photograph" : "Photograph and descriptor";
    for (const each of document.querySelectorAll("[data-photo-only]")) {
      if (each instanceof HTMLElement) each.hidden = described;
    }
    for (const section of document.querySelectorAll("[data-view]")) {
      if (section instanceof HTMLElement) section.hidden = section.dataset.view !== address.view;
    }
    for (const tab of document.querySelectorAll("[data-tab]")) {
      if (!(tab instanceof HTMLElement)) continue;
      if (tab.dataset.tab === address.view) tab.setAttribute("aria-current", "page");
      else tab.removeAttribute("aria-current");
    }
    document.title = `${TITLES[address.view]} – ∇HOG`;
    see.show(address.view === "see");
    if (address.view === "invert") invert.show();
    fit.show(address.view === "fit");
  };
  const wide = matchMedia("(min-width: 60rem)"), choose = element("choose", HTMLDetailsElement);
  // beside the view, or folded above it
  const fold = () => {
    const open = wide.matches || !source.value;
    if (!open && choose.contains(document.activeElement)) choose.querySelector("summary")?.focus();
    choose.open = open;
  };
  wide.addEventListener("change", fold);
  source.addEventListener("change", () => {
    see.refresh();
    show();
    fold();
  });
  address.addEventListener("view", show);
  /** @type {HTMLInputElement | null} the one that the error is about */
  let wrong = null;
  document.addEventListener("change", ({ target }) => {
    if (!(target instanceof HTMLInputElement)) return;
    if (target === wrong) clearError();
    wrong = target.checkValidity() ? null : target;
    if (wrong) showError(new ServerError(0, `${target.labels?.[0]?.textContent ?? target.ariaLabel}: ${target.validationMessage}`));
  });
  address.addEventListener("restore", () => {
    dialect.restore();
    see.restore();
    invert.restore();
    source.restore();
    fit.restore();
    show();
  });
  // so that the links to the views have the state
  address.set({ preset: dialect.value.preset, ...dialect.value.settings });
  if (innerWidth < 640) element("parameters", HTMLDetailsElement).open = false;
  element("version", HTMLElement).textContent = about.version;
  element("page", HTMLElement).hidden = false;
  show();
  fold();
  document.body.dataset.ready = "true";
}

const about = await waiting("start-progress", "Starting", (signal) => getJson("api/about", signal));
if (about) start(about);
else if (!element("alert", HTMLElement).textContent) showError("The start was cancelled: load the page again.");
