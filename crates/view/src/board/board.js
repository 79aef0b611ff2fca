// Sorts the rows by the column whose head is clicked, and shows one group of columns at a time.
(() => {
  "use strict";
  const table = document.getElementById("board"), body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];

  function rank() {
    [...body.rows].forEach((row, k) => { row.cells[0].textContent = k + 1; });
  }

  function value(row, column) {
    const cell = row.cells[column];
    if ("value" in cell.dataset) return cell.dataset.value === "" ? NaN : Number(cell.dataset.value);
    return cell.tagName === "TH" ? cell.querySelector("summary").textContent : cell.textContent;
  }

  // What has no value comes last whichever way round.
  function compare(a, b, down) {
    if (typeof a === "string") return (down ? -1 : 1) * a.localeCompare(b);
    if (Number.isNaN(a) || Number.isNaN(b)) return Number.isNaN(a) - Number.isNaN(b);
    return down ? b - a : a - b;
  }

  function sort(column) {
    const head = heads[column], now = head.getAttribute("aria-sort");
    const first = head.dataset.better === "high" ? "descending" : "ascending";
    const order = now === null ? first : now === "descending" ? "ascending" : "descending";
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", order);
    const rows = [...body.rows].map((row) => [value(row, column), row]);
    rows.sort(([a], [b]) => compare(a, b, order === "descending"));
    body.append(...rows.map(([, row]) => row));
    rank();
  }

  function show(group) {
    document.querySelectorAll("[data-group]").forEach((button) => {
      button.setAttribute("aria-pressed", button.dataset.group === group);
    });
    table.dataset.shown = group;
  }

  heads.forEach((head, column) => head.querySelector("button")?.addEventListener("click", () => sort(column)));
  document.querySelectorAll("[data-group]").forEach((button) => {
    button.addEventListener("click", () => show(button.dataset.group));
  });
  document.body.classList.add("scripted");
  show("crowds");
  rank();
})();
