// What moves on the report's pages: each panorama and each model gets its view when somebody comes near.
import { fromBase64, quantityText } from "./encoding";
import { placeIn, regionText, rulerText } from "./measure";
import { ModelView } from "./model";
import { openProbe, readingText } from "./probe";
import { panoramas, part, setUpPanorama } from "./widget";

export { openProbe, panoramas, placeIn, quantityText, readingText, regionText, rulerText };
/** The models on the page, in its order. */
export const models: ModelView[] = [];

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
