// Look: the camera as it is now, and what the projector shows it.
import { bytes, get, isRunning, known, on, order, start, stop, trying, upload } from "./api.js";
import { button, colour, draw, field, h, number, put, saveButton } from "./dom.js";
import { Frames } from "./frames.js";

const STOP = 2 ** (1 / 3);
const ZOOMS = [1, 2, 4, 8, 16, 32];

export const lookView = (main) => {
  const kept = JSON.parse(sessionStorage.getItem("rig-look") ?? "{}");
  const keep = (what) => sessionStorage.setItem("rig-look", JSON.stringify(Object.assign(kept, what)));
  const canvas = h("canvas", { "aria-label": "The camera's view" });
  const marks = h("canvas", { class: "marks" });
  const thirds = h("div", { class: "thirds", "aria-hidden": "true" });
  const at = h("div", { class: "at", hidden: true });
  const hint = h("p", { class: "hint" });
  const view = h("div", { class: "view" }, canvas, marks, thirds);
  const stage = h("div", { class: "stage", tabindex: "0" }, view, at, hint);
  const figures = h("dl", { class: "figures" });
  const histogram = h("canvas", { class: "chart", role: "img", "aria-label": "Histogram of the camera's levels" });
  const trend = h("canvas", { class: "chart", role: "img", "aria-label": "Sharpness over the last minute" });
  const patterns = h("div", { class: "patterns" });
  const exposure = h("output", { class: "grow" });
  const slider = h("input", { type: "range", min: 0, max: 1000, "aria-label": "Exposure", oninput: () => expose(exposureAt(slider.value / 1000)) });
  const gain = h("output", { class: "grow" });
  const gainSlider = h("input", { type: "range", min: 0, max: 1000, "aria-label": "Gain", oninput: () => { const { least, most } = known.state.gain; amplify(least + ((most - least) * gainSlider.value) / 1000); } });
  const gainKept = h("p", { class: "soft" });
  const gainCard = h("div", { class: "card", id: "gain", hidden: true }, h("h2", {}, "Gain"), h("div", { class: "exposure" }, button("−", () => stepGain(-1), "icon", { "aria-label": "Less gain" }), gainSlider, button("+", () => stepGain(1), "icon", { "aria-label": "More gain" })), h("p", {}, "The camera does ", gain), gainKept);
  const linked = h("div", { class: "linked", hidden: true });
  const about = h("p", { class: "soft" });
  const begin = button("Look", () => toggle(), "main", { id: "look" });
  let facts = null;
  let sharp = [];
  let rates = [];
  let map = null;
  let zoom = 1;
  let middle = [0.5, 0.5];
  let delays = [];
  const wants = { overlay: kept.overlay ?? true, colour: kept.colour ?? false, focus: kept.focus ?? true };

  const profile = h("select", { id: "look-profile", onchange: () => { keep({ profile: profile.value }); linkable(); } });
  const toggles = h("div", { class: "row" },
    toggleButton("Clipping, black", "overlay", "o"), toggleButton("False colour", "colour", "v"), toggleButton("Focus by region", "focus", "r"));
  const link = h("select", { onchange: () => linkTo(link.value) });
  const own = h("input", { type: "file", accept: "image/*", onchange: () => trying(async () => {
    if (!own.files[0]) return;
    const { name } = await upload(own.files[0]);
    show(name);
  }) });

  function toggleButton(text, name, key) {
    return button(text, () => flip(name), "", { "aria-pressed": String(wants[name]), title: `Key ${key}`, "data-flip": name });
  }
  function flip(name) {
    wants[name] = !wants[name];
    keep({ [name]: wants[name] });
    main.querySelector(`[data-flip=${name}]`).setAttribute("aria-pressed", String(wants[name]));
    paintExtras();
  }
  function paintExtras() {
    canvas.classList.toggle("false", wants.colour);
    marks.hidden = !wants.overlay;
    thirds.hidden = !wants.focus || zoom > 1;
  }
  const toggle = () => (isRunning("look") ? stop() : start("look", { profile: profile.value, picture: kept.picture ?? "grid", ...(kept.exposure && kept.exposureOf === profile.value ? { exposure_s: kept.exposure } : {}) }));
  const range = () => known.state?.exposure_range_s ?? [1e-4, 1];
  const exposureAt = (share) => range()[0] * (range()[1] / range()[0]) ** share;
  const shareOf = (seconds) => Math.log(seconds / range()[0]) / Math.log(range()[1] / range()[0]);
  let waiting = null;
  const expose = (seconds) => {
    const wanted = Math.min(Math.max(seconds, range()[0]), range()[1]);
    keep({ exposure: wanted, exposureOf: profile.value });
    clearTimeout(waiting);
    waiting = setTimeout(() => order({ do: "exposure", exposure_s: wanted }), 120);
  };
  const amplify = (value) => {
    clearTimeout(waiting);
    waiting = setTimeout(() => order({ do: "gain", value }), 120);
  };
  const stepGain = (by) => {
    const { value, least, most, unit } = known.state.gain;
    const next = unit === "ISO" ? value * 2 ** by : value + by * (unit === "dB" ? 1 : Math.max(1, (most - least) / 50));
    amplify(Math.min(Math.max(next, least), most));
  };
  const show = (name) => {
    keep({ picture: name });
    if (isRunning("look")) order({ do: "picture", picture: name });
    paintState();
  };
  const zoomTo = (wanted, place = middle) => {
    zoom = ZOOMS.includes(wanted) ? wanted : zoom;
    middle = zoom === 1 ? [0.5, 0.5] : place;
    canvas.classList.toggle("pixels", zoom > 1);
    order({ do: "region", x: middle[0], y: middle[1], zoom });
    paintExtras();
  };
  const zoomStep = (by) => zoomTo(ZOOMS[Math.min(Math.max(ZOOMS.indexOf(zoom) + by, 0), ZOOMS.length - 1)]);

  const placeOf = (event) => {
    if (!facts?.window || !canvas.width) return null;
    const box = view.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width;
    const y = (event.clientY - box.top) / box.height;
    if (x < 0 || y < 0 || x >= 1 || y >= 1) return null;
    const [x0, y0, width, height] = facts.window;
    return [Math.floor(x0 + x * width), Math.floor(y0 + y * height)];
  };
  stage.addEventListener("pointermove", (event) => {
    const place = placeOf(event);
    at.hidden = !place;
    if (!place) return;
    const partner = map?.at(place[0], place[1]);
    at.textContent = `camera ${place[0]}, ${place[1]}${map ? (partner ? ` · projector ${number(partner[0], 5)}, ${number(partner[1], 5)}` : " · no projector pixel") : ""}`;
    cross(partner);
  });
  stage.addEventListener("pointerleave", () => { at.hidden = true; cross(null); });
  stage.addEventListener("click", (event) => {
    const place = placeOf(event);
    if (place && zoom > 1 && known.state) zoomTo(zoom, [place[0] / known.state.width_px, place[1] / known.state.height_px]);
  });

  const cross = (partner) => {
    linked.querySelector(".cross")?.remove();
    if (!partner || linked.hidden) return;
    const mark = h("span", { class: "cross" });
    mark.style.left = `${(100 * (partner[0] + 0.5)) / map.projector[0]}%`;
    mark.style.top = `${(100 * (partner[1] + 0.5)) / map.projector[1]}%`;
    linked.append(mark);
  };
  const linkable = async () => {
    const found = (await get("/api/sessions")).sessions.filter((one) => one.profile === profile.value && one.verdict !== "damaged");
    put(link, h("option", { value: "" }, found.length ? "none" : "no session of this profile yet"), found.map((one) => h("option", { value: one.name }, one.name)));
    linkTo("");
  };
  const linkTo = (name) => trying(async () => {
    map = null;
    linked.hidden = true;
    if (!name) return;
    const [columns, rows] = await Promise.all(["column", "row"].map(async (one) => levelsOf(await bytes(`/api/sessions/${name}/levels/${one}`))));
    const size = profiles.find((one) => one.name === profile.value)?.projector_px ?? [1, 1];
    map = { projector: size, at: (x, y) => {
      const [column, row] = [columns.value(x, y), rows.value(x, y)];
      return column === null || row === null ? null : [column, row];
    } };
    put(linked, h("img", { src: `/api/patterns/${profile.value}/${kept.picture && (known.setting?.patterns ?? []).includes(kept.picture) ? kept.picture : "grid"}.png`, alt: "The projector's picture" }));
    linked.hidden = false;
  });

  let profiles = [];
  const fill = async () => {
    profiles = (await get("/api/profiles")).profiles.filter((one) => one.ok);
    const wanted = known.job?.kind === "look" ? known.job.asked.profile : kept.profile;
    put(profile, profiles.map((one) => h("option", { value: one.name, selected: one.name === wanted }, `${one.name} – ${one.driver}`)));
    linkable();
  };

  const paintState = () => {
    const isOn = isRunning("look");
    const state = isOn ? known.state : null;
    begin.textContent = isOn ? "Stop looking" : "Look";
    begin.className = isOn ? "stop" : "main";
    begin.disabled = isRunning() && !isOn;
    const shown = state?.picture?.split("/").pop() ?? kept.picture ?? "grid";
    put(patterns, (known.setting?.patterns ?? []).map((name) => button(name, () => show(name), "", { "aria-pressed": String(name === shown), "data-pattern": name })));
    if (state?.exposure_s) {
      exposure.textContent = `${number(1000 * state.exposure_s, 4)} ms`;
      if (document.activeElement !== slider) slider.value = 1000 * shareOf(state.exposure_s);
    }
    slider.disabled = !isOn;
    gainCard.hidden = !state?.gain;
    if (state?.gain) {
      const { value, least, most, unit, profile_lines } = state.gain;
      gain.textContent = `${number(value, 4)} ${unit}`;
      gainKept.textContent = `Until you stop looking. Sessions have their profile's: ${profile_lines}.`;
      if (document.activeElement !== gainSlider) gainSlider.value = (1000 * (value - least)) / Math.max(most - least, 1e-9);
    }
    hint.hidden = isOn && facts !== null;
    hint.textContent = isOn ? "The rig is opened; the first picture comes." : isRunning() ? `The rig is at work: ${known.job.title}.` : "Choose a profile and press Look: the projector shows the picture, and you see what the camera sees.";
    about.textContent = state?.width_px ? `${state.width_px} × ${state.height_px} px, ${number(state.frame_rate_hz)} Hz, levels to ${state.full_scale_dn}, exposure ${number(1000 * state.exposure_range_s[0])} to ${number(1000 * state.exposure_range_s[1])} ms.${state.gain ? "" : " Its gain stays as the profile says."}` : "";
    if (!isOn) facts = null;
  };

  const row = (name, value, unit = "", isBad = false) => h("div", {}, h("dt", {}, name), h("dd", { class: isBad ? "bad" : "" }, value, unit ? h("small", {}, ` ${unit}`) : null));
  const paintFigures = (of) => {
    const found = of.figures;
    put(figures,
      row("Sharpness", number(found.sharpness)), row("Brightest", number(100 * found.brightest), "%", found.brightest >= 0.995),
      row("Clipped", number(100 * found.clipped_share, 2), "%", found.clipped_share > 0.001), row("At black", number(100 * found.black_share, 2), "%"),
      row("Mean", number(100 * found.mean), "%"), row("Noise", number(of.noise_dn, 2), "dn"), row("Flicker", number(of.flicker_percent, 2), "%", of.flicker_percent > 1),
      row("Lost frames", String(of.lost), "", of.lost > 0), row("Camera", number(of.rate_hz), "Hz"), row("Page", number(rates.length > 1 ? (rates.length - 1) * 1000 / (rates.at(-1) - rates[0]) : null), "Hz"),
      row("Light to page", number(delays.length ? [...delays].sort((a, b) => a - b)[delays.length >> 1] : null), "ms"));
    sharp = [...sharp.slice(-150), found.sharpness ?? 0];
    draw(histogram, (context, width, height) => bars(context, width, height, found.histogram));
    draw(trend, (context, width, height) => curve(context, width, height, sharp));
    const flat = found.sharpness_by_part.flat();
    const best = Math.max(...flat.map((value) => value ?? 0));
    put(thirds, flat.map((value) => h("span", { class: value !== null && value === best ? "best" : "" }, number(value, 2))));
  };

  const frames = new Frames((bitmap, of, overlay, withFigures) => {
    facts = of;
    hint.hidden = true;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
      view.style.setProperty("--ratio", String(bitmap.width / bitmap.height));
    }
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    rates = [...rates.slice(-30), performance.now()];
    if (of.taken_s) delays = [...delays.slice(-30), Date.now() - 1000 * of.taken_s];
    canvas.dataset.frames = String(Number(canvas.dataset.frames ?? 0) + 1);
    if (overlay) {
      Object.assign(marks, { width: overlay.width, height: overlay.height });
      const context = marks.getContext("2d", { willReadFrequently: true });
      context.drawImage(overlay, 0, 0);
      const pixels = context.getImageData(0, 0, overlay.width, overlay.height);
      for (let k = 0; k < pixels.data.length; k += 4) {
        const code = pixels.data[k];
        pixels.data.set(code > 200 ? [255, 40, 60, 220] : code > 64 ? [60, 120, 255, 200] : [0, 0, 0, 0], k);
      }
      context.putImageData(pixels, 0, 0);
    }
    if (withFigures?.figures) paintFigures(withFigures);
  });

  put(main, h("h1", {}, "Look"), h("div", { class: "split" },
    h("div", {}, stage, h("div", { class: "row between tools" }, toggles,
      h("div", { class: "row" }, saveButton(canvas, "camera"), button("−", () => zoomStep(-1), "icon", { "aria-label": "Zoom out" }), button("+", () => zoomStep(1), "icon", { "aria-label": "Zoom in, to the camera's own pixels" }))), figures),
    h("div", {},
      h("div", { class: "card" }, field("Profile", profile), h("div", { class: "row" }, begin), about),
      h("div", { class: "card" }, h("h2", {}, "Projector"), patterns, field("Your own picture", own)),
      h("div", { class: "card" }, h("h2", {}, "Exposure"), h("div", { class: "exposure" }, button("−", () => expose(known.state.exposure_s / STOP), "icon", { "aria-label": "Shorter by a third of a stop" }), slider, button("+", () => expose(known.state.exposure_s * STOP), "icon", { "aria-label": "Longer by a third of a stop" })), h("p", {}, "The camera does ", exposure)),
      gainCard,
      h("div", { class: "card" }, h("h2", {}, "Levels"), histogram, h("h3", {}, "Sharpness: turn the lens until it is highest"), trend),
      h("div", { class: "card" }, h("h2", {}, "Camera and projector linked"), field("By the map of", link, "Point at the camera's view: the ring shows which projector pixel lights it."), linked))));
  paintExtras();
  paintState();
  trying(fill);
  const leave = [on("job", () => { paintState(); if (isRunning("look")) frames.open(); }), on("state", paintState)];
  if (isRunning("look")) frames.open();
  return {
    close: () => { frames.close(); leave.forEach((one) => one()); },
    key: (event) => {
      const names = known.setting?.patterns ?? [];
      if (event.key === "p") show(names[(names.indexOf(kept.picture ?? "grid") + 1) % names.length]);
      else if (event.key === "[" && known.state?.exposure_s) expose(known.state.exposure_s / STOP);
      else if (event.key === "]" && known.state?.exposure_s) expose(known.state.exposure_s * STOP);
      else if (event.key === "o") flip("overlay");
      else if (event.key === "v") flip("colour");
      else if (event.key === "r") flip("focus");
      else if (event.key === "+") zoomStep(1);
      else if (event.key === "-") zoomStep(-1);
    },
  };
};

