// The measured scene of a session: which one, and the viewer that reports have, too.
import { get, trying } from "./api.js";
import { field, h, put } from "./dom.js";
import "../scene/webgl.js";
import "../scene/viewer.js";

const { drawn } = globalThis.rigScene;

export const sceneView = (main, [wanted]) => {
  const sessions = h("select", { onchange: () => { location.hash = `scene/${sessions.value}`; } });
  const body = h("div", {});
  let inner = null;
  put(main, h("div", { class: "row between" }, h("h1", {}, "Scene"), field("Session", sessions)), body);
  trying(async () => {
    const found = (await get("/api/sessions")).sessions.filter((one) => one.verdict !== "damaged");
    const name = wanted ?? found.find((one) => one.measured_mean !== undefined)?.name;
    put(sessions, found.map((one) => h("option", { value: one.name, selected: one.name === name }, one.name)));
    if (!name) return put(body, h("p", { class: "empty" }, "There is no session with a model yet; run one first."));
    put(body, h("p", { class: "empty" }, "The scene is read."));
    const scene = await get(`/api/sessions/${name}/scene`).catch((error) => put(body, h("p", { class: "empty" }, error.message)) && null);
    if (scene) inner = drawn(body, scene);
    return undefined;
  });
  return { close: () => inner?.close(), key: (event) => inner?.key(event) };
};
