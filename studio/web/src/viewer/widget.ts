// A panorama with exposure, false colours and probe: the page has the controls, this moves them.
import { fromBase64, LEAST, type Size, STEP } from "./encoding";
import { type Direction, drawnPoints, outline, regionText, type Room, rulerText } from "./measure";
import { PanoramaView } from "./panorama";
import { type Maps, openProbe, type Probe, readingText } from "./probe";

export interface State extends Maps {
  name: string;
  jpeg: string;
  file: string;
  staged: boolean;
}

interface ViewerData {
  middle: number;
  range: Size;
  unit: string;
  yaw_deg: number;
  label: string;
  colours: string;
  room?: Room | null;
  states: State[];
}

interface Loaded {
  picture: HTMLImageElement;
  probe: Probe;
}

/** The views on the page, in its order. */
export const panoramas: PanoramaView[] = [];

/** Colours (4 bytes a place) of codes of luminance, from `low` to `high` by the ramp of 256; grey where no value is. */
export function falseColours(codes: Uint16Array, [low, high]: Size, ramp: Uint8Array): Uint8ClampedArray<ArrayBuffer> {
  const shown = new Uint8ClampedArray(4 * codes.length);
  const perStep = 256 / Math.log(high / low);
  const first = Math.log(low / LEAST);
  codes.forEach((code, i) => {
    const level = Math.max(0, Math.min(255, Math.floor(((code - 1) * STEP - first) * perStep)));
    for (let c = 0; c < 3; c += 1) shown[4 * i + c] = code === 0 ? 64 : ramp[3 * level + c]!;
    shown[4 * i + 3] = 255;
  });
  return shown;
}

export function part<T extends HTMLElement = HTMLElement>(box: Element, name: string): T {
  const found = box.querySelector<T>(`[data-part=${name}]`);
  if (!found) throw new Error(`the page has no ${name}`);
  return found;
}

/** A panorama with its controls: its view, and what shows another picture in it as the controls stand. */
export interface Widget {
  view: PanoramaView;
  /** Of luminance. */
  unit: string;
  /** Of the picture that it began with, in its session; empty: none. */
  file: string;
  replace(state: State): Promise<void>;
  probe(): Promise<Probe>;
}

