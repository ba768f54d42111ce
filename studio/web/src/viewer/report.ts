// What moves on the report's pages: each panorama and each model gets its view when somebody comes near.
import { fromBase64, quantityText } from "./encoding";
import { ModelView } from "./model";
import { openProbe, readingText } from "./probe";
import { panoramas, part, setUpPanorama } from "./widget";

<<<<<<< HEAD
export { openProbe, panoramas, quantityText, readingText };
/** The models on the page, in its order. */
export const models: ModelView[] = [];

=======
interface State extends Maps {
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
  states: State[];
}

interface Loaded {
  picture: HTMLImageElement;
  probe: Probe;
}

export { openProbe, quantityText, readingText };
/** The views on the page, in its order. */
export const panoramas: PanoramaView[] = [];
export const models: ModelView[] = [];

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

function part<T extends HTMLElement = HTMLElement>(box: Element, name: string): T {
  const found = box.querySelector<T>(`[data-part=${name}]`);
  if (!found) throw new Error(`the page has no ${name}`);
  return found;
}

async function setUpPanorama(box: HTMLElement): Promise<void> {
  const data = JSON.parse(box.querySelector(".viewer-data")!.textContent!) as ViewerData;
  const ramp = fromBase64(data.colours);
  const stage = part(box, "stage");
  const loaded = new Map<number, Promise<Loaded>>();
  let current = 0;
  let stops = 0;
  let coloured = false;
  let pointed: [number, number] | null = null;

  const load = (index: number): Promise<Loaded> => {
    if (!loaded.has(index)) loaded.set(index, fetchState(data.states[index]!));
    return loaded.get(index)!;
  };
  await load(0);
  const view = new PanoramaView(stage, { yaw: data.yaw_deg });

  const show = async (): Promise<void> => {
    const asked = current;
    const { picture, probe } = await load(asked);
    if (asked !== current) return; // somebody has chosen another state meanwhile
    const [width, height] = data.states[asked]!.map_px;
    if (coloured) view.colours(falseColours(probe.luminance, data.range, ramp), width, height);
    else view.picture(picture, true);
    expose();
    await read();
  };
  const expose = (): void => {
    view.expose(data.middle * 2 ** stops);
    box.dataset.shown = `${current} ${coloured ? "colours" : stops}`;
  };
  const read = async (): Promise<void> => {
    const { probe } = await load(current);
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
}

async function fetchState(state: State): Promise<Loaded> {
  const picture = new Image();
  picture.src = URL.createObjectURL(new Blob([fromBase64(state.jpeg)], { type: "image/jpeg" }));
  const [probe] = await Promise.all([openProbe(state), picture.decode()]);
  return { picture, probe };
}

>>>>>>> 3468e0e (Stills: three to six framed pictures a room, each with its original, light and statement; report in the room's display)
async function setUpModels(box: HTMLElement): Promise<void> {
  const files = [...box.querySelectorAll<HTMLElement>(".model-data")];
  const view = new ModelView(part(box, "stage"));
  models.push(view);
  const show = async (index: number): Promise<void> => {
    box.classList.remove("ready");
    await view.show(fromBase64(files[index]!.textContent!).buffer, files[index]!.dataset.alt ?? "");
    box.classList.add("ready");
  };
  box.querySelectorAll("[data-model]").forEach((choice, index) => choice.addEventListener("change", () => void show(index)));
  await show(0);
}

/** Megabytes are unpacked when somebody comes near, not before. */
function whenNear(box: HTMLElement, setUp: (box: HTMLElement) => Promise<unknown>): void {
  const watch = new IntersectionObserver((seen) => {
    if (!seen.some((one) => one.isIntersecting)) return;
    watch.disconnect();
    setUp(box).catch((error: unknown) => {
      const note = box.querySelector<HTMLElement>("[data-part=missing]");
      if (!note) return;
      note.hidden = false;
      note.textContent = `This view needs WebGL and a browser of 2023 or later. ${String(error)}`;
    });
  }, { rootMargin: "600px" });
  watch.observe(box);
}

document.querySelectorAll<HTMLElement>(".viewer").forEach((box) => whenNear(box, (one) => setUpPanorama(one)));
document.querySelectorAll<HTMLElement>(".models").forEach((box) => whenNear(box, setUpModels));
