// Re-check: whether camera or projector moved since a session was made, whether the light drifted; and following it.
import { get, isRunning, known, on, start, trying } from "./api.js";
import { ago, button, chip, field, h, number, put, tick } from "./dom.js";
import { limitTable } from "./runs.js";

// A card for the session that nameOf() says, empty where there is none.
export const recheckCard = (nameOf) => {
  const settings = { realign: false };
  const profile = h("select", { id: "recheck-profile" });
  const go = button("Re-check", () => start("recheck", { session: nameOf(), realign: settings.realign, ...(profile.value ? { profile: profile.value } : {}) }), "main", { id: "recheck" });
  const found = h("div", { id: "recheck-found", "aria-live": "polite" });
  const box = h("div", { class: "card" }, h("h2", {}, "Has anything moved?"),
    h("p", { class: "soft" }, "Photographs the code once more, in seconds, and says by how many pixels camera or projector moved and whether lamp or room light drifted."),
    tick("If so, follow it: measure the rig where it stands now", false, (isOn) => { settings.realign = isOn; }),
    field("With the profile", profile, "Another one than the session's only to move simulated devices."), h("div", { class: "row" }, go), found);
  const isMine = () => known.job?.kind === "recheck" && known.job.asked.session === nameOf();
  const fill = () => trying(async () => {
    const name = nameOf();
    box.hidden = !name;
    if (!name) return;
    go.disabled = isRunning();
    if (isMine() && isRunning()) return put(found, h("p", { class: "soft" }, `${known.job.label} …`));
    const { rechecks } = await get(`/api/sessions/${name}/rechecks`);
    if (name !== nameOf()) return undefined;
    return put(found, isMine() && known.job.phase === "failed" ? h("p", { class: "bad" }, known.job.error) : null,
      rechecks.length ? lookOf(name, rechecks[0], rechecks.length) : h("p", { class: "soft" }, "Not looked at again yet."));
  });
  trying(async () => {
    const { profiles } = await get("/api/profiles");
    put(profile, h("option", { value: "" }, "the session's own"), profiles.filter((one) => one.ok && one.own).map((one) => h("option", { value: one.name }, one.name)));
  });
  fill();
  let last = "";
  const leave = on("job", (job) => {
    const now = `${job?.number}${job?.phase}${isMine() ? job.label : ""}`;
    if (now !== last) { last = now; fill(); }
  });
  return { box, fill, close: leave };
};

const lookOf = (name, one, count) => {
  const { found } = one;
  // As many digits as its sigma allows.
  const told = (value, sigma) => value.toFixed(sigma > 0 ? Math.min(Math.max(-Math.floor(Math.log10(sigma)), 0), 4) : 2).replace(/^-(?=[0.]*$)/, "");
  const moved = (title, device) => h("div", {}, h("dt", {}, title), h("dd", {}, `${told(device.image_px, device.image_sigma_px)} px`, h("small", {}, ` ± ${number(device.image_sigma_px, 2)}`)));
  const share = (title, value, sigma) => h("div", {}, h("dt", {}, title), h("dd", {}, `${told(100 * value, 100 * sigma)} %`, h("small", {}, ` ± ${number(100 * sigma, 2)}`)));
  return h("div", {}, h("p", {}, chip(found.within_limits ? "ok" : "outside", ago(one.created))), h("p", {}, found.summary),
    h("dl", { class: "figures" }, moved("Camera moved by", found.camera), moved("Projector moved by", found.projector),
      share("Lamp, of before", found.light.lamp_gain, found.light.lamp_gain_sigma), share("Room light changed, of white", found.light.room_light, found.light.room_light_sigma)),
    found.realigned ? h("p", { class: "good" }, `Realigned: shows and strategies use the new place.${found.realigned.error_after === undefined ? "" : ` Mean error ${number(found.realigned.error_after)} grey levels, ${number(found.realigned.error_before)} before anything moved.`}`) : null,
    h("div", { class: "wide" }, limitTable(found.limits)),
    h("p", { class: "soft" }, h("a", { href: `/api/sessions/${name}/rechecks/${one.look}/page`, target: "_blank", rel: "noopener" }, "Maps of this look"), count > 1 ? ` · ${count} looks so far` : ""));
};
