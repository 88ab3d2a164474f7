// Sessions: their list, starting one, watching it, its results.
import { get, isRunning, known, on, start, stop, trying, upload } from "./api.js";
import { compareView } from "./curtain.js";
import { ago, button, chip, copyable, field, h, number, put, tick, toast } from "./dom.js";
import { recheckCard } from "./recheck.js";

export const runsView = (main, [name, part, other]) => {
  if (name && part === "against" && other) return againstView(main, name, other);
  if (name) return sessionView(main, name, part ?? "watch");
  return listView(main);
};

const listView = (main) => {
  const list = h("div", { class: "sessions", id: "sessions" });
  const first = h("select", {});
  const second = h("select", {});
  const compare = h("div", { class: "card", hidden: true }, h("h2", {}, "Compare two sessions"), field("First", first), field("Second", second),
    button("Compare", () => { location.hash = `runs/${first.value}/against/${second.value}`; }));
  const fill = () => trying(async () => {
    const { sessions } = await get("/api/sessions");
    put(list, sessions.length ? sessions.map(rowOf) : h("p", { class: "empty" }, "No session yet. Choose a profile, give it a name, and start."));
    const done = sessions.filter((one) => one.measured_mean !== undefined);
    compare.hidden = done.length < 2;
    for (const [control, k] of [[first, 0], [second, 1]]) put(control, done.map((one, n) => h("option", { value: one.name, selected: n === k }, one.name)));
  });
  put(main, h("h1", {}, "Sessions"), h("div", { class: "split" }, h("div", {}, list), h("div", {}, startCard(), compare)));
  fill();
  let phase = known.job?.phase;
  const leave = on("job", (job) => { if (job?.phase !== phase) { phase = job?.phase; fill(); } });
  return { close: leave };
};

const rowOf = (one) => h("a", { class: "session", href: `#runs/${one.name}` },
  chip(one.verdict, { ok: "ok", outside: "outside", unfinished: "not done", damaged: "damaged" }[one.verdict]),
  h("div", {}, h("b", {}, one.name), h("div", { class: "soft" }, `${one.profile} · ${ago(one.created)}`)),
  h("div", { class: "says soft" }, one.says),
  h("div", { class: "n" }, one.measured_mean === undefined ? "" : [h("div", { class: "big" }, number(one.measured_mean)), h("div", { class: "soft" }, `grey levels, ${one.strategy}`)]),
  h("div", { class: "n" }, one.uncompensated_mean === undefined ? "" : [h("div", { class: "big" }, `${number(one.uncompensated_mean / one.measured_mean, 2)} ×`), h("div", { class: "soft" }, "better than none")]));

const startCard = () => {
  const name = h("input", { id: "session-name", autocomplete: "off", placeholder: "first" });
  const profile = h("select", { id: "session-profile" });
  const target = h("select", { id: "session-target" }, h("option", { value: "" }, "the test picture, or the session's last"));
  const file = h("input", { type: "file", accept: "image/*,.exr", onchange: () => trying(async () => {
    if (!file.files[0]) return;
    const found = await upload(file.files[0]);
    await fill();
    target.value = found.name;
    toast(`${found.name} is here`, "fine");
  }) });
  const options = { fit: true, linear: false };
  const strategies = h("input", { value: "none,direct,paper,exact,bounded" });
  const go = button("Start", () => trying(async () => {
    const job = { session: name.value.trim() || "first", profile: profile.value, fit: options.fit, linear: options.linear, strategies: strategies.value.split(",").map((one) => one.trim()).filter(Boolean), ...(target.value ? { target: target.value } : {}) };
    if (await start("run", job)) location.hash = `runs/${job.session}`;
  }), "main", { id: "start" });
  const fill = async () => {
    const [{ profiles }, { uploads }] = await Promise.all([get("/api/profiles"), get("/api/uploads")]);
    put(profile, profiles.filter((one) => one.ok).map((one) => h("option", { value: one.name }, `${one.name} – ${one.says.slice(0, 48)}`)));
    put(target, h("option", { value: "" }, "the test picture, or the session's last"), uploads.map((one) => h("option", { value: one.name }, one.name)));
  };
  trying(fill);
  return h("form", { class: "card", onsubmit: (event) => { event.preventDefault(); go.click(); } }, h("h2", {}, "New session"), field("Name", name), field("Profile", profile), field("Picture to show", target), field("Upload one", file),
    field("Strategies", strategies, "Names separated by commas, or all."), tick("Scale and crop the picture to the projector", true, (on) => { options.fit = on; }), tick("Its codes are linear light", false, (on) => { options.linear = on; }), h("div", { class: "row" }, go));
};

