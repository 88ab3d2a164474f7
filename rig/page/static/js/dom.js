// Elements made by script: those that reports know, too, and some more.
import "../scene/elements.js";

export const { h, put, field, choice, button, number } = globalThis.rigElements;

export const tick = (label, checked, onchange) =>
  h("label", { class: "tick" }, h("input", { type: "checkbox", checked, onchange: (event) => onchange?.(event.target.checked) }), label);

export const chip = (kind, text) => h("span", { class: `chip ${kind}` }, text);

export const ago = (text) => {
  const minutes = (Date.now() - new Date(text).getTime()) / 60000;
  if (!(minutes >= 0)) return "";
  if (minutes < 1) return "just now";
  if (minutes < 90) return `${Math.round(minutes)} min ago`;
  return minutes < 2880 ? `${Math.round(minutes / 60)} h ago` : `${Math.round(minutes / 1440)} days ago`;
};

export const toast = (text, kind = "") => {
  const box = h("div", { class: `toast ${kind}` }, text, button("×", () => box.remove(), "quiet icon", { "aria-label": "Close" }));
  document.getElementById("toasts").append(box);
  setTimeout(() => box.remove(), kind === "fine" ? 5000 : 20000);
};

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// A canvas as sharp as the screen: calls draw(context, width, height) in CSS pixels.
export const draw = (canvas, paint) => {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  paint(context, width, height);
};

// A table with a button that copies it: cells in quotes where they need them.
export const csvOf = (table) => [...table.rows].map((row) => [...row.cells].map((cell) => cell.innerText.replace(/\s+/g, " ").trim())
  .map((text) => (/[",]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text)).join(",")).join("\n");
export const copyable = (table) => h("div", {}, table, button("Copy as CSV", async () => {
  try {
    await navigator.clipboard.writeText(csvOf(table));
    toast("The table is copied", "fine");
  } catch {
    keepFile(new Blob([csvOf(table)], { type: "text/csv" }), "table.csv");
  }
}, "quiet"));

export const keepFile = (blob, name) => {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};
export const saveButton = (canvas, name) => button("Save picture", () => canvas.toBlob((blob) => blob && keepFile(blob, `${name}.png`)), "quiet");
