// Results: every state of the room with exposure and probe, the model, and what can be taken away.
import { ModelView } from "../viewer/model";
import { setUpPanorama } from "../viewer/widget";
import { api, type Overview } from "./api";
import { h, note } from "./dom";
import type { Screen } from "./screens";

interface ViewerFacts {
  colours: string;
  range: [number, number];
  ticks: number[];
  unit: string;
}

function markup(json: string): HTMLElement {
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
      h("label", { class: "exposure" }, "Exposure ", h("input", { type: "range", min: -9, max: 9, step: 0.5, value: 0, "data-part": "exposure" }), h("output", { "data-part": "stops" }, "0.0 stops"))),
    h("div", { class: "stage", "data-part": "stage", role: "application", "aria-label": "Panorama to look around in: drag, or arrow keys; plus and minus zoom" },
      h("span", { class: "cross", "aria-hidden": "true" }), h("span", { "data-part": "label", hidden: true }),
      h("div", { class: "scale", "aria-hidden": "true" }, h("span", { class: "unit" }, unit),
        h("div", { class: "ticks" }, ...ticks.map((tick) => h("span", { class: "tick", style: `bottom: ${place(tick)}%` }, String(tick))))),
      h("p", { class: "reading", "data-part": "reading" }, h("strong", { "data-part": "value" }, "…"), " ", h("span", { "data-part": "detail" }, "…"))));
}

export async function resultsScreen(session: Overview): Promise<Screen> {
  const box = h("div", { class: "result" });
  const choice = h("select", { "aria-label": "State of the room", change: () => void show() }, ...session.states.map((name) => h("option", {}, name)));
  const takeaway = h("ul", { class: "downloads" });

  async function show(): Promise<void> {
    const name = choice.value;
    box.replaceChildren(h("p", { class: "facts" }, "Opening …"));
    try {
      const found = markup(await api.viewer(session.name, name));
      box.replaceChildren(found);
      await setUpPanorama(found, true);
      box.dataset.shown = name;
      downloads(name);
      if (name.startsWith("Staged")) await model(name.replace("Staged ", ""));
    } catch (error) {
      note((error as Error).message, true);
    }
  }

  async function model(number: string): Promise<void> {
    const answer = await fetch(api.file(session.name, `render/staged-${number}.glb`));
    if (!answer.ok) return;
    const stage = h("div", { class: "stage light", "data-part": "stage", role: "application", "aria-label": "Model to turn around: drag, or arrow keys" });
    box.append(h("h2", {}, "In three dimensions"), stage);
    await new ModelView(stage).show(await answer.arrayBuffer(), `The room, staged, alternative ${number}`);
    stage.dataset.shown = number;
  }

  function downloads(name: string): void {
    const file = name === "Emptied" ? "remove/empty.exr" : name.startsWith("Staged") ? `render/staged-${name.slice(7)}.exr` : "calibrate/indoor.exr";
    const link = (text: string, href: string, download: string): HTMLElement => h("li", {}, h("a", { href, download }, text));
    takeaway.replaceChildren(
      link("Panorama, JPEG", api.picture(session.name, name, 4096, session.stamp), `${session.name}-${name.toLowerCase().replace(" ", "-")}.jpg`),
      link("Panorama, EXR", api.file(session.name, file), ""),
      ...(name.startsWith("Staged") ? [link("Model, GLB", api.file(session.name, `render/staged-${name.slice(7)}.glb`), "")] : []),
      ...(session.page ? [link("The report, one HTML file", api.file(session.name, "report/index.html"), "")] : []));
  }

  if (session.states.length) await show();
  else box.append(h("p", {}, "There is no picture yet: process the session."));
  return {
    element: h("section", { class: "wide" }, h("div", { class: "bar" }, h("label", {}, "State ", choice)), box, h("h2", {}, "To take away"), takeaway),
    command: `daylit export ${session.path}`,
    run: { until: "report", text: "Bring all results up to date" },
  };
}
