/**
 * Lets a reader wipe from one picture to another of the same size.
 *
 * @param {HTMLElement} place a figure of the class `wipe` with both pictures in a `div`, and a slider in per cent
 */
export function wipe(place) {
  const range = place.querySelector("input");
  const pictures = place.querySelector("div");
  if (!range || !pictures) return;
  const show = () => place.style.setProperty("--at", `${range.value}%`);
  const drag = (/** @type {PointerEvent} */ event) => {
    const box = pictures.getBoundingClientRect();
    range.value = String(100 * (event.clientX - box.left) / box.width);
    show();
  };
  range.addEventListener("input", show);
  pictures.addEventListener("pointerdown", drag);
  pictures.addEventListener("pointermove", (event) => { if (event.buttons) drag(event); });
  show();
}
