"use strict";
// Tables are saved as CSV and pictures are enlarged without anything from outside of this file.
for (const box of document.querySelectorAll("div.table")) {
  const table = box.querySelector("table");
  if (!table.tHead) continue;
  const link = document.createElement("a");
  link.className = "save";
  link.textContent = "save as CSV";
  link.href = "#";
  link.addEventListener("click", () => {
    const cell = (c) => '"' + c.innerText.replace(/[\u00a0\u2009]/g, " ").replace(/\u2212/g, "-").replace(/"/g, '""') + '"';
    const rows = [...table.rows].map((row) => [...row.cells].map(cell).join(","));
    link.href = URL.createObjectURL(new Blob(["\ufeff" + rows.join("\r\n") + "\r\n"], { type: "text/csv" }));
    link.download = (box.dataset.name || "table") + ".csv";
  });
  table.caption.append(" ", link);
}
const sheet = document.createElement("dialog");
sheet.className = "enlarged";
sheet.addEventListener("click", () => sheet.close());
document.body.append(sheet);
for (const image of document.querySelectorAll("figure img")) {
  image.title = "Click to enlarge";
  image.addEventListener("click", () => {
    const copy = image.cloneNode();
    copy.removeAttribute("title");
    sheet.replaceChildren(copy);
    sheet.showModal();
  });
}
