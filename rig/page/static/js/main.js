// The page as a whole: which part is shown, what the job does, who works the rig, keys.
import { client, get, isMine, isRunning, known, listen, on, post, stop, trying } from "./api.js";
import { button, chip, h, put } from "./dom.js";
import { lookView } from "./look.js";
import { sceneView } from "./scene.js";
import { runsView } from "./runs.js";
import { setupView } from "./setup.js";
import { showView } from "./show.js";

const VIEWS = { look: lookView, setup: setupView, runs: runsView, scene: sceneView, show: showView };
const main = document.getElementById("main");
let current = null;

const route = () => {
  const [name, ...rest] = decodeURIComponent(location.hash.slice(1)).split("/");
  const tab = name in VIEWS ? name : "look";
  for (const link of document.querySelectorAll("[data-tab]")) {
    if (link.dataset.tab === tab) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  current?.close?.();
  document.title = `${tab} · rig`;
  current = VIEWS[tab](main, rest);
};

// Made once and changed in place: a button that is replaced while it is pressed is never clicked.
const at = {
  title: chip("", ""), words: h("span", {}), meter: h("progress", { max: 1, value: 0, "aria-label": "Progress of this step" }),
  count: h("span", { class: "num soft" }), stop: button("Stop", stop, "stop", { id: "stop" }),
};
put(document.getElementById("job"), Object.values(at));

const showJob = () => {
  const bar = document.getElementById("job");
  const job = known.job;
  bar.hidden = !job || (job.kind === "look" && ["done", "stopped"].includes(job.phase));
  if (bar.hidden) return;
  const share = job.total > 0 ? job.done / job.total : null;
  const isAtWork = isRunning();
  at.title.className = `chip ${job.phase === "done" ? "ok" : job.phase}`;
  at.title.textContent = job.title;
  at.words.className = job.phase === "failed" ? "bad grow" : "soft";
  at.words.textContent = { running: job.label, stopping: "ending: nothing that was photographed is lost", done: "done", stopped: "stopped; start it again to go on", failed: job.error }[job.phase];
  at.meter.hidden = at.count.hidden = !isAtWork || share === null;
  at.meter.value = share ?? 0;
  at.count.textContent = `${job.done} of ${job.total}`;
  at.stop.hidden = !isAtWork;
  at.stop.disabled = job.phase === "stopping";
};

const showLease = () => {
  const place = document.getElementById("lease");
  const lease = known.lease;
  place.className = `chip ${lease.holder === "" ? "" : isMine() ? "mine" : "other"}`;
  place.textContent = lease.holder === "" ? "Nobody works the rig" : isMine() ? "You work the rig" : `${lease.label} works the rig; you watch`;
  document.getElementById("take").hidden = lease.holder === "" || isMine();
};

const KEYS = [
  ["1 – 5", "Look, Set up, Sessions, Scene, Show"],
  ["l", "Light or dark page"], ["?", "This list"], ["Esc", "Stop what is at work, after a question"],
  ["Look: p", "Next picture on the projector"], ["Look: [ ]", "Exposure a third of a stop shorter, longer"],
  ["Look: o", "Overlay of clipped and black places"], ["Look: v", "False colour"], ["Look: + −", "Zoom in, out"],
  ["Show: c s", "Compensation on or off, next strategy"], ["Show: + −", "Brighter, darker"],
  ["Show: a f b n", "Automatic gain, freeze, black, next source"], ["Compare: ← →", "Move the curtain"], ["Scene: arrows", "Turn the scene; + − nearer, farther"],
];

const help = () => {
  const dialog = document.getElementById("help");
  put(dialog, h("h2", { id: "help-title" }, "Keys"), h("table", {}, KEYS.map(([key, what]) => h("tr", {}, h("td", {}, h("kbd", {}, key)), h("td", {}, what)))),
    h("form", { method: "dialog", class: "row end" }, h("button", { class: "main" }, "Close")));
  dialog.showModal();
};

const light = () => {
  const next = document.documentElement.dataset.light === "dark" ? "light" : "dark";
  document.documentElement.dataset.light = next;
  localStorage.setItem("rig-light", next);
};

const typing = (event) => ["INPUT", "TEXTAREA", "SELECT"].includes(event.target.tagName) && event.target.type !== "checkbox";

document.documentElement.dataset.light = localStorage.getItem("rig-light") ?? "dark";
document.getElementById("light").addEventListener("click", light);
document.getElementById("keys").addEventListener("click", help);
document.getElementById("take").addEventListener("click", () => trying(() => post("/api/lease", { do: "take", by_force: true })));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]") || typing(event)) return;
  const tabs = Object.keys(VIEWS);
  if (event.key >= "1" && event.key <= String(tabs.length)) location.hash = tabs[Number(event.key) - 1];
  else if (event.key === "?") help();
  else if (event.key === "l") light();
  else if (event.key === "Escape" && isRunning() && window.confirm(`Stop ${known.job.title}?`)) stop();
  else current?.key?.(event);
});
on("job", showJob);
on("lease", showLease);
on("heard", (isHeard) => {
  if (isHeard) return showLease();
  const place = document.getElementById("lease");
  place.className = "chip lost";
  place.textContent = "The server does not answer";
  return undefined;
});
window.addEventListener("hashchange", route);
known.setting = await get("/api/state").catch(() => null);
if (known.setting) Object.assign(known, { job: known.setting.job, lease: known.setting.lease, state: known.setting.state });
showJob();
showLease();
listen();
route();
document.documentElement.dataset.ready = client;
