// Remove: what goes, by object, brush and polygon, on the flat panorama.
import { api, factsOf, type Overview, type Point } from "./api";
import { button, h, note } from "./dom";
import type { Screen } from "./screens";
import { Latest, Turns, Undo } from "./undo";

const MOST_PX = 2048;
const LEAST_SHARE = 2e-4;
const PREVIEW = "Emptied: preview";
/** For which a screen is looked at before its preview is prepared. */
const IDLE_MS = 1200;
const TOOLS = [["object", "Objects"], ["brush", "Brush"], ["polygon", "Polygon"]] as const;
/** What becomes of a place: it stays, goes as a thing, or goes as direct sunlight. */
const PAINTS = [["Remove", 1], ["Keep", 0], ["Sunlight", 2]] as const;
const [GOES, SUN] = [1, 2];
/** The layer that says each of a place, over what was detected there. */
const LAYERS = ["mask-keep", "mask-add", "mask-sunlight"] as const;
/** How each is shown: RGBA, from its last byte. */
const TINTS = [0, 0x781e28dc, 0x8c10b8ff];
const KEPT = 0x78b0782a;

interface Found {
  /** Which object each place belongs to; 0: none. */
  labels: Int32Array;
  objects: { label: number; size: number; x: number; y: number; kind: number }[];
}

/** What becomes of each place, what was detected there, whether it was painted by hand, and what names that state. */
interface Masks {
  now: Uint8Array;
  detected: Uint8Array;
  hand: Uint8Array;
  digests: string[];
  corrected: boolean;
  /** A whole mask was given. */
  whole: boolean;
}

const bitmap = async (answer: Response): Promise<ImageBitmap> => createImageBitmap(await answer.blob());
const none = async (): Promise<void> => undefined;
const named = (masks: Masks): string => masks.digests.join();

function canvasOf(width: number, height: number): [HTMLCanvasElement, CanvasRenderingContext2D] {
  const canvas = h("canvas", { width, height });
  return [canvas, canvas.getContext("2d", { willReadFrequently: true })!];
}

/** Connected parts of one kind, around the seam as well, largest first; specks are left out. */
function objectsIn(mask: Uint8Array, width: number, height: number): Found {
  const labels = new Int32Array(mask.length);
  const objects: Found["objects"] = [];
  const stack: number[] = [];
  for (let seed = 0; seed < mask.length; seed += 1) {
    if (!mask[seed] || labels[seed]) continue;
    const label = objects.length + 1;
    const kind = mask[seed]!;
    const one = { label, size: 0, x: seed % width, y: Math.floor(seed / width), kind };
    labels[seed] = label;
    stack.push(seed);
    while (stack.length) {
      const at = stack.pop()!;
      const [x, y] = [at % width, Math.floor(at / width)];
      one.size += 1;
      const row = y * width;
      for (const to of [row + ((x + 1) % width), row + ((x + width - 1) % width), y + 1 < height ? at + width : -1, y > 0 ? at - width : -1]) {
        if (to < 0 || mask[to] !== kind || labels[to]) continue;
        labels[to] = label;
        stack.push(to);
      }
    }
    objects.push(one);
  }
  return { labels, objects: objects.filter((one) => one.size > LEAST_SHARE * mask.length).sort((a, b) => b.size - a.size) };
}