const PARTS = [["watch", "Session"], ["pictures", "Pictures"], ["report", "Report"], ["strategies", "Strategies"]];

const sessionView = (main, name, part) => {
  const body = h("div", {});
  const heading = h("div", {});
  const links = h("nav", { class: "sub", "aria-label": "Parts of the session" }, PARTS.map(([key, text]) => h("a", { href: `#runs/${name}/${key}`, "aria-current": key === part ? "page" : null }, text)), h("a", { href: `#scene/${name}` }, "Scene"));
  put(main, heading, links, body);
  const views = { watch: watchPart, pictures: compareView, report: pagePart("report.html"), strategies: strategiesPart };
  const inner = (views[part] ?? watchPart)(body, name, heading);
  return inner;
};

const heading = (place, detail) => put(place, h("div", { class: "row between" }, h("h1", {}, detail.listed.name), chip(detail.listed.verdict, detail.listed.says)), h("p", { class: "soft" }, `${detail.listed.profile} · ${ago(detail.listed.created)} · ${detail.listed.frames} photographs`));

const watchPart = (body, name, place) => {
  const steps = h("ol", { class: "steps" });
  const actions = h("div", { class: "row" });
  const left = h("p", { class: "soft" });
  const photo = h("figure", {}, h("img", { alt: "The last photograph", hidden: true }), h("figcaption", {}));
  const maps = h("div", { class: "shots" });
  const faults = h("ul", { class: "faults" });
  const limits = h("div", { class: "wide" });
  let isDone = false;
  const recheck = recheckCard(() => (isDone ? name : ""));
  put(body, h("div", { class: "split" },
    h("div", {}, h("div", { class: "card" }, h("h2", {}, "Verdict"), limits), h("div", { class: "card" }, h("h2", {}, "Maps"), maps), recheck.box, h("div", { class: "card" }, h("h2", {}, "What went wrong, and was put right"), faults)),
    h("div", {}, h("div", { class: "card" }, h("h2", {}, "Steps"), steps, left, actions), h("div", { class: "card" }, h("h2", {}, "Last photograph"), photo))));
  let isOpen = true;
  let frames = -1;
  let shownMaps = "";
  const mine = () => isRunning() && known.job.asked.session === name;
  const fill = () => trying(async () => {
    let detail;
    try {
      detail = await get(`/api/sessions/${name}`);
    } catch (error) {
      if (error.status !== 404 && error.status !== 400) throw error;
      put(place, h("h1", {}, name), h("p", { class: "soft" }, mine() ? "The rig is opened; the session begins." : error.message));
      paintActions(null);
      return;
    }
    if (!isOpen) return;
    heading(place, detail);
    const hasModel = detail.steps.some((one) => one.step === "model" && one.done);
    if (isDone !== hasModel) {
      isDone = hasModel;
      recheck.fill();
    }
    const now = mine() ? detail.steps.find((one) => !one.done)?.step : null;
    put(steps, detail.steps.map((one) => h("li", { class: one.done ? "done" : one.step === now ? "now" : "" }, one.step, h("span", { class: "soft num" }, one.frames ? `${one.frames} photographs` : ""))));
    const toDo = detail.steps.filter((one) => !one.done);
    left.textContent = toDo.length ? `${toDo.length} steps and ${detail.left_in_words} to go.` : "All steps are done.";
    put(faults, detail.notes.length ? [...detail.notes].reverse().map((one) => h("li", {}, h("b", {}, one.event), ` ${one.step}, ${one.frame}: ${one.detail}`)) : h("li", { class: "soft" }, "Nothing."));
    put(limits, detail.limits.length ? limitTable(detail.limits) : h("p", { class: "soft" }, "Told when the session is compared."));
    if (frames !== detail.listed.frames && detail.listed.frames) {
      frames = detail.listed.frames;
      const img = photo.querySelector("img");
      img.src = `/api/sessions/${name}/photograph?n=${frames}`;
      img.hidden = false;
      photo.querySelector("figcaption").textContent = `photograph ${frames}`;
    }
    if (shownMaps !== detail.maps.map((one) => one.name).join()) {
      shownMaps = detail.maps.map((one) => one.name).join();
      put(maps, detail.maps.map((one) => h("figure", {}, h("a", { href: `/api/sessions/${name}/maps/${one.name}`, target: "_blank", rel: "noopener" }, h("img", { src: `/api/sessions/${name}/maps/${one.name}?${shownMaps.length}`, alt: one.title, loading: "lazy" })), h("figcaption", {}, one.title))));
    }
    if (!detail.maps.length) put(maps, h("p", { class: "soft" }, "They come as soon as the steps that make them are done."));
    paintActions(detail);
  });
  const paintActions = (detail) => put(actions,
    mine() ? button("Stop", stop, "stop") : button(detail?.listed.verdict === "unfinished" || !detail ? "Go on" : "Run again", () => start("run", { session: name }), "main", { disabled: isRunning() || !detail, id: "resume" }),
    mine() ? null : button("Compare strategies", () => start("strategies", { session: name, test_pictures: false, strategies: ["none", "direct", "paper", "exact", "bounded"], loops: [] }), "", { disabled: isRunning() || !detail }));
  fill();
  const timer = setInterval(() => { if (!document.hidden && mine()) fill(); }, 2500);
  let label = "";
  const leave = on("job", (job) => {
    const now = `${job?.phase}${job?.label}`;
    if (now !== label) { label = now; fill(); }
  });
  return { close: () => { isOpen = false; clearInterval(timer); recheck.close(); leave(); } };
};

