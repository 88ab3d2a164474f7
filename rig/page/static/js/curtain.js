// Two pictures of a session behind one curtain, or their difference, with the numbers under the pointer.
import { bytes, get, trying } from "./api.js";
import { button, choice, field, h, number, put, saveButton } from "./dom.js";
import { levelsOf } from "./look.js";

const ERROR_RANGE = 64; // grey levels at the ends of the colours, as in the report
// As in the report on a light page; dark where nothing is wrong on a dark one, which must not light the scene.
const RAMPS = {
  light: [[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]],
  dark: [[120, 180, 255], [42, 92, 160], [20, 22, 26], [160, 66, 38], [255, 138, 92]],
};
const SHOWN = Uint8ClampedArray.from({ length: 256 }, (_, k) => 255 * (k / 255) ** (1 / 2.2));

const coloured = (error) => {
  const ramp = RAMPS[document.documentElement.dataset.light];
  const place = (Math.min(Math.max(error / ERROR_RANGE, -1), 1) + 1) * 2;
  const k = Math.min(Math.floor(place), 3);
  return ramp[k].map((low, band) => low + (ramp[k + 1][band] - low) * (place - k));
};

export const compareView = (body, name, place) => {
  const canvas = h("canvas", { id: "curtain", class: "pixels", "aria-label": "Two pictures behind a curtain" });
  const line = h("div", { class: "line" });
  const names = [h("span", { class: "name a" }), h("span", { class: "name b" })];
  const view = h("div", { class: "view" }, canvas, line);
  const stage = h("div", { class: "stage curtain" }, view, names);
  const slide = h("input", { type: "range", min: 0, max: 1000, value: 500, "aria-label": "Curtain", oninput: () => paint() });
  const says = h("dl", { class: "figures", id: "under" });
  const pictures = new Map();
  const chosen = { a: "target", b: "measured-bounded", mode: "curtain" };
  const scale = h("div", { class: "scale", hidden: true }, "64 too dark", h("i", {}), "64 too bright");
  let list = [];

  const load = async (key) => {
    if (!pictures.has(key)) pictures.set(key, levelsOf(await bytes(`/api/sessions/${name}/levels/${key}`)));
    return pictures.get(key);
  };
  const use = (key, which) => trying(async () => { await Promise.all([load(which), load("mask")]); chosen[key] = which; paint(); });
  const modes = h("div", { class: "row" }, [["curtain", "Curtain"], ["error", "Difference"]].map(([key, text]) => button(text, () => { chosen.mode = key; paint(); }, "", { "data-mode": key })));

  const paint = () => {
    const [a, b, mask] = [pictures.get(chosen.a), pictures.get(chosen.b), pictures.get("mask")];
    if (!a || !b || !mask) return;
    Object.assign(canvas, { width: a.width, height: a.height });
    view.style.setProperty("--ratio", String(a.width / a.height));
    const context = canvas.getContext("2d");
    const image = context.createImageData(a.width, a.height);
    const isError = chosen.mode === "error";
    const edge = Math.round((a.width * slide.value) / 1000);
    for (let y = 0, k = 0; y < a.height; y += 1) {
      for (let x = 0; x < a.width; x += 1, k += 4) {
        const isJudged = (mask.value(x, y) ?? 0) > 0;
        let rgb;
        if (isError) rgb = isJudged ? coloured(mean(b, x, y) - mean(a, x, y)) : [58, 60, 66];
        else rgb = shades(x < edge ? a : b, x, y, isJudged);
        image.data.set([rgb[0], rgb[1], rgb[2], 255], k);
      }
    }
    context.putImageData(image, 0, 0);
    line.hidden = isError;
    line.style.left = `${slide.value / 10}%`;
    names[0].textContent = isError ? `${titleOf(chosen.b)} minus ${titleOf(chosen.a)}` : titleOf(chosen.a);
    names[1].textContent = isError ? "" : titleOf(chosen.b);
    names[1].hidden = isError;
    scale.hidden = !isError;
    for (const one of modes.children) one.setAttribute("aria-pressed", String(one.dataset.mode === chosen.mode));
    tell(null);
  };
  const titleOf = (key) => list.find((one) => one.name === key)?.title ?? key;
  const mean = (of, x, y) => {
    let sum = 0;
    for (let band = 0; band < of.bands; band += 1) sum += of.value(x, y, band) ?? 0;
    return sum / of.bands;
  };
  const shades = (of, x, y, isJudged) => [0, 1, 2].map((band) => SHOWN[Math.min(255, Math.max(0, Math.round(of.value(x, y, Math.min(band, of.bands - 1)) ?? 0)))] / (isJudged ? 1 : 3));
  const pixelAt = (event) => {
    const box = view.getBoundingClientRect();
    const x = Math.floor(((event.clientX - box.left) / box.width) * canvas.width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * canvas.height);
    return x >= 0 && y >= 0 && x < canvas.width && y < canvas.height ? [x, y] : null;
  };
  const tell = (pixel) => {
    const [a, b, mask] = [pictures.get(chosen.a), pictures.get(chosen.b), pictures.get("mask")];
    const row = (title, value) => h("div", {}, h("dt", {}, title), h("dd", {}, value));
    if (!pixel) {
      let [count, sum, squares, bias] = [0, 0, 0, 0];
      for (let y = 0; y < a.height; y += 1) for (let x = 0; x < a.width; x += 1) if ((mask.value(x, y) ?? 0) > 0) {
        const error = mean(b, x, y) - mean(a, x, y);
        count += 1; sum += Math.abs(error); squares += error * error; bias += error;
      }
      put(says, row("Mean difference", number(sum / count)), row("rms", number(Math.sqrt(squares / count))), row("Bias", number(bias / count)), row("Judged pixels", count.toLocaleString("en")));
      return;
    }
    const [x, y] = pixel;
    put(says, row("Pixel", `${x}, ${y}`), row(titleOf(chosen.a), number(mean(a, x, y))), row(titleOf(chosen.b), number(mean(b, x, y))), row("Difference", number(mean(b, x, y) - mean(a, x, y))), row("Judged", (mask.value(x, y) ?? 0) > 0 ? "yes" : "no"));
  };
  let isHeld = false;
  const move = (event) => {
    const pixel = pixelAt(event);
    if (isHeld && chosen.mode === "curtain") {
      const box = view.getBoundingClientRect();
      slide.value = (1000 * (event.clientX - box.left)) / box.width;
      paint();
    }
    if (pictures.size) tell(pixel);
  };
  stage.addEventListener("pointerdown", (event) => { isHeld = true; stage.setPointerCapture(event.pointerId); move(event); });
  stage.addEventListener("pointerup", () => { isHeld = false; });
  stage.addEventListener("pointermove", move);
  stage.addEventListener("pointerleave", () => pictures.size && tell(null));

  trying(async () => {
    const detail = await get(`/api/sessions/${name}`);
    put(place, h("div", { class: "row between" }, h("h1", {}, name)), h("p", { class: "soft" }, "Target, predicted and measured pictures on the camera's pixels, in one scale of grey levels."));
    list = detail.pictures;
    if (!list.length) return put(body, h("p", { class: "empty" }, "Pictures can be put side by side when the session is compared."));
    const options = list.filter((one) => one.name !== "mask").map((one) => [one.name, one.title]);
    if (!options.some(([key]) => key === chosen.b)) chosen.b = options[1]?.[0] ?? "target";
    put(body, h("div", { class: "split" }, h("div", {}, stage, slide, says), h("div", { class: "card" },
      field("Left", choice(options, chosen.a, (key) => use("a", key))), field("Right", choice(options, chosen.b, (key) => use("b", key))), modes, saveButton(canvas, `${name}-comparison`), scale,
      h("p", { class: "soft" }, "Drag over the picture, or use the slider and its arrow keys. Outside the judged pixels the pictures are dim."))));
    await Promise.all([load(chosen.a), load(chosen.b), load("mask")]);
    return paint();
  });
  return { key: (event) => {
    const by = { ArrowLeft: -25, ArrowRight: 25 }[event.key];
    if (by) { slide.value = Number(slide.value) + by; paint(); event.preventDefault(); }
  } };
};
