for (const place of document.querySelectorAll(".wipe")) wipe(place);
const compared = (x, y, numeric, down) => {
  if (numeric && (x === "" || y === "")) return (x === "") - (y === "");  // what is missing comes last
  return (down ? -1 : 1) * (numeric ? x - y : x.localeCompare(y));
};
for (const table of document.querySelectorAll("table:not(.grid)")) {
  table.querySelectorAll("thead th").forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const numeric = head.classList.contains("number");
      const down = head.getAttribute("aria-sort") ? head.getAttribute("aria-sort") === "ascending" : numeric;
      table.querySelectorAll("thead th").forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      for (const body of table.tBodies) {  // the rows of a group stay together
        const rows = [...body.rows].filter((row) => !row.classList.contains("group"));
        const key = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
        rows.sort((a, b) => compared(key(a), key(b), numeric, down));
        body.append(...rows);
      }
    });
  });
}
for (const region of document.querySelectorAll(".table, .drawings figure")) {
  const hint = document.createElement("p");
  hint.className = "hint";
  hint.textContent = "More to the right: scroll or swipe.";
  region.after(hint);
  new ResizeObserver(() => region.classList.toggle("wide", region.scrollWidth > region.clientWidth + 1)).observe(region);
}
