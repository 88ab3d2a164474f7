// The measured scene in three dimensions: patches coloured by what is known of them, devices, a patch picked by pointing.
// One viewer for the page and for reports: a block of its own, so that it stands in either.
{
const { button, choice, field, h, number, put } = globalThis.rigElements;
const { between, camera, programOf, textureOf } = globalThis.rigWebgl;

const TURBO = [[48, 18, 59], [70, 107, 227], [40, 188, 235], [50, 242, 152], [164, 252, 60], [238, 207, 58], [251, 126, 33], [209, 47, 5], [122, 4, 3]];
const CONFIDENCE = { "lit and seen": [111, 191, 143], "seen in global light": [220, 184, 90], "nobody saw it": [105, 110, 122] };
const TINTS = { camera: [0.48, 0.65, 0.85], projector: [0.88, 0.64, 0.29] };
const rgb = (shares) => `rgb(${shares.map((share) => Math.round(255 * share)).join()})`;
const LAYERS = [["texture", "Texture"], ["reflectance", "Reflectance"], ["direct", "Direct light of white"], ["global_light", "Global light of white"], ["confidence", "Confidence"], ["region", "Walls and things"]];

const valueOf = (patch, layer) => (layer === "reflectance" ? patch.reflectance.reduce((a, b) => a + b, 0) / patch.reflectance.length : patch[layer] ?? null);

// Where corners of patches lie in the texture: at the middles of their tile's outer pixels.
const spotOf = (texture, k) => ([u, v]) => [
  ((k % texture.columns) * texture.tile_px + u * (texture.tile_px - 1) + 0.5) / texture.width_px,
  (Math.floor(k / texture.columns) * texture.tile_px + v * (texture.tile_px - 1) + 0.5) / texture.height_px,
];

const turbo = (share) => {
  const place = Math.min(Math.max(share, 0), 1) * (TURBO.length - 1);
  const k = Math.min(Math.floor(place), TURBO.length - 2);
  return TURBO[k].map((low, band) => low + (TURBO[k + 1][band] - low) * (place - k));
};

const drawn = (body, scene) => {
  const canvas = h("canvas", { id: "scene", tabindex: "0", "aria-label": "The scene; arrows turn it, plus and minus go nearer and farther" });
  const legend = h("div", { class: "legend" });
  const picked = h("div", {});
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) return void put(body, h("p", { class: "empty" }, "This browser draws no WebGL2; its settings may allow it."));
  const state = { layer: "texture", pick: -1, back: true, devices: true };
  const corners = scene.patches.flatMap((patch) => patch.corners);
  const low = [0, 1, 2].map((axis) => Math.min(...corners.map((one) => one[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...corners.map((one) => one[axis])));
  const middle = low.map((value, axis) => (value + high[axis]) / 2);
  const size = Math.hypot(...low.map((value, axis) => high[axis] - value));
  const view = { turn: -0.9, rise: 0.5, far: size * 1.05, target: middle };
  const program = programOf(gl);
  const place = gl.createBuffer();
  const paintBuffer = gl.createBuffer();
  const lineBuffer = gl.createBuffer();
  const spotBuffer = gl.createBuffer();

  const triangles = [];
  const owner = [];
  const spots = [];
  scene.patches.forEach((patch, k) => {
    const [a, b, c, d] = patch.corners;
    const isQuad = d && d.some((value, axis) => value !== c[axis]);
    const faces = isQuad ? [a, b, c, a, c, d] : [a, b, c];
    triangles.push(...faces);
    owner.push(...faces.map(() => k));
    spots.push(...(isQuad ? [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]] : [[0, 0], [1, 0], [0, 1]]).map(spotOf(scene.texture, k)));
  });
  gl.bindBuffer(gl.ARRAY_BUFFER, spotBuffer);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(spots.flat()), gl.STATIC_DRAW);
  gl.bindBuffer(gl.ARRAY_BUFFER, place);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(triangles.flat()), gl.STATIC_DRAW);
  const lines = scene.devices.flatMap((device) => device.corners.flatMap((corner, k) => {
    const tint = TINTS[device.kind];
    const next = device.corners[(k + 1) % device.corners.length];
    return [[...device.position, ...tint], [...corner, ...tint], [...corner, ...tint], [...next, ...tint]];
  }));
  gl.bindBuffer(gl.ARRAY_BUFFER, lineBuffer);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(lines.flat()), gl.STATIC_DRAW);

  const regions = [...new Set(scene.patches.map((patch) => patch.region))];
  const recolour = () => {
    const values = scene.patches.map((patch) => valueOf(patch, state.layer));
    const numbers = values.filter((value) => typeof value === "number");
    const [least, most] = [Math.min(...numbers), Math.max(...numbers)];
    const tints = values.map((value, k) => {
      if (state.layer === "texture") return k === state.pick ? [224, 164, 74] : [255, 255, 255];
      if (k === state.pick) return [255, 255, 255];
      if (state.layer === "confidence") return CONFIDENCE[value] ?? [90, 90, 90];
      if (state.layer === "region") return turbo(regions.indexOf(value) / Math.max(regions.length - 1, 1));
      return value === null ? [44, 47, 54] : turbo((value - least) / Math.max(most - least, 1e-9));
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, paintBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(owner.flatMap((k) => tints[k].map((band) => band / 255))), gl.STATIC_DRAW);
    const dot = (tint, text) => { const mark = h("i", {}); mark.style.background = `rgb(${tint.map(Math.round).join()})`; return h("span", {}, mark, text); };
    if (state.layer === "texture") put(legend, h("span", {}, "What the surface sends back of white light, as the camera sees it; elsewhere each patch evenly."));
    else if (state.layer === "confidence") put(legend, Object.entries(CONFIDENCE).map(([text, tint]) => dot(tint, text)));
    else if (state.layer === "region") put(legend, regions.map((text, k) => dot(turbo(k / Math.max(regions.length - 1, 1)), text)));
    else put(legend, [0, 0.25, 0.5, 0.75, 1].map((share) => dot(turbo(share), number(least + share * (most - least)))), dot([44, 47, 54], "not seen"));
    render();
  };
  const render = () => {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.02, 0.022, 0.027, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    if (state.back) gl.enable(gl.CULL_FACE);
    else gl.disable(gl.CULL_FACE);
    gl.cullFace(gl.BACK);
    program.use(camera(view, width / height, size), size);
    program.triangles({ places: place, tints: paintBuffer, spots: spotBuffer, count: owner.length, isTextured: state.layer === "texture" });
    if (state.devices) program.lines(lineBuffer, lines.length);
  };
  const tell = (k) => {
    state.pick = k;
    const patch = scene.patches[k];
    put(picked, patch ? h("dl", { class: "figures" }, [["Patch", `${k}, ${patch.region}`], ["Reflectance", patch.reflectance.map((value) => number(value)).join(", ")], ["Direct light", number(patch.direct)], ["Global light", number(patch.global_light)], ["Confidence", patch.confidence || "–"]].map(([key, value]) => h("div", {}, h("dt", {}, key), h("dd", {}, value)))) : h("p", { class: "soft" }, "Click a patch to see its numbers."));
    recolour();
  };
  let held = null;
  canvas.addEventListener("pointerdown", (event) => { held = { x: event.clientX, y: event.clientY, moved: false, pan: event.shiftKey || event.button === 2 }; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
    held.moved ||= Math.hypot(dx, dy) > 3;
    if (!held.moved) return;
    if (held.pan) view.target = between.pan(view, dx, dy, canvas.clientHeight);
    else {
      view.turn -= dx * 0.006;
      view.rise = Math.min(Math.max(view.rise + dy * 0.006, -1.5), 1.5);
    }
    Object.assign(held, { x: event.clientX, y: event.clientY });
    render();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (held && !held.moved) tell(pickAt(event));
    held = null;
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); view.far *= Math.exp(event.deltaY * 0.001); render(); }, { passive: false });
  const pickAt = (event) => {
    const box = canvas.getBoundingClientRect();
    const ray = between.ray(view, ((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2, box.width / box.height);
    let [best, at] = [Infinity, -1];
    for (let k = 0; k < triangles.length; k += 3) {
      const distance = between.hit(ray, triangles[k], triangles[k + 1], triangles[k + 2], state.back);
      if (distance !== null && distance < best) [best, at] = [distance, owner[k]];
    }
    return at;
  };
  const key = (event) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] }[event.key];
    if (turn) { view.turn += turn[0]; view.rise = Math.min(Math.max(view.rise + turn[1], -1.5), 1.5); event.preventDefault(); render(); }
    if (event.key === "+" || event.key === "-") { view.far *= event.key === "+" ? 0.88 : 1.14; render(); }
  };
  const switches = h("div", { class: "row" },
    button("Look through walls from outside", (event) => { state.back = !state.back; event.target.setAttribute("aria-pressed", String(state.back)); render(); }, "", { "aria-pressed": "true" }),
    button("Devices", (event) => { state.devices = !state.devices; event.target.setAttribute("aria-pressed", String(state.devices)); render(); }, "", { "aria-pressed": "true" }));
  const deviceLegend = h("div", { class: "legend" }, scene.devices.map((device) => { const mark = h("i", {}); mark.style.background = device.kind === "camera" ? rgb(TINTS.camera) : rgb(TINTS.projector); return h("span", {}, mark, `${device.name} at ${device.position.map((one) => number(one)).join(", ")} m`); }));
  put(body, h("div", { class: "split" }, h("div", { class: "scene" }, canvas, h("p", { class: "soft" }, "Drag to turn, shift and drag to move, wheel to go nearer.")),
    h("div", { class: "card" }, field("Colour by", choice(LAYERS, state.layer, (layer) => { state.layer = layer; recolour(); })), legend, h("h3", {}, "Devices"), deviceLegend, h("h3", {}, "Patch"), picked, h("h3", {}, "View"), switches)));
  tell(-1);
  textureOf(gl, scene.texture.png).then(render);
  const resized = new ResizeObserver(render);
  resized.observe(canvas);
  return { close: () => { resized.disconnect(); gl.getExtension("WEBGL_lose_context")?.loseContext(); }, key };
};

globalThis.rigScene = { drawn };
}
