// What a person sees and does. Texts of a bundle are set as text, never as HTML.

const byId = (id) => document.getElementById(id);

/** An element with texts and other elements in it. */
const element = (tag, attributes = {}, ...inside) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...inside);
  return made;
};

const tableView = (caption, heads, rows, numeric = []) => {
  const cell = (text, k) => element(k ? "td" : "th", { ...(k ? {} : { scope: "row" }), ...(numeric.includes(k) ? { class: "n" } : {}) }, text);
  return element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    element("table", {}, element("caption", {}, caption),
      element("thead", {}, element("tr", {}, ...heads.map((head, k) => element("th", { scope: "col", ...(numeric.includes(k) ? { class: "n" } : {}) }, head)))),
      element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map(cell))))));
};

const VERDICTS = {
  tampered: "Tampered: something here is not as it was written",
  incomplete: "Incomplete: something is missing",
  irreproducible: "Irreproducible: the readings give other numbers",
  expired: "Expired: what this page checks holds, and its last day is over",
};

const verdictText = ({ worst, signature }) => {
  if (worst) return VERDICTS[worst];
  return signature.trusted
    ? "Holds: digests, signature and every number that this page computes"
    : "Contradicts itself nowhere, and nobody whom you know vouches for it";
};

const same = (values) => (new Set(values).size === 1 ? "same" : "DIFFERENT");

const numbersView = ({ computed, facts, budget, none }) => {
  if (!computed) {
    const rows = (facts ?? []).map(([name, own, , page]) => [name, own, page === own ? "same" : "DIFFERENT"]);
    return [element("p", {}, none), ...(rows.length ? [tableView("From the readings", ["", "computed here", "in report.html"], rows)] : [])];
  }
  const [first, second, third] = computed.covariance.map((value) => value.toPrecision(6));
  const heads = ["computed here", "evidence.json", "report.html", ""];
  return [
    tableView("The result, from the readings", ["", ...heads], facts.map(([name, ...values]) => [name, ...values, same(values)])),
    element("p", { class: "quiet" }, `Covariance of the line's intercept and slope, computed here: ${first} kg², ${second} kg, ${third}; ` +
      `χ² ${computed.chi2_1.toPrecision(6)} of ${computed.freedom} degrees of freedom. Every number of the fit is compared with evidence.json to 1 in 10⁶.`),
    tableView("The uncertainty budget, u in kg", ["component", ...heads], budget.map(([name, ...values]) => [name, ...values, same(values)]), [1, 2, 3]),
  ];
};

const show = (found) => {
  const { findings, files, signature, evidence } = found;
  const good = !found.worst && signature.trusted;
  const fresh = element("div", {},
    element("h2", {}, "Result"),
    element("p", { id: "verdict", class: good ? "good" : found.worst && found.worst !== "expired" ? "alarm" : "warning" }, verdictText(found)),
    element("p", { id: "signed" }, `${signature.text}.`));
  if (signature.keyId) {
    fresh.append(element("p", {}, "Fingerprint of the key (SHA-256): ", element("code", {}, signature.keyId),
      `. Compare it with what the signer told you through another channel. Checked by ${signature.by}.`));
  }
  if (findings.length) {
    fresh.append(element("h2", {}, "What is wrong"), element("ul", { id: "findings" },
      ...findings.map(({ kind, item, what }) => element("li", {}, element("strong", {}, `${kind}: `), `${item}: ${what}`))));
  }
  if (evidence) {
    const { campaign, chain } = evidence;
    const about = [["machine", campaign?.machine?.id], ["evidence", evidence.id], ["made", evidence.made], ["expires", evidence.expires],
      ["number in the chain", chain?.counter], ["made with", `payscope ${evidence.software?.payscope}`]];
    fresh.append(element("h2", {}, "What it says it is"), element("dl", {},
      ...about.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value ?? "–"))])));
  }
  fresh.append(element("h2", {}, "Numbers"), ...numbersView(found.numbers),
    element("h2", {}, "Files"), tableView("SHA-256 of each file, computed here", ["file", "SHA-256", `against ${SUMS}`], files));
  fresh.querySelectorAll("td").forEach((cell) => { if (cell.textContent === "DIFFERENT") cell.className = "apart"; });
  byId("result").replaceChildren(fresh);
};

const fail = (fault) => {
  byId("state").textContent = "Not checked.";
  byId("result").replaceChildren(element("h2", {}, "Result"),
    element("p", { id: "verdict", class: "alarm" }, `Not checked: ${fault instanceof Fault ? fault.message : `the files cannot be read (${fault.message})`}.`));
};

/** The bundle that was given last; checked again when the key changes. */
let held = null;
/** Counts what was asked for: an answer that is overtaken is not shown. */
let asked = 0;

const today = () => {
  const now = new Date();
  return [now.getFullYear(), now.getMonth() + 1, now.getDate()].map((part) => String(part).padStart(2, "0")).join("-");
};

const checkHeld = async () => {
  if (held === null) return;
  const files = held, mine = (asked += 1);
  byId("state").textContent = "Checking …";
  // the word is drawn before the work begins
  await new Promise((resolve) => { setTimeout(resolve, 20); });
  try {
    const found = await checkBundle(files, keyOf(byId("key").value), today());
    if (mine !== asked) return;
    show(found);
    byId("state").textContent = `Checked ${files.size} files.`;
  } catch (fault) {
    if (mine === asked) fail(fault);
  }
};

const take = async (collect) => {
  held = null;
  const mine = (asked += 1);
  byId("state").textContent = "Reading …";
  byId("result").replaceChildren();
  try {
    const files = await bundleOf(await collect());
    if (mine !== asked) return;
    held = files;
    await checkHeld();
  } catch (fault) {
    if (mine === asked) fail(fault);
  }
};

const picked = (input) => [...input.files].map((file) => [file.webkitRelativePath || file.name, file]);

for (const id of ["folder", "files"]) {
  byId(id).addEventListener("change", (event) => {
    const files = picked(event.target);
    event.target.value = "";
    if (files.length) take(async () => files);
  });
}
byId("key").addEventListener("input", checkHeld);
byId("keyfile").addEventListener("change", async (event) => {
  const [file] = event.target.files;
  if (file) byId("key").value = file.size < 16384 ? await file.text() : "too large to be a key";
  event.target.value = "";
  checkHeld();
});

const drop = byId("drop");
// dropped beside the field, a browser would open the file in this window
for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
drop.addEventListener("dragover", () => drop.classList.add("over"));
drop.addEventListener("dragleave", () => drop.classList.remove("over"));
drop.addEventListener("drop", (event) => {
  drop.classList.remove("over");
  // entries are gone once the event is over, so they are taken at once
  const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
  take(async () => {
    const found = [];
    for (const entry of entries) await walkEntries(entry, "", found);
    return found;
  });
});
