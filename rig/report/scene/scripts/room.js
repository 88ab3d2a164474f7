// The 3-D view of a report: its scene stands in the page itself.
{
const body = document.getElementById("room");
const view = globalThis.rigScene.drawn(body, JSON.parse(document.getElementById("room-data").textContent));
if (view) body.querySelector("canvas").addEventListener("keydown", view.key);
}
