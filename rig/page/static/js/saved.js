// The fields of a saved show's file: what the page's other controls do not say.
import { get, save, trying } from "./api.js";
import { button, field, h, tick, toast } from "./dom.js";

const words = (text) => text.split(",").map((one) => one.trim()).filter(Boolean);
const numeric = (more) => h("input", { type: "number", ...more });

// settings: sources, strategy, linear; asked() says session or profile; onLoad(show) sets the page's other controls.
export const savedForm = (settings, { asked, onKept, onLoad }) => {
  const name = h("input", { autocomplete: "off", placeholder: "evening", id: "show-name" });
  const hours = h("input", { autocomplete: "off", placeholder: "09:00-12:30, 22:00-02:00", id: "show-on" });
  const lamp = numeric({ min: 1, placeholder: "none" });
  const limit = numeric({ min: 0.1, step: "any", value: "10" });
  const port = numeric({ min: 1, max: 65535, placeholder: "none" });
  const power = tick("Switch the projector off meanwhile (PJLink)", false);
  const record = tick("Record it", false);
  const isOn = (label) => label.querySelector("input").checked;
  const turn = (label, value) => { label.querySelector("input").checked = value; };
  let kept = {}; // what the file says and no field shows stays in it
  const fields = () => {
    const { session, profile, on, lamp_hours_limit, osc, record: folder, ...rest } = kept;
    return {
      ...rest, ...asked(), sources: settings.sources, strategy: settings.strategy, linear: settings.linear, gain: settings.gain ?? 1, auto_gain: settings.auto_gain ?? false,
      on: words(hours.value), switch_off: isOn(power), record_limit_gb: Number(limit.value),
      ...(lamp.value ? { lamp_hours_limit: Number(lamp.value) } : {}), ...(port.value ? { osc: { ...osc, port: Number(port.value) } } : {}), ...(isOn(record) ? { record: folder ?? "recordings" } : {}),
    };
  };
  const keep = () => trying(async () => {
    const { show } = await save(`/api/shows/${encodeURIComponent(name.value)}`, fields());
    kept = show;
    toast(`${name.value} is saved; it counts from the next Keep running on.`, "fine");
    onKept();
  });
  const edit = (which) => trying(async () => {
    const { show, lamp_h: lit } = await get(`/api/shows/${which}`);
    kept = show;
    name.value = which;
    hours.value = show.on.join(", ");
    lamp.value = show.lamp_hours_limit ?? "";
    limit.value = show.record_limit_gb;
    port.value = show.osc?.port ?? "";
    turn(power, show.switch_off);
    turn(record, Boolean(show.record));
    onLoad(show);
    toast(`${which}: its lamp was lit for ${lit.toFixed(1)} h by this show.`, "fine");
  });
  return {
    edit,
    fields: [field("Save this one as", name), field("On at", hours, "Times of day; empty: always."), power,
      h("details", {}, h("summary", {}, "Lamp, recording, show control"), field("Ask for a new lamp after [h]", lamp), record, field("All recordings together at most [GB]", limit), field("Listen for OSC on port", port)),
      button("Save", keep, "", { id: "show-save" })],
  };
};
