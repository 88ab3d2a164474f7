// Set up: what is plugged in, a profile of it, and a check that ends with all limits kept.
import { get, isRunning, known, on, plainName, post, save, start, trying } from "./api.js";
import { button, chip, choice, field, h, number, put, toast } from "./dom.js";
import { numberForm } from "./numbers.js";

export const setupView = (main) => {
  const profile = h("select", { id: "setup-profile", onchange: () => open(profile.value) });
  const text = h("textarea", { spellcheck: false, "aria-label": "The profile's text", id: "profile-text" });
  const name = h("input", { autocomplete: "off", id: "profile-name" });
  const problems = h("pre", { hidden: true });
  const says = h("p", { class: "soft" });
  const devices = h("div", {}, h("p", { class: "soft" }, "Ask what is plugged in; it takes some seconds."));
  const check = h("div", { id: "check" });
  const steps = h("ol", { class: "wizard" });
  const numbers = numberForm(text, Object.fromEntries(MEANINGS.flatMap(([keys, words]) => keys.split(", ").map((key) => [key, words]))), () => { judge(); paint(); });
  let toMeasure = [];
  let isOwn = false;
  let saved = "";

  const fill = async (wanted) => {
    const { profiles } = await get("/api/profiles");
    put(profile, profiles.map((one) => h("option", { value: one.name, selected: one.name === wanted }, `${one.name}${one.own ? " (yours)" : ""}${one.ok ? "" : " – cannot be used"}`)));
    if (profile.value) await open(profile.value);
  };
  const open = (which) => trying(async () => {
    const found = await get(`/api/profiles/${which}`);
    text.value = saved = found.text;
    numbers.fill();
    isOwn = found.own;
    name.value = isOwn ? which : `my-${which}`;
    await judge();
    paint();
  });
  // Limits and units are the schema's: the server reads the text as `rig` reads it.
  const judge = async () => {
    const wanted = plainName(name.value || "profile");
    try {
      toMeasure = (await save(`/api/profiles/${wanted}`, { text: text.value, check_only: true })).to_measure;
      problems.hidden = true;
      says.textContent = toMeasure.length ? `Reads well. Only guessed so far: ${toMeasure.join(", ")}.` : "Reads well.";
    } catch (error) {
      problems.hidden = false;
      problems.textContent = error.message;
      says.textContent = "";
    }
  };
  let waiting = null;
  text.addEventListener("input", () => { clearTimeout(waiting); waiting = setTimeout(() => { judge(); numbers.fill(); }, 400); });
  const keep = () => trying(async () => {
    const wanted = plainName(name.value);
    await save(`/api/profiles/${wanted}`, { text: text.value });
    await fill(wanted);
    toast(`${wanted} is saved`, "fine");
  });
  const ask = () => trying(async () => {
    put(devices, h("p", { class: "soft" }, "Looking …"));
    const found = await get("/api/devices");
    const cameras = [...found.cameras, ...found.bus_cameras];
    const rows = [...cameras.map((one) => ["camera", one.name ?? one.device_id, one]), ...found.outputs.map((one) => ["output", one.connector, one]), ...found.monitors.map((one) => ["monitor", one.name, one]), ...found.controllers.map((one) => ["controller", one.name, one])];
    const camera = choice(cameras.filter((one) => !one.error).map((one) => [one.device_id, `${one.name ?? one.device_id}`]), "");
    const output = choice(found.outputs.filter((one) => !one.error).map((one) => [one.connector, `${one.connector} ${one.status ?? ""}`]), "");
    put(devices, rows.length ? h("table", {}, rows.map(([kind, title, one]) => h("tr", {}, h("td", {}, kind), h("td", {}, h("b", {}, title ?? "–"), one.error ? h("div", { class: "bad" }, one.error) : h("div", { class: "soft" }, one.device_id ?? one.status ?? ""))))) : h("p", {}, "Nothing is plugged in that this machine knows. Plug camera and projector in, then ask again; a simulated rig needs neither."),
      cameras.length ? field("Camera of the profile", camera) : null, found.outputs.length ? field("Output to the projector", output) : null,
      h("div", { class: "row" }, button("Ask again", ask), button("Make a profile of it", () => trying(async () => {
        const wanted = plainName(name.value || "lab");
        await post(`/api/profiles/${wanted}/new`, { ...(camera.value ? { camera: camera.value } : {}), ...(output.value ? { output: output.value } : {}) });
        await fill(wanted);
      }), "main", { disabled: !cameras.length })));
  });
  const mine = () => known.job?.kind === "check" && known.job.asked.profile === profile.value;
  const paint = () => trying(async () => {
    const job = mine() ? known.job : null;
    const result = job?.phase === "done" ? (await get("/api/job")).result : null;
    const isGood = Boolean(result?.within_limits);
    const stage = [Boolean(profile.value), problems.hidden && text.value === saved, Boolean(result), isGood];
    put(steps, ["Choose or make a profile", "Save it without problems", "Check the rig", "All limits kept"].map((words, k) => h("li", { class: stage[k] ? "done" : stage.slice(0, k).every(Boolean) ? "now" : "" }, words)));
    const begin = button(result ? "Check again" : "Check the rig", () => start("check", { profile: profile.value }), "main", { disabled: isRunning(), id: "check-start" });
    if (!result) {
      put(check, job?.phase === "failed" ? h("p", { class: "bad" }, job.error) : h("p", { class: "soft" }, job && isRunning("check") ? `${job.label} …` : "Measures latency, noise, linearity, flicker and more, each against its limit; takes a minute or two."), begin);
      return;
    }
    const suggested = Object.entries(result.suggested ?? {});
    put(check, h("p", { class: isGood ? "good" : "bad" }, isGood ? "All limits are kept." : `${result.checks.filter((row) => !row.met).length} limits are not kept; each says what to try.`),
      h("div", { class: "wide" }, h("table", { class: "checks" }, [...result.checks].sort((a, b) => Number(a.met) - Number(b.met)).map((row) => h("tr", {}, h("td", {}, chip(row.met ? "ok" : "outside", row.status)), h("td", {}, row.what, h("span", { class: "soft" }, ` · ${row.part}`), row.met ? null : h("div", { class: "advice" }, row.advice, remedy(row))), h("td", { class: "n" }, `${number(row.value)} ${row.unit}`), h("td", { class: "n soft" }, row.limit === null ? "" : `${row.at_least ? "≥" : "≤"} ${number(row.limit)}`))))),
      suggested.length ? h("div", {}, h("h3", {}, "Measured values for the profile"), h("pre", {}, suggested.map(([key, value]) => `${key} = ${number(value, 6)}`).join("\n")),
        button("Write them into the profile", () => trying(async () => {
          const { diff } = await post(`/api/profiles/${profile.value}/apply`);
          toast(diff ? "The profile has them now; the old file is kept beside it." : "The profile had them already.", "fine");
          await open(profile.value);
        }), "", { disabled: !isOwn, title: isOwn ? "" : "Save a copy of this profile first: shipped ones stay as they are" })) : null, begin);
  });
  // What software can do about a limit that is not kept: look again at that part, or at the camera's view.
  const remedy = (row) => h("div", { class: "row" }, button("Measure this again", () => start("check", { profile: profile.value, only: [row.part] }), "quiet", { disabled: isRunning() }), button("See it", () => { location.hash = "look"; }, "quiet"));

  put(main, h("h1", {}, "Set up"), steps, h("div", { class: "split" },
    h("div", {}, h("div", { class: "card" }, h("h2", {}, "Check"), check), h("div", { class: "card" }, h("h2", {}, "Profile"), says, problems, numbers.place, h("h3", {}, "The file"), text, h("div", { class: "row" }, h("div", { class: "grow" }, field("Save as", name)), button("Save", keep, "main", { id: "profile-save" })))),
    h("div", {}, h("div", { class: "card" }, field("Profile", profile, "What the rig is: devices, lengths, patterns, limits.")), h("div", { class: "card" }, h("h2", {}, "Plugged in"), devices, h("div", { class: "row" }, button("Ask", ask))), meanings())));
  trying(() => fill(mine() ? known.job.asked.profile : known.job?.asked?.profile));
  const leave = on("job", paint);
  return { close: leave };
};