export async function setUpPanorama(box: HTMLElement, wheel = false): Promise<Widget> {
  const data = JSON.parse(box.querySelector(".viewer-data")!.textContent!) as ViewerData;
  const ramp = fromBase64(data.colours);
  const stage = part(box, "stage");
  const loaded = new Map<number, Promise<Loaded>>();
  let current = 0;
  let stops = 0;
  let coloured = false;
  let pointed: [number, number] | null = null;
  let range = data.range;
  let tool = "look";
  let measured: [Direction, Direction] | null = null;

  const load = (index: number): Promise<Loaded> => {
    if (!loaded.has(index)) loaded.set(index, fetchState(data.states[index]!));
    return loaded.get(index)!;
  };
  await load(0);
  const view = new PanoramaView(stage, { yaw: data.yaw_deg, wheel });

  const show = async (): Promise<void> => {
    const asked = current;
    const { picture, probe } = await load(asked);
    if (asked !== current) return; // somebody has chosen another state meanwhile
    const [width, height] = data.states[asked]!.map_px;
    if (coloured) view.colours(falseColours(probe.luminance, range, ramp), width, height);
    else view.picture(picture, true);
    expose();
    await read();
  };
  const expose = (): void => {
    view.expose(data.middle * 2 ** stops);
    box.dataset.shown = `${current} ${coloured ? "colours" : stops}`;
  };
  const measure = ({ probe }: Loaded): boolean => {
    const points = measured ? drawnPoints(view, outline(tool, data.room ?? null, ...measured)) : "";
    box.querySelector("[data-part=drawn]")?.setAttribute("points", points);
    if (!measured) return false;
    const region = probe.within(...measured);
    const text = tool === "ruler" && data.room ? rulerText(data.room, ...measured) : regionText(region, data.unit);
    part(box, "value").textContent = text.value;
    part(box, "detail").textContent = text.detail;
    Object.assign(part(box, "reading").dataset, { mean: region.mean });
    return true;
  };
  const read = async (): Promise<void> => {
    const found = await load(current);
    if (measure(found)) return;
    const { probe } = found;
    const [longitude, latitude] = pointed ?? [view.yaw, view.pitch];
    const reading = probe.at(longitude, latitude);
    const text = readingText(reading, longitude, latitude, data.unit);
    const shown = part(box, "reading");
    // Unrounded, for those who read the page by program.
    Object.assign(shown.dataset, { luminance: reading.luminance, x: reading.x, y: reading.y });
    shown.setAttribute("aria-live", pointed ? "off" : "polite");
    part(box, "value").textContent = text.value;
    part(box, "detail").textContent = `${pointed ? "under the pointer" : "at the cross"} · ${text.detail}`;
    stage.classList.toggle("pointed", pointed !== null);
  };

  view.changed = () => void read();
  const canvas = view.canvas;
  canvas.addEventListener("pointerdown", (event) => {
    if (tool === "look") return;
    const at = view.directionAt(event);
    measured = [at, at];
    canvas.setPointerCapture(event.pointerId);
    void read();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (tool === "look" || !measured || !(event.buttons & 1)) return;
    measured = [measured[0], view.directionAt(event)];
    void read();
  });
  for (const choice of box.querySelectorAll<HTMLElement>("[data-tool]"))
    choice.addEventListener("change", () => {
      tool = choice.dataset.tool!;
      view.held = tool !== "look";
      measured = null;
      void read();
    });
  for (const [name, end] of [["low", 0], ["high", 1]] as const)
    box.querySelector(`[data-part=${name}]`)?.addEventListener("change", () => {
      const ends = ["low", "high"].map((each) => Number(part<HTMLInputElement>(box, each).value)) as [number, number];
      const sound = ends[0] > 0 && ends[1] > ends[0];
      if (sound) range = ends;
      else part<HTMLInputElement>(box, name).value = String(range[end]);
      part(box, "ticks").replaceChildren(...ticksOf(range));
      void show();
    });
  stage.addEventListener("pointermove", (event) => {
    pointed = event.pointerType === "mouse" ? view.directionAt(event) : null;
    void read();
  });
  stage.addEventListener("pointerleave", () => {
    pointed = null;
    void read();
  });
  part<HTMLInputElement>(box, "exposure").addEventListener("input", (event) => {
    stops = Number((event.target as HTMLInputElement).value);
    part(box, "stops").textContent = `${stops > 0 ? "+" : ""}${stops.toFixed(1)} stops`;
    expose();
  });
  for (const choice of box.querySelectorAll<HTMLElement>("[data-mode]"))
    choice.addEventListener("change", () => {
      coloured = choice.dataset.mode === "colours";
      box.classList.toggle("coloured", coloured);
      void show();
    });
  part<HTMLSelectElement>(box, "state").addEventListener("change", (event) => {
    current = Number((event.target as HTMLSelectElement).value);
    part(box, "label").hidden = !(data.label && data.states[current]!.staged);
    void show();
  });
  panoramas.push(view);
  await show();
  box.classList.add("ready");
  return {
    view,
    unit: data.unit,
    file: data.states[0]!.file,
    replace: async (state) => {
      data.states[current] = state;
      loaded.delete(current);
      await show();
    },
    probe: async () => (await load(current)).probe,
  };
}

/** Marks of a scale at 1, 2, 5, 10 ... between its ends. */
function ticksOf([low, high]: Size): HTMLElement[] {
  const found: HTMLElement[] = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += 1)
    for (const digit of Math.log10(high / low) > 2.5 ? [1] : [1, 2, 5]) {
      const value = digit * 10 ** power;
      if (value < low || value > high) continue;
      const tick = document.createElement("span");
      tick.className = "tick";
      tick.style.bottom = `${(100 * Math.log(value / low)) / Math.log(high / low)}%`;
      tick.textContent = String(Number(value.toPrecision(3)));
      found.push(tick);
    }
  return found;
}

async function fetchState(state: State): Promise<Loaded> {
  const picture = new Image();
  picture.src = URL.createObjectURL(new Blob([fromBase64(state.jpeg)], { type: "image/jpeg" }));
  const [probe] = await Promise.all([openProbe(state), picture.decode()]);
  URL.revokeObjectURL(picture.src);
  return { picture, probe };
}
