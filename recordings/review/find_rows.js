const find = document.getElementById("find");
if (find) {
  const cycles = document.getElementById("cycles");
  const rows = [...cycles.tBodies[0].rows];
  const DAY_S = 86400;
  const localTime = (row) => row.querySelector(".day").firstChild.data;
  const secondOfDay = (text) => {
    const found = /(\d\d):(\d\d)(?::(\d\d))?/.exec(text);
    return 3600 * found[1] + 60 * found[2] + Number(found[3] || 0);
  };
  const words = (row) => [" " + localTime(row), ...[...row.querySelectorAll(".quality, .said")].map((cell) => cell.textContent)].join(" ").toLowerCase();
  const dumpedS = (row) => Number(row.querySelector(".day").dataset.v);
  const begunS = new Map(rows.map((row, at) => [row, at ? dumpedS(rows[at - 1]) : Number(cycles.dataset.t0)]));
  // at a time at which nothing was dumped, the cycle that came next was under way
  const underWay = (time) => rows.filter((row) => (secondOfDay(localTime(row)) - secondOfDay(time) + DAY_S) % DAY_S <= dumpedS(row) - begunS.get(row));
  find.addEventListener("input", () => {
    const wanted = find.value.trim().toLowerCase();
    const time = /^\d{1,2}:\d\d(:\d\d)?$/.test(wanted) ? wanted.padStart(wanted.length + (wanted.indexOf(":") === 1), "0") : "";
    const sought = time ? " " + time : wanted;
    const isHit = /^\d+$/.test(wanted) ? (row) => row.cells[0].textContent === wanted : (row) => words(row).includes(sought);
    let hits = rows.filter(isHit);
    if (time && !hits.length) hits = underWay(time);
    for (const row of rows) row.hidden = wanted !== "" && !hits.includes(row);
    said.textContent = wanted ? hits.length + " of " + rows.length + " cycles" : "";
  });
}
