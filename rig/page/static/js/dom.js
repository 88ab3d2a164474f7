// Elements made by script: texts are always text, so that no name can become markup.

export const h = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
};

export const put = (parent, ...children) => {
  parent.replaceChildren(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return parent;
};

let fields = 0;
export const field = (label, control, hint = "") => {
  control.id ||= `field-${(fields += 1)}`;
  const notes = hint ? h("div", { class: "hint", id: `${control.id}-hint` }, hint) : null;
  if (notes) control.setAttribute("aria-describedby", notes.id);
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, notes);
};

export const tick = (label, checked, onchange) =>
  h("label", { class: "tick" }, h("input", { type: "checkbox", checked, onchange: (event) => onchange?.(event.target.checked) }), label);

export const choice = (options, value, onchange) => {
  const control = h("select", { onchange: (event) => onchange?.(event.target.value) });
  for (const option of options) {
    const [key, text] = Array.isArray(option) ? option : [option, option];
    control.append(h("option", { value: key, selected: key === value }, text));
  }
  return control;
};

export const button = (text, onclick, kind = "", more = {}) => h("button", { type: "button", class: kind, onclick, ...more }, text);

export const chip = (kind, text) => h("span", { class: `chip ${kind}` }, text);

export const number = (value, digits = 3) => (value === null || value === undefined || Number.isNaN(value) ? "–" : Number(Number(value).toPrecision(digits)).toLocaleString("en", { maximumFractionDigits: 6 }));

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
