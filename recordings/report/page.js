"use strict";
const said = document.getElementById("said");
const key = (row, at) => {
  const cell = row.cells[at];
  const text = cell.dataset.v === undefined ? cell.textContent : cell.dataset.v;
  if (text === "" || text === "–") return NaN;
  const number = Number(text.replaceAll(",", ""));
  return Number.isNaN(number) ? text : number;
};
const order = (a, b) => {
  if (Number.isNaN(a) || Number.isNaN(b)) return Number.isNaN(a) - Number.isNaN(b);
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b));
};
const sort = (head) => {
  const table = head.closest("table");
  const up = head.getAttribute("aria-sort") !== "ascending";
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const rows = [...table.tBodies[0].rows];
  const at = head.cellIndex;
  rows.sort((a, b) => {
    const x = key(a, at), y = key(b, at);
    // rows without a number stay below
    const way = Number.isNaN(x) || Number.isNaN(y) || up ? 1 : -1;
    return way * order(x, y);
  });
  table.tBodies[0].append(...rows);
  said.textContent = "sorted by " + head.textContent + (up ? ", least first" : ", most first");
};
const copied = (text) => {
  const field = document.createElement("textarea");
  field.value = text;
  document.body.append(field);
  field.select();
  const done = document.execCommand("copy");
  field.remove();
  return done;
};
const copyText = async (text, button) => {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const done = copied(text);
    button.focus();
    return done;
  }
};
const copy = async (button) => {
  const text = button.textContent;
  const done = await copyText(text, button);
  said.textContent = done ? "copied: " + text : "cannot copy here: select the text";
};
for (const table of document.querySelectorAll("table.sorted")) {
  table.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    if (button.classList.contains("copy")) copy(button);
    else if (button.closest("thead")) sort(button.parentNode);
  });
}
