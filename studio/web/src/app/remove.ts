// Remove: what goes, by object, brush and polygon, on the flat panorama.
import { api, factsOf, type Overview, type Point } from "./api";
import { button, h, note } from "./dom";
import type { Screen } from "./screens";
import { Latest, Turns, Undo } from "./undo";

const MOST_PX = 2048;
const LEAST_SHARE = 2e-4;
const PREVIEW = "Emptied: preview";
type Tool = "object" | "add" | "keep" | "polygon";
const TOOLS: [Tool, string][] = [["object", "Objects"], ["add", "Brush: remove"], ["keep", "Brush: keep"], ["polygon", "Polygon: remove"]];

interface Found {
  /** Which object each place belongs to; 0: none. */
  labels: Int32Array;
  objects: { label: number; size: number; x: number; y: number }[];
}

const read = async (answer: Response): Promise<ImageBitmap> => createImageBitmap(await answer.blob());

function canvasOf(width: number, height: number): [HTMLCanvasElement, CanvasRenderingContext2D] {
  const canvas = h("canvas", { width, height });
  return [canvas, canvas.getContext("2d", { willReadFrequently: true })!];
}

/** Connected parts of a mask, around the seam as well, largest first; specks are left out. */
function objectsIn(mask: Uint8Array, width: number, height: number): Found {
  const labels = new Int32Array(mask.length);
  const objects: Found["objects"] = [];
  const stack: number[] = [];
  for (let seed = 0; seed < mask.length; seed += 1) {
    if (!mask[seed] || labels[seed]) continue;
    const label = objects.length + 1;
    const one = { label, size: 0, x: seed % width, y: Math.floor(seed / width) };
    labels[seed] = label;
    stack.push(seed);
    while (stack.length) {
      const at = stack.pop()!;
      const [x, y] = [at % width, Math.floor(at / width)];
      one.size += 1;
      const row = y * width;
      for (const to of [row + ((x + 1) % width), row + ((x + width - 1) % width), y + 1 < height ? at + width : -1, y > 0 ? at - width : -1]) {
        if (to < 0 || !mask[to] || labels[to]) continue;
        labels[to] = label;
        stack.push(to);
      }
    }
    objects.push(one);
  }
  return { labels, objects: objects.filter((one) => one.size > LEAST_SHARE * mask.length).sort((a, b) => b.size - a.size) };
}

