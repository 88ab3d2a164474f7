// A profile's numbers as a form: one field a line of the text, with its unit, the file's own remark, and what it means.
import { field, h, put } from "./dom.js";

const UNITS = { s: "s", m: "m", px: "px", hz: "Hz", deg: "°", e: "electrons", dn: "digital numbers", mm: "mm", share: "share", percent: "%" };
const LINE = /^(\s*([A-Za-z_]\w*)\s*=\s*)(-?[\d.]+(?:e[-+]?\d+)?)(\s*(?:#\s*(.*))?)$/i;
const TABLE = /^\s*\[+\s*([^\]]+?)\s*\]+/;

const unitOf = (key) => UNITS[key.split("_").at(-1)] ?? "";

export const numbersOf = (text) => {
  let table = "";
  const found = [];
  text.split("\n").forEach((line, at) => {
    table = line.match(TABLE)?.[1] ?? table;
    const parts = line.match(LINE);
    if (parts) found.push({ at, table, key: parts[2], value: parts[3], remark: parts[5] ?? "" });
  });
  return found;
};

// The text with another number in one of its lines; everything else of the line stays.
export const withNumber = (text, at, value) => {
  const lines = text.split("\n");
  lines[at] = lines[at].replace(LINE, (_, before, _key, _old, after) => before + value + after);
  return lines.join("\n");
};

// Fields for a text area; onChange() is called after each change of it. What the truth of a simulation is, is no setting.
export const numberForm = (text, meanings, onChange) => {
  const place = h("div", { id: "profile-numbers" });
  const fill = () => {
    const groups = new Map();
    for (const one of numbersOf(text.value)) {
      if (one.table.startsWith("simulation")) continue;
      groups.set(one.table, [...(groups.get(one.table) ?? []), one]);
    }
    put(place, [...groups].map(([table, rows]) => h("details", { open: table === "camera" || table === "projector" }, h("summary", {}, table || "profile"), h("div", { class: "grid" }, rows.map((one) => {
      const control = h("input", { type: "number", step: "any", value: one.value, "data-key": `${one.table}.${one.key}`, onchange: () => {
        if (control.value === "") return;
        text.value = withNumber(text.value, one.at, control.value);
        onChange();
      } });
      const unit = unitOf(one.key);
      return field(unit ? `${one.key} [${unit}]` : one.key, control, meanings[one.key] ?? one.remark);
    })))));
  };
  return { place, fill };
};