export async function removeScreen(session: Overview): Promise<Screen> {
  const target = (await api.read(session.name, "mask", bitmap)).value;
  const width = Math.min(MOST_PX, target.width);
  const height = Math.round((width * target.height) / target.width);
  const [canvas, context] = canvasOf(width, height);
  const [hidden, scratch] = canvasOf(width, height);
  const tint = new ImageData(width, height);
  const picture = new Image();
  let found = await masks(session.sunlight);
  let mask = found.now;
  let known = objectsIn(found.detected, width, height);
  let tool: (typeof TOOLS)[number][0] = "object";
  let paint: number = GOES;
  let size = 24;
  let state = "Photograph";
  let corners: Point[] = [];
  let shown = mask; // what the preview was made with
  const written = new Set<string>(found.corrected ? LAYERS : []);
  let prepared: { digest: string; answer: Promise<Response> } | null = null;
  const turns = new Turns();
  const previews = new Latest();
  const undo = new Undo<Uint8Array>((before) => void keep(before));

  const segments = <T extends string | number>(legend: string, all: readonly (readonly [T, string])[], act: (value: T) => void): HTMLElement =>
    h("fieldset", { class: "segments" }, h("legend", { class: "unseen" }, legend),
      ...all.map(([value, text], i) => h("label", {}, h("input", { type: "radio", name: legend, value, checked: i === 0, change: () => act(value) }), h("span", {}, text))));
  const tools = segments("Tool", TOOLS, pick);
  const paints = segments("Paint as", PAINTS.map(([text, kind]) => [kind, text] as const), (kind) => (paint = kind));
  paints.hidden = true;
  const states = h("select", { "aria-label": "Picture", change: (event: Event) => void look((event.target as HTMLSelectElement).value) });
  const bar = h("div", { class: "bar" }, tools, paints,
    h("label", {}, "Size ", h("input", { type: "range", min: 4, max: 90, value: size, "aria-label": "Size of the brush", input: (event: Event) => (size = Number((event.target as HTMLInputElement).value)) })),
    button("Undo", () => undo.back(mask), { "data-part": "undo" }), button("Redo", () => undo.again(mask)),
    button("As detected", () => void forget()), h("label", {}, "Show ", states));
  const list = h("ul", { class: "objects" });
  const facts = h("p", { class: "facts", "data-part": "facts" });
  const said = h("p", { class: "facts", "data-part": "preview", role: "status" });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Panorama: red will be removed, yellow will be removed as direct sunlight");

  /** Where a mask is white. */
  function marked(image: ImageBitmap): Uint8Array {
    scratch.drawImage(image, 0, 0, width, height);
    const { data } = scratch.getImageData(0, 0, width, height);
    return Uint8Array.from({ length: width * height }, (_, i) => (data[4 * i]! >= 128 ? 1 : 0));
  }

  /** What was detected, and the layers over it; a whole mask that was given counts as drawn by hand. */
  async function masks(sunny: boolean): Promise<Masks> {
    const whole = await api.read(session.name, "mask", bitmap);
    const layers = await Promise.all(LAYERS.map((name) => api.read(session.name, name, bitmap)));
    const now = marked(whole.value);
    if (sunny && !whole.corrected) {
      const sun = marked(await bitmap(await fetch(api.file(session.name, "detect/sunlight.png"))));
      now.forEach((on, i) => on && sun[i] && (now[i] = SUN));
    }
    const [detected, hand] = [now.slice(), new Uint8Array(now.length).fill(whole.corrected ? 1 : 0)];
    layers.forEach((layer, kind) => layer.corrected && marked(layer.value).forEach((on, i) => on && (now[i] = kind) | (hand[i] = 1)));
    return { now, detected, hand, digests: [whole, ...layers].map((one) => one.digest), corrected: [whole, ...layers].some((one) => one.corrected), whole: whole.corrected };
  }

  /** Write the layers that have changed; what was given as a whole is in them from then on. */
  async function write(): Promise<void> {
    await turns.save(async () => {
      if (found.whole) await api.forget(session.name, "mask");
      found.whole = false;
      for (const [kind, name] of LAYERS.entries()) {
        const words = new Uint32Array(tint.data.buffer);
        let any = false;
        mask.forEach((one, i) => {
          const on = found.hand[i] && one === kind;
          any ||= Boolean(on);
          words[i] = on ? 0xffffffff : 0xff000000;
        });
        if (!any && !written.has(name)) continue;
        written.add(name);
        scratch.putImageData(tint, 0, 0);
        const png = await new Promise<Blob | null>((done) => hidden.toBlob(done));
        found.digests[kind + 1] = (await api.write(session.name, name, found.digests[kind + 1]!, png!, none)).digest;
      }
      found.corrected = true;
    });
  }

  function draw(): void {
    context.drawImage(picture, 0, 0, width, height);
    if (state === "Photograph" || state === PREVIEW) {
      const colours = new Uint32Array(tint.data.buffer);
      mask.forEach((kind, i) => (colours[i] = state !== PREVIEW ? TINTS[kind]! : kind === shown[i] ? 0 : TINTS[kind]! || KEPT));
      scratch.putImageData(tint, 0, 0);
      context.drawImage(hidden, 0, 0);
    }
    context.strokeStyle = context.fillStyle = "#ff2d1f";
    context.lineWidth = 3;
    context.beginPath();
    corners.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    for (const [x, y] of corners) context.fillRect(x - 4, y - 4, 8, 8);
    const percent = (kind: number): string => {
      const share = (100 * mask.reduce((sum, one) => sum + Number(one === kind), 0)) / mask.length;
      return `${share.toFixed(share && share < 1 ? 2 : 1)} %`;
    };
    facts.textContent = `${percent(GOES)} of the picture will be removed, ${percent(SUN)} as direct sunlight · ${found.corrected ? "corrected by hand" : "as detected"}`;
  }

  function names(): void {
    list.replaceChildren(...known.objects.slice(0, 40).map((one, i) => {
      const box = h("input", { type: "checkbox", checked: mask[one.y * width + one.x] !== 0, change: () => toggle(one.label) });
      const turn = Math.round((one.x / width - 0.5) * 360);
      return h("li", {}, h("label", {}, box, `${one.kind === SUN ? "Sunlight" : "Object"} ${i + 1}, ${Math.abs(turn)}° ${turn < 0 ? "left" : "right"}`));
    }));
  }

  function toggle(label: number): void {
    const before = mask;
    const seed = known.labels.indexOf(label);
    const on = before[seed] ? 0 : found.detected[seed]!;
    change(before.map((old, i) => (known.labels[i] === label ? on : old)));
  }

  function change(changed: Uint8Array): void {
    undo.step(mask);
    void keep(changed);
  }

  async function keep(changed: Uint8Array): Promise<void> {
    changed.forEach((kind, i) => kind !== mask[i] && (found.hand[i] = 1));
    mask = changed;
    draw();
    names();
    try {
      await write();
      facts.dataset.saved = named(found);
      draw();
      if (state === PREVIEW) void preview();
      else note("Saved");
    } catch (error) {
      note(`Not saved: ${(error as Error).message}`, true);
      await refresh();
    }
  }

  const refresh = (): Promise<void> => turns.take(async () => {
    const overview = await api.overview(session.name);
    prepared = null;
    options(overview.states);
    const digests = await Promise.all(["mask", ...LAYERS].map(async (name) => (await api.read(session.name, name, none)).digest));
    if (digests.join() !== named(found)) {
      turns.foreign += 1;
      const now = await masks(overview.sunlight);
      found = now;
      LAYERS.forEach((name) => written.add(name));
      mask = now.now;
      known = objectsIn(now.detected, width, height);
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
    said.textContent = "Emptying a small preview …";
    try {
      await turns.take(async () => undefined); // what is being saved counts
      const answer = await (prepared?.digest === named(found) ? prepared.answer : api.live(session.name, "emptied", {}));
      prepared = null;
      const { seconds, size_px } = factsOf<{ seconds: number; size_px: [number, number] }>(answer);
      if (state !== PREVIEW) return;
      const url = URL.createObjectURL(await answer.blob());
      picture.src = url;
      await picture.decode();
      URL.revokeObjectURL(url);
      shown = made;
      canvas.dataset.shown = PREVIEW;
      canvas.dataset.made = named(found);
      said.textContent = `Preview, ${size_px.join(" × ")}, in ${seconds.toFixed(1)} s: the fill is coarse and shading is from the last run; areas still red are not included`;
      draw();
    } catch (error) {
      note(`No preview: ${(error as Error).message}`, true);
    } finally {
      if (said.textContent === "Emptying a small preview …") said.textContent = "";
    }
  });

  async function forget(): Promise<void> {
    if (!found.corrected) return;
    undo.step(mask);
    for (const name of ["mask", ...LAYERS]) if ((await api.read(session.name, name, none)).corrected) await api.forget(session.name, name);
    await refresh();
  }

  const at = (event: MouseEvent): Point => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };

  /** Set a disc of the mask; the panorama goes on beyond its left and right edge. */
  function disc(into: Uint8Array, [cx, cy]: Point, on: number): void {
    for (let y = Math.max(0, Math.ceil(cy - size)); y <= Math.min(height - 1, cy + size); y += 1) {
      const half = Math.sqrt(Math.max(0, size * size - (y - cy) ** 2));
      for (let x = Math.ceil(cx - half); x <= cx + half; x += 1) into[y * width + ((x + width) % width)] = on;
    }
  }

  function pick(name: typeof tool): void {
    tool = name;
    paints.hidden = name === "object";
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
      change(mask.map((old, i) => (data[4 * i + 3]! >= 128 ? paint : old)));
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
      else note("Nothing detected here: use the brush");
    } else if (tool === "polygon") {
      const first = corners[0];
      if (first && corners.length > 2 && Math.hypot(first[0] - place[0], first[1] - place[1]) < 14) close();
      else corners.push(place);
      draw();
    } else stroke(event);
  });
  canvas.addEventListener("dblclick", () => tool === "polygon" && close());

  function stroke(event: PointerEvent): void {
    canvas.setPointerCapture(event.pointerId);
    const changed = mask.slice();
    const before = mask;
    let last = at(event);
    let waiting = false;
    const soon = (): void => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        draw();
      });
    };
    const move = (next: PointerEvent): void => {
      const place = at(next);
      const steps = Math.max(1, Math.ceil(Math.hypot(place[0] - last[0], place[1] - last[1]) / (size / 3)));
      for (let k = 0; k <= steps; k += 1) disc(changed, [last[0] + ((place[0] - last[0]) * k) / steps, last[1] + ((place[1] - last[1]) * k) / steps], paint);
      last = place;
      mask = changed;
      soon();
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
  const idle = setTimeout(() => {
    if (state === PREVIEW) return;
    prepared = { digest: named(found), answer: api.live(session.name, "emptied", {}) };
    prepared.answer.catch(() => (prepared = null));
  }, IDLE_MS);
  return {
    element: h("section", { class: "wide" }, bar, canvas, facts, said, h("h2", {}, "Detected objects"), list),
    refresh,
    close: () => clearTimeout(idle),
    undo: () => undo.back(mask),
    redo: () => undo.again(mask),
    command: `daylit process ${session.path} --until remove`,
    run: { until: "remove", text: "Empty the room" },
  };
}
