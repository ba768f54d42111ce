// The viewer's controls, as the report's page has them, and boxes drawn in it that are measured.
import { quantityText } from "../viewer/encoding";
import { clippedText, type Direction } from "../viewer/measure";
import type { Widget } from "../viewer/widget";
import { button, h, note } from "./dom";

/** Half a side of what the key measures, degrees. */
const MIDDLE_DEG = 5;

interface ViewerFacts {
  colours: string;
  range: [number, number];
  ticks: number[];
  unit: string;
}

/** Return the box that `setUpPanorama` brings to life; `more`: further controls in its bar. */
export function markup(json: string, ...more: HTMLElement[]): HTMLElement {
  const { colours, range, ticks, unit } = JSON.parse(json) as ViewerFacts;
  const bytes = Uint8Array.from(atob(colours), (c) => c.charCodeAt(0));
  const ramp = Array.from({ length: 18 }, (_, i) => `rgb(${bytes.slice(45 * i, 45 * i + 3).join(" ")})`).join(", ");
  const data = h("script", { type: "application/json", class: "viewer-data" });
  data.textContent = json;
  const mode = (name: string, text: string, checked: boolean): HTMLElement =>
    h("label", {}, h("input", { type: "radio", name: "mode", "data-mode": name, checked }), h("span", {}, text));
  const place = (value: number): number => (100 * Math.log(value / range[0])) / Math.log(range[1] / range[0]);
  return h("div", { class: "viewer", style: `--ramp: linear-gradient(to top, ${ramp})` }, data,
    h("div", { class: "bar" },
      h("select", { "data-part": "state", hidden: true, "aria-label": "State" }, h("option", { value: 0 })),
      h("fieldset", { class: "segments" }, h("legend", { class: "unseen" }, "Show"), mode("picture", "Picture", true), mode("colours", "Luminance", false)),
      h("label", { class: "exposure" }, "Exposure ", h("input", { type: "range", min: -9, max: 9, step: 0.5, value: 0, "data-part": "exposure" }), h("output", { "data-part": "stops" }, "0.0 stops")), ...more),
    h("div", { class: "stage", "data-part": "stage", role: "application", "aria-label": "Panorama to look around in: drag, or arrow keys; plus and minus zoom" },
      h("span", { class: "cross", "aria-hidden": "true" }), h("span", { "data-part": "label", hidden: true }),
      h("div", { class: "scale", "aria-hidden": "true" }, h("span", { class: "unit" }, unit),
        h("div", { class: "ticks" }, ...ticks.map((tick) => h("span", { class: "tick", style: `bottom: ${place(tick)}%` }, String(tick))))),
      h("p", { class: "reading", "data-part": "reading" }, h("strong", { "data-part": "value" }, "…"), " ", h("span", { "data-part": "detail" }, "…"))));
}

/** Statistics of luminance within a box that is drawn in the picture, or (M) around its cross. */
export class Regions {
  readonly said = h("p", { class: "facts", "data-part": "region", role: "status" });
  readonly control = button("Measure a region", () => this.frame(), { "data-part": "frame", title: "M: 10° around the cross" });
  private widget!: Widget;

  /** `session`: where its pictures' files are; empty: what is measured is in none. */
  constructor(private readonly session = "") {}

  on(widget: Widget): void {
    this.widget = widget;
    const { view } = widget;
    view.stage.addEventListener("keydown", (event) => {
      if (event.key !== "m" && event.key !== "M") return;
      void this.measure([view.yaw - MIDDLE_DEG, Math.min(89, view.pitch + MIDDLE_DEG)], [view.yaw + MIDDLE_DEG, Math.max(-89, view.pitch - MIDDLE_DEG)]);
    });
  }

  /** Let the next drag on the picture be the box. */
  private frame(): void {
    const { view } = this.widget;
    const { stage } = view;
    view.held = true;
    stage.classList.add("framing");
    note("Draw a box in the picture");
    stage.addEventListener("pointerdown", (down) => {
      const origin = stage.getBoundingClientRect();
      const shape = h("div", { class: "frame" });
      stage.append(shape);
      stage.setPointerCapture(down.pointerId);
      const sides = (event: PointerEvent): [number, number, number, number] => [
        Math.min(down.clientX, event.clientX), Math.min(down.clientY, event.clientY), Math.max(down.clientX, event.clientX), Math.max(down.clientY, event.clientY)];
      const move = (event: PointerEvent): void => {
        const [x0, y0, x1, y1] = sides(event);
        shape.setAttribute("style", `left: ${x0 - origin.left}px; top: ${y0 - origin.top}px; width: ${x1 - x0}px; height: ${y1 - y0}px`);
      };
      stage.addEventListener("pointermove", move);
      stage.addEventListener("pointerup", (up) => {
        stage.removeEventListener("pointermove", move);
        stage.classList.remove("framing");
        view.held = false;
        shape.remove();
        const [x0, y0, x1, y1] = sides(up);
        void this.measure(view.directionAt({ clientX: x0, clientY: y0 }), view.directionAt({ clientX: x1, clientY: y1 }));
      }, { once: true });
    }, { once: true });
  }

  private async measure(from: Direction, to: Direction): Promise<void> {
    const { unit, file } = this.widget;
    const found = (await this.widget.probe()).within(from, to);
    if (!found.steradians) return note("Nothing to measure: no pixel there has a value", true);
    const parts = (["mean", "median", "lowest", "highest"] as const).map((name) => `${name} ${quantityText(found[name], found[name] * found.relativeUncertainty)}`);
    this.said.textContent = `Region: ${parts.join(", ")} ${unit.replace("m2", "m²")}${clippedText(found.clipped)}`;
    if (this.session && found.box_px) this.said.append(" · ", h("code", {}, `daylit figures ${this.session}/${file} --region ${found.box_px.join(",")}`));
  }
}