const limitTable = (limits) => copyable(h("table", { class: "checks" }, h("tr", {}, ["", "what", "value", "limit"].map((text, k) => h("th", { class: k > 1 ? "n" : "" }, text))),
  limits.map((row) => h("tr", {}, h("td", {}, chip(row.met ? "ok" : "outside", row.status)), h("td", {}, row.what, row.met ? null : h("div", { class: "advice" }, row.advice)), h("td", { class: "n" }, `${number(row.value)} ${row.unit}`), h("td", { class: "n soft" }, row.limit === null ? "" : `${row.at_least ? "≥" : "≤"} ${number(row.limit)}`)))));

const pagePart = (file) => (body, name, place) => {
  trying(async () => {
    const detail = await get(`/api/sessions/${name}`);
    heading(place, detail);
    if (!detail.listed.pages?.includes(file)) return put(body, h("p", { class: "empty" }, file === "report.html" ? "The report is written when the session is compared." : "Strategies were not compared yet."));
    const source = `/api/sessions/${name}/pages/${file}`;
    return put(body, h("p", {}, h("a", { href: source, target: "_blank", rel: "noopener" }, "Open by itself")), h("iframe", { class: "frame", src: source, title: file, sandbox: "allow-scripts allow-popups allow-downloads" }));
  });
  return {};
};

const strategiesPart = (body, name, place) => {
  const table = h("div", {});
  const frame = h("div", {});
  put(body, table, frame);
  pagePart("strategies.html")(frame, name, place);
  trying(async () => {
    const found = await get(`/api/sessions/${name}/strategies`).catch(() => null);
    if (!found) return;
    const rows = [...found.pictures[0].rows].sort((a, b) => (a.measured ?? a.predicted).mean - (b.measured ?? b.predicted).mean);
    const most = Math.max(...rows.map((row) => (row.measured ?? row.predicted).mean));
    put(table, h("div", { class: "card" }, h("h2", {}, `Mean error on ${found.pictures[0].title}`), h("table", {}, rows.map((row) => {
      const mean = (row.measured ?? row.predicted).mean;
      return h("tr", {}, h("td", {}, row.strategy), h("td", {}, h("progress", { max: most, value: mean, "aria-label": `${mean} grey levels` })), h("td", { class: "n" }, number(mean)), h("td", { class: "n soft" }, `${number(100 * row.clipped_share, 2)} % clipped`));
    }))));
  });
  return {};
};

const againstView = (main, first, second) => {
  const only = h("input", { placeholder: "geometry, strategies.bounded, …", "aria-label": "Only numbers whose name has", oninput: () => paint() });
  const table = h("div", { class: "wide card" });
  let found = null;
  const paint = () => put(table, copyable(h("table", {}, h("tr", {}, ["number", first, second, "second over first"].map((text, k) => h("th", { class: k ? "n" : "" }, text))),
    found.figures.filter((one) => one.name.includes(only.value.trim())).map((one) => {
      const ratio = one.first ? one.second / one.first : null;
      return h("tr", {}, h("td", {}, one.name), h("td", { class: "n" }, number(one.first, 4)), h("td", { class: "n" }, number(one.second, 4)), h("td", { class: `n ${ratio !== null && Math.abs(ratio - 1) > 0.1 ? "warn" : "soft"}` }, ratio === null || one.second === undefined ? "–" : `${number(ratio)} ×`));
    }))));
  put(main, h("h1", {}, `${first} and ${second}`), field("Only numbers whose name has", only), table);
  trying(async () => { found = await get(`/api/compare?first=${encodeURIComponent(first)}&second=${encodeURIComponent(second)}`); paint(); });
  return {};
};

export { limitTable };