// A picture as numbers: see docs/reference/http.md.
export const levelsOf = (buffer) => {
  const [width, height, bands, scale] = new Uint32Array(buffer, 0, 4);
  const numbers = new Int16Array(buffer, 16);
  const value = (x, y, band = 0) => {
    if (x < 0 || y < 0 || x >= width || y >= height) return null;
    const found = numbers[(y * width + x) * bands + band];
    return found === -32768 ? null : found / scale;
  };
  return { width, height, bands, value };
};

const bars = (context, width, height, shares) => {
  const most = Math.max(...shares, 1e-9);
  const step = width / shares.length;
  shares.forEach((share, k) => {
    const tall = Math.sqrt(share / most) * (height - 4);
    context.fillStyle = k === shares.length - 1 ? colour("--bad") : k === 0 ? colour("--blue") : colour("--accent");
    context.fillRect(k * step + 1, height - tall, step - 2, tall);
  });
};

const curve = (context, width, height, values) => {
  const most = Math.max(...values, 1e-9);
  context.strokeStyle = colour("--accent");
  context.lineWidth = 2;
  context.beginPath();
  values.forEach((value, k) => context.lineTo((width * k) / Math.max(values.length - 1, 20), height - 3 - (value / most) * (height - 8)));
  context.stroke();
  context.strokeStyle = colour("--line");
  context.beginPath();
  context.moveTo(0, 5);
  context.lineTo(width, 5);
  context.stroke();
};