export async function removeScreen(session: Overview): Promise<Screen> {
  let found = await api.read(session.name, "mask", read);
  const width = Math.min(MOST_PX, found.value.width);
  const height = Math.round((width * found.value.height) / found.value.width);
  const [canvas, context] = canvasOf(width, height);
  const [hidden, scratch] = canvasOf(width, height);
  const picture = new Image();
  let mask: Uint8Array = fromBitmap(found.value);
  let known = objectsIn(mask, width, height);
  let tool: Tool = "object";
  let size = 24;
  let state = "Photograph";
  let corners: Point[] = [];
  let shown = mask; // what the preview was made with
  const turns = new Turns();
  const previews = new Latest();
  const undo = new Undo<Uint8Array>((before) => void keep(before));

  const tools = h("fieldset", { class: "segments" }, h("legend", { class: "unseen" }, "Tool"),
    ...TOOLS.map(([name, text], i) => h("label", {}, h("input", { type: "radio", name: "tool", value: name, checked: i === 0, change: () => pick(name) }), h("span", {}, text))));
  const states = h("select", { "aria-label": "Picture", change: (event: Event) => void look((event.target as HTMLSelectElement).value) });
  const bar = h("div", { class: "bar" }, tools,
    h("label", {}, "Brush ", h("input", { type: "range", min: 4, max: 90, value: size, "aria-label": "Size of the brush", input: (event: Event) => (size = Number((event.target as HTMLInputElement).value)) })),
    button("Undo", () => undo.back(mask), { "data-part": "undo" }), button("Redo", () => undo.again(mask)),
    button("As detected", () => void forget()), h("label", {}, "Show ", states));
  const list = h("ul", { class: "objects" });
  const facts = h("p", { class: "facts", "data-part": "facts" });
  const said = h("p", { class: "facts", "data-part": "preview", role: "status" });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Panorama; what is red will be removed");

  function fromBitmap(bitmap: ImageBitmap): Uint8Array {
    scratch.drawImage(bitmap, 0, 0, width, height);
    const { data } = scratch.getImageData(0, 0, width, height);
    return Uint8Array.from({ length: width * height }, (_, i) => (data[4 * i]! >= 128 ? 1 : 0));
  }

  function draw(): void {
    context.drawImage(picture, 0, 0, width, height);
    if (state === "Photograph" || state === PREVIEW) {
      const tint = new ImageData(width, height);
      mask.forEach((on, i) => {
        if (state === PREVIEW ? on !== shown[i] : on) tint.data.set([220, 40, 30, 120], 4 * i);
      });
      scratch.putImageData(tint, 0, 0);
      context.drawImage(hidden, 0, 0);
    }
    context.strokeStyle = context.fillStyle = "#ff2d1f";
    context.lineWidth = 3;
    context.beginPath();
    corners.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    for (const [x, y] of corners) context.fillRect(x - 4, y - 4, 8, 8);
    const share = mask.reduce((sum, on) => sum + on, 0) / mask.length;
    facts.textContent = `${(100 * share).toFixed(1)} % of the picture will be removed · ${found.corrected ? "corrected by hand" : "as detected"}`;
  }

  function names(): void {
    list.replaceChildren(...known.objects.slice(0, 40).map((one, i) => {
      const box = h("input", { type: "checkbox", checked: mask[one.y * width + one.x] === 1, change: () => toggle(one.label) });
      const turn = Math.round((one.x / width - 0.5) * 360);
      return h("li", {}, h("label", {}, box, `Object ${i + 1}, ${Math.abs(turn)}° ${turn < 0 ? "left" : "right"}`));
    }));
  }

  function toggle(label: number): void {
    const before = mask;
    const seed = known.labels.indexOf(label);
    const on = before[seed] ? 0 : 1;
    change(before.map((old, i) => (known.labels[i] === label ? on : old)));
  }

  function change(changed: Uint8Array): void {
    undo.step(mask);
    void keep(changed);
  }

  async function keep(changed: Uint8Array): Promise<void> {
    mask = changed;
    draw();
    names();
    const image = new ImageData(width, height);
    mask.forEach((on, i) => image.data.set(on ? [255, 255, 255, 255] : [0, 0, 0, 255], 4 * i));
    scratch.putImageData(image, 0, 0);
    const png = await new Promise<Blob | null>((done) => hidden.toBlob(done));
    try {
      await turns.save(async () => {
        found = await api.write(session.name, "mask", found.digest, png!, read);
      });
      facts.dataset.saved = found.digest;
      draw();
      if (state === PREVIEW) void preview();
      else note("Saved");
    } catch (error) {
      note(`Not saved: ${(error as Error).message}`, true);
      await refresh();
    }
  }

  const refresh = (): Promise<void> => turns.take(async () => {
    const now = await api.read(session.name, "mask", read);
    const overview = await api.overview(session.name);
    options(overview.states);
    if (now.digest !== found.digest) {
      turns.foreign += 1;
      found = now;
      mask = fromBitmap(now.value);
      names();
      if (state === PREVIEW) void preview();
    }
    await look(state, overview.stamp);
  });

  function options(all: string[]): void {
    const names = ["Photograph", PREVIEW, ...all.filter((name) => name === "Emptied")];
    states.replaceChildren(...names.map((name) => h("option", { selected: name === state }, name)));
  }

  async function look(name: string, stamp = session.stamp): Promise<void> {
    const other = state !== name;
    state = name;
    if (name === PREVIEW) return other ? preview() : undefined;
    said.textContent = "";
    picture.src = api.picture(session.name, name, MOST_PX, stamp);
    await picture.decode();
    canvas.dataset.shown = name;
    draw();
  }

  /** Show the room as it would be emptied, in a draft's size; tools go on working on it. */
  const preview = (): Promise<void> => previews.ask(async () => {
    const made = mask;
    said.textContent = "Emptying a small picture …";
    try {
      await turns.take(async () => undefined); // what is being saved counts
      const answer = await api.live(session.name, "emptied", {});
      const { seconds, size_px } = factsOf<{ seconds: number; size_px: [number, number] }>(answer);
      if (state !== PREVIEW) return;
      const url = URL.createObjectURL(await answer.blob());
      picture.src = url;
      await picture.decode();
      URL.revokeObjectURL(url);
      shown = made;
      canvas.dataset.shown = PREVIEW;
      canvas.dataset.made = found.digest;
      said.textContent = `Preview, ${size_px.join(" × ")}, in ${seconds.toFixed(1)} s: fillings are coarse, the old furniture's shade is as the last run found it; red is not yet in it`;
      draw();
    } catch (error) {
      note(`No preview: ${(error as Error).message}`, true);
    } finally {
      if (said.textContent === "Emptying a small picture …") said.textContent = "";
    }
  });

  async function forget(): Promise<void> {
    if (!found.corrected) return;
    undo.step(mask);
    await api.forget(session.name, "mask");
    await refresh();
    known = objectsIn(mask, width, height);
    names();
  }

  const at = (event: MouseEvent): Point => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };

  /** Set a disc of the mask; the panorama goes on beyond its left and right edge. */
  function disc(into: Uint8Array, [cx, cy]: Point, on: 0 | 1): void {
    for (let y = Math.max(0, Math.ceil(cy - size)); y <= Math.min(height - 1, cy + size); y += 1) {
      const half = Math.sqrt(Math.max(0, size * size - (y - cy) ** 2));
      for (let x = Math.ceil(cx - half); x <= cx + half; x += 1) into[y * width + ((x + width) % width)] = on;
    }
  }

  function pick(name: Tool): void {
    tool = name;
    corners = [];
    draw();
  }

  /** Fill the polygon that was clicked. */
  function close(): void {
    if (corners.length > 2) {
      scratch.clearRect(0, 0, width, height);
      scratch.beginPath();
      for (const [x, y] of corners) scratch.lineTo(x, y);
      scratch.fill();
      const { data } = scratch.getImageData(0, 0, width, height);
      change(mask.map((old, i) => (data[4 * i + 3]! >= 128 ? 1 : old)));
    }
    corners = [];
    draw();
  }

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || state === "Emptied") return;
    const place = at(event);
    if (tool === "object") {
      const label = known.labels[Math.floor(place[1]) * width + Math.floor(place[0])];
      if (label) toggle(label);
      else note("Nothing was detected here: use the brush");
    } else if (tool === "polygon") {
      const first = corners[0];
      if (first && corners.length > 2 && Math.hypot(first[0] - place[0], first[1] - place[1]) < 14) close();
      else corners.push(place);
      draw();
    } else stroke(event, tool === "add" ? 1 : 0);
  });
  canvas.addEventListener("dblclick", () => tool === "polygon" && close());

  function stroke(event: PointerEvent, on: 0 | 1): void {
    canvas.setPointerCapture(event.pointerId);
    const changed = mask.slice();
    const before = mask;
    let last = at(event);
    const move = (next: PointerEvent): void => {
      const place = at(next);
      const steps = Math.max(1, Math.ceil(Math.hypot(place[0] - last[0], place[1] - last[1]) / (size / 3)));
      for (let k = 0; k <= steps; k += 1) disc(changed, [last[0] + ((place[0] - last[0]) * k) / steps, last[1] + ((place[1] - last[1]) * k) / steps], on);
      last = place;
      mask = changed;
      draw();
    };
    move(event);
    canvas.addEventListener("pointermove", move);
    const end = (): void => {
      canvas.removeEventListener("pointermove", move);
      mask = before;
      change(changed);
    };
    canvas.addEventListener("pointerup", end, { once: true });
  }

  options(session.states);
  await look("Photograph");
  names();
  return {
    element: h("section", { class: "wide" }, bar, canvas, facts, said, h("h2", {}, "Detected objects"), list),
    refresh,
    undo: () => undo.back(mask),
    redo: () => undo.again(mask),
    command: `daylit process ${session.path} --mask ${session.path}/mask.png --until remove`,
    run: { until: "remove", text: "Empty the room" },
  };
}
