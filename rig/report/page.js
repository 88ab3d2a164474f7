// Pictures enlarge and can be saved, tables are copied as CSV: without any other file, also from file://.
const nameOf = (text) => text.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 60) || "picture";
const endingOf = (source) => (/^data:image\/(png|jpeg|svg)/.exec(source) || [, "png"])[1];

const button = (words, act) => {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = words;
  made.addEventListener("click", (event) => { event.stopPropagation(); act(made); });
  return made;
};

const save = (img) => {
  const link = document.createElement("a");
  link.href = img.src;
  link.download = `${nameOf(img.alt)}.${endingOf(img.src)}`;
  document.body.append(link);
  link.click();
  link.remove();
};

// A picture that is clicked, or chosen by key, fills the window until the next click or key.
const shown = document.createElement("div");
shown.className = "shown";
shown.setAttribute("role", "dialog");
let returnTo = null;
const hide = () => {
  if (!shown.isConnected) return;
  shown.remove();
  if (returnTo) returnTo.focus();
};
shown.addEventListener("click", hide);
const show = (img) => {
  const large = new Image();
  large.src = img.src;
  large.alt = img.alt;
  const words = document.createElement("p");
  words.textContent = img.alt;
  const saving = button("Save picture", () => save(img));
  shown.setAttribute("aria-label", img.alt);
  shown.replaceChildren(large, words, saving);
  document.body.append(shown);
  returnTo = img;
  saving.focus({ preventScroll: true });
};
for (const img of document.querySelectorAll("main img:not(.scale)")) {
  img.tabIndex = 0;
  img.title = img.alt;
  img.setAttribute("role", "button");
  img.addEventListener("click", () => show(img));
  img.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.stopPropagation(); show(img); } });
}
document.addEventListener("keydown", (event) => {
  const onButton = event.target instanceof HTMLButtonElement && ["Enter", " ", "Tab", "Shift"].includes(event.key);
  if (!onButton) hide();
});

// One line a row; a cell with a comma, a quotation mark or a line's end is quoted (RFC 4180).
const cell = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
const csvOf = (table) => [...table.rows].map((row) => [...row.cells].map((one) => cell(one.textContent.trim())).join(",")).join("\n") + "\n";

const copy = async (text) => {
  try {
    await navigator.clipboard.writeText(text);
  } catch {  // browsers that keep the clipboard from files
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    if (!done) throw new Error("the browser refuses");
  }
};
for (const table of document.querySelectorAll("main table")) {
  const copying = button("Copy as CSV", async (made) => {
    try {
      await copy(csvOf(table));
      made.textContent = "Copied";
    } catch {
      made.textContent = "The browser does not allow it";
    }
    setTimeout(() => { made.textContent = "Copy as CSV"; }, 2000);
  });
  copying.className = "copy";
  table.after(copying);
}
