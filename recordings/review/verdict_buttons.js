const table = document.getElementById("cycles");
if (table) {
  const file = document.getElementById("verdict-file");
  const author = document.getElementById("author");
  const ask = document.getElementById("ask");
  const text = document.getElementById("ask-text");
  const buttons = document.getElementById("verdict-buttons");
  const before = file.value;
  const given = new Map();
  let saved = true;
  const numberOf = (row) => row.cells[0].textContent;
  const idOf = (row) => row.querySelector(".day code").textContent;
  // what a TOML basic string may not hold is written by its number
  const quoted = (value) => '"' + value.replace(/["\\]/g, "\\$&").replace(
    /[\u0000-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff]/g,
    (c) => "\\u" + c.charCodeAt(0).toString(16).padStart(4, "0")) + '"';
  const block = (row, verdict) => {
    const lines = ["[[cycle]]", "id = " + quoted(idOf(row))];
    if (verdict.reject) lines.push("reject = true");
    for (const [key, value] of Object.entries(verdict.texts)) if (value) lines.push(key + " = " + quoted(value));
    lines.push("author = " + quoted(author.value.trim()), "time = " + verdict.time);
    return lines.join("\n") + "\n";
  };
  const write = () => {
    const blocks = [...given].map(([row, verdict]) => block(row, verdict));
    file.value = (before ? [before] : []).concat(blocks).join("\n");
  };
  const verdictOf = (row) => {
    if (given.has(row)) return given.get(row);
    const { reject = false, ...texts } = JSON.parse(row.dataset.verdict || "{}");
    return { reject, texts };
  };
  const give = (row, verdict) => {
    verdict.time = new Date().toISOString().slice(0, 19) + "Z";
    given.delete(row);
    given.set(row, verdict);
    saved = false;
    row.classList.add("given");
    row.querySelector("[data-act=reject]").setAttribute("aria-pressed", verdict.reject);
    row.classList.toggle("struck", verdict.reject);
    row.querySelector(".note").textContent = "to be saved: " + (["product", "note"].map((key) => verdict.texts[key]).filter(Boolean).join(": ") || (verdict.reject ? "rejected" : "not rejected"));
    write();
    said.textContent = "cycle " + numberOf(row) + (verdict.reject ? " rejected" : " noted") + ": not saved yet, see Your verdict below";
  };
  const askFor = (row, key) => {
    const verdict = verdictOf(row);
    document.getElementById("ask-name").textContent = key + " of cycle " + numberOf(row);
    text.value = verdict.texts[key] || "";
    ask.onclose = () => {
      if (ask.returnValue === "ok") give(row, { ...verdict, texts: { ...verdict.texts, [key]: text.value.trim() } });
      ask.returnValue = "";
    };
    ask.showModal();
  };
  for (const row of table.tBodies[0].rows) {
    row.querySelector(".verdict").append(buttons.content.cloneNode(true));
    row.querySelector("[data-act=reject]").setAttribute("aria-pressed", verdictOf(row).reject);
    const command = row.querySelector(".command");
    const copy = document.createElement("button");
    copy.type = "button";
    copy.className = "copy";
    copy.append(...command.childNodes);
    command.append(copy);
  }
  table.addEventListener("click", (event) => {
    const button = event.target.closest("button[data-act]");
    if (!button) return;
    const row = button.closest("tr");
    const verdict = verdictOf(row);
    if (button.dataset.act === "reject") give(row, { ...verdict, reject: !verdict.reject });
    else askFor(row, button.dataset.act);
  });
  const signed = () => {
    if (author.value.trim()) return true;
    author.focus();
    said.textContent = "a verdict has an author: write your name first";
    return false;
  };
  author.addEventListener("input", write);
  document.getElementById("save").addEventListener("click", () => {
    if (!signed()) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([file.value], { type: "application/toml" }));
    link.download = "verdicts.toml";
    link.click();
    URL.revokeObjectURL(link.href);
    saved = true;
    said.textContent = "saved: move verdicts.toml into the folder of this page";
  });
  document.getElementById("copy-file").addEventListener("click", async (event) => {
    if (!signed()) return;
    saved = await copyText(file.value, event.target);
    said.textContent = saved ? "copied: verdicts.toml" : "cannot copy here: select the text";
  });
  window.addEventListener("beforeunload", (event) => {
    if (!saved) event.preventDefault();
  });
}
