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
