// The server: requests, events, and who this page is.
import { toast } from "./dom.js";

const random = () => [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
export const client = (() => {
  const known = sessionStorage.getItem("rig-client") ?? random();
  sessionStorage.setItem("rig-client", known);
  return known;
})();

export class Refused extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

const send = async (method, path, body, type = "application/json") => {
  let answer;
  try {
    answer = await fetch(path, { method, headers: { "x-rig-client": client, ...(method === "GET" ? {} : { "content-type": type }) }, body });
  } catch {
    throw new Refused("The server does not answer; is `rig serve` still running?", 0);
  }
  const content = answer.headers.get("content-type") ?? "";
  const found = content.includes("json") ? await answer.json() : await answer.text();
  if (!answer.ok) throw new Refused(found?.error ?? String(found), answer.status);
  return found;
};

export const get = (path) => send("GET", path);
export const post = (path, body = {}) => send("POST", path, JSON.stringify(body));
export const save = (path, body) => send("PUT", path, JSON.stringify(body));
export const remove = (path) => send("DELETE", path, "{}");
export const upload = (file) => send("PUT", `/api/uploads/${encodeURIComponent(plainName(file.name))}`, file, "application/octet-stream");
export const plainName = (name) => name.replace(/[^A-Za-z0-9._-]+/g, "-").replace(/^[._-]+/, "").replace(/\.{2,}/g, ".").slice(-80) || "file";
export const bytes = async (path) => {
  const answer = await fetch(path);
  if (!answer.ok) throw new Refused((await answer.json().catch(() => ({}))).error ?? "not there", answer.status);
  return answer.arrayBuffer();
};

// What is asked for by a click: a refusal becomes a message, and the click is over.
export const trying = async (work) => {
  try {
    return await work();
  } catch (error) {
    if (error.name === "AbortError") return undefined;
    toast(error.message);
    return undefined;
  }
};

export const order = (what) => trying(() => post("/api/job/order", what));
export const start = (kind, job) => trying(() => post(`/api/jobs/${kind}`, job));
export const stop = () => trying(() => post("/api/job/stop"));

// What is known, and who wants to know when it changes.
export const known = { job: null, state: null, lease: { holder: "", label: "" }, keeper: null, setting: null, isHeard: false };
const listeners = new Map();
export const on = (subject, listener) => {
  if (!listeners.has(subject)) listeners.set(subject, new Set());
  listeners.get(subject).add(listener);
  return () => listeners.get(subject).delete(listener);
};
const tell = (subject, what) => {
  for (const listener of listeners.get(subject) ?? []) listener(what);
};

export const isRunning = (kind) => Boolean(known.job && ["running", "stopping"].includes(known.job.phase) && (!kind || known.job.kind === kind));
export const isMine = () => known.lease.holder === client;
export const mayWork = () => known.lease.holder === "" || isMine();

// A browser allows six connections to a server: pages that are hidden hold none.
let events = null;
const connect = () => {
  if (events || document.hidden) return;
  events = new EventSource("/api/events");
  for (const subject of ["job", "state", "lease", "keeper", "refused", "files"]) {
    events.addEventListener(subject, (event) => {
      const what = JSON.parse(event.data);
      if (subject in known) known[subject] = what;
      if (subject === "refused" && known.isHeard) toast(what.error);
      tell(subject, what);
    });
  }
  events.onopen = async () => {
    const found = await get("/api/state").catch(() => null);
    if (!found) return;
    Object.assign(known, { lease: found.lease, job: found.job, setting: found });
    if (found.state) known.state = found.state;
    tell("lease", known.lease);
    tell("job", known.job);
    setTimeout(() => { known.isHeard = true; }, 500);
    tell("heard", true);
  };
  events.onerror = () => tell("heard", false);
};

export const listen = () => {
  connect();
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) {
      events?.close();
      events = null;
      known.isHeard = false;
    } else connect();
  });
  setInterval(() => {
    if (isMine()) post("/api/lease", { do: "keep" }).catch(() => {});
  }, 5000);
  window.addEventListener("pagehide", () => {
    if (isMine()) fetch("/api/lease", { method: "POST", keepalive: true, headers: { "content-type": "application/json", "x-rig-client": client }, body: '{"do":"release"}' });
  });
};
