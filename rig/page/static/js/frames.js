// The newest pictures of the job: one stream a page, closed while the page is hidden; single pictures where a stream fails.
import { client } from "./api.js";

const HEAD = 12;

export class Frames {
  constructor(onframe) {
    this.onframe = onframe;
    this.isWanted = false;
    this.control = null;
    this.visible = () => (document.hidden ? this.pause() : this.isWanted && this.begin());
    document.addEventListener("visibilitychange", this.visible);
  }

  open() {
    this.isWanted = true;
    if (!document.hidden && !this.control) this.begin();
  }

  close() {
    this.isWanted = false;
    this.pause();
    document.removeEventListener("visibilitychange", this.visible);
  }

  pause() {
    this.control?.abort();
    this.control = null;
  }

  async begin() {
    if (this.control) return;
    const control = new AbortController();
    this.control = control;
    let failures = 0;
    while (this.control === control) {
      try {
        await (failures < 3 ? this.stream(control.signal) : this.single(control.signal));
        failures = Math.max(0, failures - 1);
      } catch {
        if (control.signal.aborted) return;
        failures += 1;
      }
      await new Promise((done) => setTimeout(done, 250));
    }
  }

  async stream(signal) {
    const answer = await fetch(`/api/frames?client=${client}`, { signal, headers: { "x-rig-client": client } });
    if (!answer.ok) throw new Error(String(answer.status));
    const reader = answer.body.getReader();
    let pending = new Uint8Array(0);
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      const joined = new Uint8Array(pending.length + value.length);
      joined.set(pending);
      joined.set(value, pending.length);
      pending = await this.unpack(joined);
    }
  }

  // Only the newest whole picture is decoded: a page that is late skips the ones between.
  async unpack(all) {
    const view = new DataView(all.buffer);
    let at = 0;
    let newest = null;
    let overlay = null;
    while (all.length - at >= HEAD) {
      const [header, jpeg, marks] = [0, 4, 8].map((offset) => view.getUint32(at + offset));
      if (all.length - at < HEAD + header + jpeg + marks) break;
      const first = at + HEAD;
      newest = { facts: JSON.parse(new TextDecoder().decode(all.subarray(first, first + header))), jpeg: all.slice(first + header, first + header + jpeg) };
      if (marks) overlay = { marks: all.slice(first + header + jpeg, first + header + jpeg + marks), figures: newest.facts };
      at = first + header + jpeg + marks;
    }
    if (newest) await this.show(newest, overlay);
    return all.slice(at);
  }

  async single(signal) {
    const answer = await fetch(`/api/frame.jpg?after=${this.number ?? 0}`, { signal });
    if (!answer.ok) throw new Error(String(answer.status));
    this.number = Number(answer.headers.get("x-rig-number"));
    const facts = { number: this.number, taken_s: Number(answer.headers.get("x-rig-taken")) };
    await this.show({ facts, jpeg: new Uint8Array(await answer.arrayBuffer()) }, null);
  }

  async show({ facts, jpeg }, overlay) {
    const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    const marks = overlay ? await createImageBitmap(new Blob([overlay.marks], { type: "image/png" })) : null;
    this.onframe(bitmap, facts, marks, overlay?.figures);
    bitmap.close();
    marks?.close();
  }
}
