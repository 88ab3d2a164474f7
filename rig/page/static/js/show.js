// Show: live pictures, compensated or not, with the time of every frame; saved shows that run by themselves.
import { get, isRunning, known, on, order, post, remove, start, stop, trying, upload } from "./api.js";
import { button, chip, colour, draw, field, h, number, put, tick, toast } from "./dom.js";
import { Frames } from "./frames.js";
import { recheckCard } from "./recheck.js";
import { savedForm } from "./saved.js";

const KEPT = 1200;
const LATE = 1.6; // periods: a picture that misses its refresh comes one later
const STEP = 2 ** (1 / 8);

export const showView = (main) => {
  const canvas = h("canvas", { id: "on-screen", "aria-label": "What the projector shows" });
  const view = h("div", { class: "view" }, canvas);
  const hint = h("p", { class: "hint" });
  const strip = h("canvas", { class: "chart tall", role: "img", "aria-label": "Time between pictures" });
  const figures = h("dl", { class: "figures" });
  const switches = h("div", { class: "switches" });
  const gain = h("input", { type: "range", min: -400, max: 200, "aria-label": "Gain", oninput: () => { if (state()) order({ do: "gain", value: 2 ** (gain.value / 100) }); else { settings.gain = 2 ** (gain.value / 100); paint(); } } });
  const gainSays = h("output", {});
  const strategy = h("div", { class: "row" });
  const sources = h("div", {});
  const saved = h("div", {});
  const session = h("select", { id: "show-session", onchange: () => recheck.fill() });
  const recheck = recheckCard(() => (session.value.startsWith("session:") ? session.value.slice(8) : ""));
  const settings = { sources: ["pattern"], strategy: "bounded", endless: true, linear: false };
  const begin = button("Begin", () => toggle(), "main", { id: "show-begin" });
  const form = savedForm(settings, { asked: () => chosen(), onKept: () => paintSaved(), onLoad: (show) => load(show) });
  let times = [];
  const chosen = () => (session.value.startsWith("session:") ? { session: session.value.slice(8) } : { profile: session.value.slice(8) });
  const isShowing = () => isRunning("show") || isRunning("keep");
  const toggle = () => (isShowing() ? stop() : start("show", { ...chosen(), ...settings }));
  const state = () => (isShowing() && known.state?.times_ms ? known.state : null);
  const flip = (what) => state() && order({ do: what, value: !state()[what] });

  // Made once and changed in place: a button that is replaced while it is pressed is never clicked.
  const items = {
    compensating: button("Compensated", () => flip("compensating"), "", { title: "Key c" }), frozen: button("Freeze", () => flip("frozen"), "", { title: "Key f" }),
    black: button("Black", () => flip("black"), "black", { title: "Key b" }), auto_gain: button("Automatic gain", () => flip("auto_gain"), "", { title: "Key a" }),
    next: button("Next source", () => order({ do: "next" }), "", { title: "Key n" }),
  };
  put(switches, Object.values(items));
  put(strategy, ["exact", "bounded", "none"].map((one) => button(one, () => (state() ? order({ do: "strategy", value: one }) : choose(one)))));
  const paint = () => {
    const now = state();
    const isOn = isShowing();
    begin.textContent = isOn ? "End the show" : "Begin";
    begin.className = isOn ? "stop" : "main";
    begin.disabled = isRunning() && !isOn;
    hint.hidden = isOn && canvas.dataset.frames > 0;
    hint.textContent = isOn ? (known.keeper?.phase === "off" ? "Off by its timetable." : "The show begins.") : isRunning() ? `The rig is at work: ${known.job.title}.` : "Choose a session with a model, or a profile, and a source; then begin.";
    for (const [name, item] of Object.entries(items)) {
      item.setAttribute("aria-pressed", String(Boolean(now?.[name])));
      item.disabled = !now;
    }
    items.compensating.textContent = now && !now.compensating ? "As it is" : "Compensated";
    for (const item of strategy.children) item.setAttribute("aria-pressed", String((now ? now.strategy || "none" : settings.strategy) === item.textContent));
    const at = now?.gain ?? settings.gain ?? 1;
    if (document.activeElement !== gain) gain.value = 100 * Math.log2(at);
    gainSays.textContent = ` ${number(at)} ×`;
    if (!now) return;
    const row = (title, value, isBad = false) => h("div", {}, h("dt", {}, title), h("dd", { class: isBad ? "bad" : "" }, value));
    const sorted = [...times].sort((a, b) => a - b);
    put(figures, row("Source", now.source), row("Pictures a second", number(sorted.length ? 1000 / sorted[sorted.length >> 1] : null)), row("Shown", now.frames.toLocaleString("en")), row("Late", String(now.late), now.late > 0.001 * now.frames),
      row("Never shown", String(now.dropped)), row("Display away", String(now.unplugged), now.unplugged > 0), row("Expected error", now.error_levels === undefined ? "–" : `${number(now.error_levels)} levels`), now.failure ? row("Source failed", now.failure, true) : null);
  };
  const choose = (one) => { settings.strategy = one; paint(); };
  const chart = () => draw(strip, (context, width, height) => {
    const period = known.state?.period_ms ?? 16.7;
    const top = period * 3.2;
    const y = (time) => height - 4 - Math.min(time / top, 1) * (height - 10);
    context.fillStyle = colour("--soft");
    context.font = "11px system-ui";
    for (const k of [1, 2, 3]) {
      context.strokeStyle = colour("--line");
      context.beginPath();
      context.moveTo(0, y(k * period));
      context.lineTo(width, y(k * period));
      context.stroke();
      context.fillText(`${number(k * period)} ms`, 4, y(k * period) - 3);
    }
    times.forEach((time, k) => {
      const isLate = time > LATE * period;
      context.fillStyle = isLate ? colour("--bad") : colour("--accent");
      context.fillRect(width - (times.length - k) * (width / KEPT), y(time) - (isLate ? 2 : 1), Math.max(width / KEPT, 1), isLate ? 4 : 2);
    });
  });
  const paintSources = () => trying(async () => {
    const { uploads } = await get("/api/uploads");
    const words = ["pattern", ...uploads.map((one) => one.name)];
    const add = h("input", { type: "file", accept: "image/*,video/*", onchange: () => trying(async () => {
      if (!add.files[0]) return;
      const found = await upload(add.files[0]);
      settings.sources = [found.name];
      toast(`${found.name} is here`, "fine");
      paintSources();
    }) });
    put(sources, words.map((word) => tick(word, settings.sources.includes(word), (isOn) => { settings.sources = isOn ? [...settings.sources, word] : settings.sources.filter((one) => one !== word); })), field("Add a film or picture", add));
  });
  const paintSaved = () => trying(async () => {
    const { shows, keeper } = await get("/api/shows");
    known.keeper = keeper;
    put(saved, keeper.name ? h("p", {}, chip(keeper.phase === "waiting" ? "failed" : "ok", `${keeper.name}: ${keeper.phase}${keeper.restarts ? `, begun again ${keeper.restarts} times` : ""}`), keeper.error ? h("div", { class: "soft" }, keeper.error) : null) : null,
      shows.map((one) => h("div", { class: "row between" }, h("b", {}, one), h("span", { class: "row" },
        button("Keep running", () => trying(async () => { await post(`/api/shows/${one}/keep`); paintSaved(); }), "", { "data-keep": one }),
        button("Edit", () => form.edit(one), "", { "data-edit": one }),
        button("×", () => trying(async () => { await remove(`/api/shows/${one}`); paintSaved(); }), "quiet icon", { "aria-label": `Forget ${one}` })))),
      shows.length ? null : h("p", { class: "soft" }, "None yet. `rig serve --show NAME` begins a saved one by itself."));
  });
  const load = (show) => {
    const wanted = show.session ? `session:${show.session}` : `profile:${show.profile}`;
    if (![...session.options].some((one) => one.value === wanted)) session.append(h("option", { value: wanted }, show.session ?? show.profile));
    session.value = wanted;
    recheck.fill();
    Object.assign(settings, { sources: [...show.sources], strategy: show.strategy, gain: show.gain, auto_gain: show.auto_gain, linear: show.linear });
    paintSources();
    paint();
  };
  const frames = new Frames((bitmap) => {
    Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    view.style.setProperty("--ratio", String(bitmap.width / bitmap.height));
    canvas.dataset.frames = String(Number(canvas.dataset.frames ?? 0) + 1);
    hint.hidden = true;
  });
  put(main, h("h1", {}, "Show"), h("div", { class: "split" },
    h("div", {}, h("div", { class: "stage" }, view, hint), switches, figures, h("div", { class: "card" }, h("h2", {}, "Time between pictures"), strip), recheck.box),
    h("div", {}, h("div", { class: "card" }, field("With the model of", session), h("div", { class: "label" }, "Strategy"), strategy, h("div", { class: "field" }, h("label", { for: "gain" }, "Gain", gainSays), gain), h("div", { class: "row" }, begin)),
      h("div", { class: "card" }, h("h2", {}, "Sources"), sources, tick("Begin again after the last", true, (isOn) => { settings.endless = isOn; }), tick("Codes are linear light", false, (isOn) => { settings.linear = isOn; })),
      h("div", { class: "card" }, h("h2", {}, "Saved shows"), saved, ...form.fields))));
  gain.id = "gain";
  trying(async () => {
    const [{ sessions }, { profiles }] = await Promise.all([get("/api/sessions"), get("/api/profiles")]);
    put(session, h("optgroup", { label: "Sessions" }, sessions.filter((one) => one.measured_mean !== undefined).map((one) => h("option", { value: `session:${one.name}` }, one.name))),
      h("optgroup", { label: "Profiles: simulated ones guess a model" }, profiles.filter((one) => one.ok).map((one) => h("option", { value: `profile:${one.name}` }, one.name))));
    recheck.fill();
  });
  paint();
  paintSources();
  paintSaved();
  const leave = [on("job", () => { paint(); if (isShowing()) frames.open(); else canvas.dataset.frames = "0"; }), on("keeper", paintSaved), on("files", paintSources),
    on("state", (now) => { if (now.times_ms) { times = [...times, ...now.times_ms].slice(-KEPT); chart(); } paint(); })];
  if (isShowing()) frames.open();
  return {
    close: () => { frames.close(); recheck.close(); leave.forEach((one) => one()); },
    key: (event) => {
      const now = state();
      const act = { c: () => flip("compensating"), a: () => flip("auto_gain"), f: () => flip("frozen"), b: () => flip("black"), n: () => order({ do: "next" }),
        s: () => order({ do: "strategy", value: now.strategies[(now.strategies.indexOf(now.strategy) + 1) % now.strategies.length] }),
        "+": () => order({ do: "gain", value: Math.min(now.gain * STEP, 4) }), "-": () => order({ do: "gain", value: Math.max(now.gain / STEP, 1 / 16) }) }[event.key];
      if (act && now) act();
    },
  };
};
