// Elements made by script, for the page and for reports: texts are always text, so that no name can become markup.
{
const h = (tag, attributes = {}, ...children) => {
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

const put = (parent, ...children) => {
  parent.replaceChildren(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return parent;
};

let fields = 0;
const field = (label, control, hint = "") => {
  control.id ||= `field-${(fields += 1)}`;
  const notes = hint ? h("div", { class: "hint", id: `${control.id}-hint` }, hint) : null;
  if (notes) control.setAttribute("aria-describedby", notes.id);
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, notes);
};

const choice = (options, value, onchange) => {
  const control = h("select", { onchange: (event) => onchange?.(event.target.value) });
  for (const option of options) {
    const [key, text] = Array.isArray(option) ? option : [option, option];
    control.append(h("option", { value: key, selected: key === value }, text));
  }
  return control;
};

const button = (text, onclick, kind = "", more = {}) => h("button", { type: "button", class: kind, onclick, ...more }, text);

const number = (value, digits = 3) => (value === null || value === undefined || Number.isNaN(value) ? "–" : Number(Number(value).toPrecision(digits)).toLocaleString("en", { maximumFractionDigits: 6 }));

globalThis.rigElements = { h, put, field, choice, button, number };
}