// What the numbers of a profile mean, with a picture where one says it faster.
const MEANINGS = [
  ["hfov_deg", "Width of a device's view as an angle, from its data sheet; calibration finds the real one.", "M8 40 L60 8 M8 40 L60 72 M22 31 A17 17 0 0 1 22 49"],
  ["latency_s", "From the display's word that a picture is on screen until its light is there. The check measures it.", "M6 60 H24 V20 H70 M40 62 H56 V34 H72 M24 70 H40"],
  ["spots_px, distance_m", "One length by tape, between the spots that two projector pixels light: it gives the room its scale.", "M14 40 H66 M14 30 V50 M66 30 V50"],
  ["size_m", "The room by tape, x, y and z; used only for walls that nobody sees.", "M14 56 L40 66 L68 52 L42 42 Z M14 56 V26 L42 12 V42 M42 12 L68 22 V52"],
  ["exposures", "Multiples of the reference exposure with which each pattern is photographed; merged, so that dark and bright are both seen.", "M10 66 V52 H24 V66 M32 66 V34 H46 V66 M54 66 V14 H68 V66"],
];
const meanings = () => {
  const picture = (path) => {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 80 80");
    svg.setAttribute("width", "56");
    svg.setAttribute("aria-hidden", "true");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    for (const [key, value] of Object.entries({ d: path, fill: "none", stroke: "currentColor", "stroke-width": "2.5", "stroke-linecap": "round", "stroke-linejoin": "round" })) line.setAttribute(key, value);
    svg.append(line);
    return svg;
  };
  return h("div", { class: "card" }, h("h2", {}, "What the numbers mean"), h("table", {}, MEANINGS.map(([key, words, path]) => h("tr", {}, h("td", {}, picture(path)), h("td", {}, h("b", {}, key), h("div", { class: "soft" }, words))))));
};
