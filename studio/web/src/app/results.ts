// Results: every state of the room with exposure and probe, stills aimed by hand, the model, and what can be taken away.
import { ModelView } from "../viewer/model";
import { PanoramaView, RAD } from "../viewer/panorama";
import { setUpPanorama, type Widget } from "../viewer/widget";
import { api, type Overview } from "./api";
import { markup, Regions } from "./box";
import { button, h, note } from "./dom";
import type { Screen } from "./screens";
import { Undo } from "./undo";

const LENSES_MM = [16, 18, 20, 24, 28, 35];
/** Full frame, on which lenses are named; a still has its shape. */
const SENSOR_MM = { wide: 36, high: 24 };
const MOST_DROP = 0.3;
const MOST_FRAMES = 6;

export async function resultsScreen(session: Overview): Promise<Screen> {
  const box = h("div", { class: "result" });
  const choice = h("select", { "aria-label": "State of the room", change: () => void show() }, ...session.states.map((name) => h("option", {}, name)));
  const other = h("select", { "aria-label": "Compare with", change: () => void compare() },
    h("option", { value: "" }, "nothing"), ...session.states.map((name) => h("option", {}, name)));
  const pair = h("div", { class: "pair", hidden: true });
  let beside: PanoramaView[] = [];
  const takeaway = h("ul", { class: "downloads" });
  const stills = h("div", { class: "stills" });
  const command = new Text("");
  let widget: Widget | null = null;
  let aims = String(session.chosen.aim ?? "").split(";").filter(Boolean);
  const undo = new Undo<string[]>((before) => list(before));
  const aiming = new Aiming((frame) => {
    if (aims.length >= MOST_FRAMES) return note(`At most ${MOST_FRAMES} frames`, true);
    undo.step(aims);
    list([...aims, frame]);
  });
  const frames = h("ol", { class: "aims" });
  const make = button("Make these stills", () => void api.run(session.name, { aim: aims }).catch((error: unknown) => note((error as Error).message, true)), { class: "main" });

  const prove = button("Make the proof", () => void api.run(session.name, { proof: true }).catch((error: unknown) => note((error as Error).message, true)));

  function list(now: string[]): void {
    aims = now;
    frames.replaceChildren(...aims.map((frame, i) => {
      const [yaw, lens, drop] = frame.split(",").map(Number) as [number, number, number?];
      const text = `${Math.abs(yaw)}° ${yaw < 0 ? "left" : "right"}, ${lens} mm${drop ? `, shifted down ${(100 * drop).toFixed(0)} %` : ""} `;
      return h("li", {}, text, button("Remove", () => {
        undo.step(aims);
        list(aims.filter((_, k) => k !== i));
      }, { "aria-label": `Remove frame ${i + 1}` }));
    }));
    make.disabled = !aims.length;
    command.data = aims.length ? `daylit stills ${session.path} ${aims.map((one) => `--aim=${one}`).join(" ")}` : `daylit export ${session.path}`;
  }

  async function show(): Promise<void> {
    const name = choice.value;
    widget?.view.dispose();
    widget = null;
    box.replaceChildren(h("p", { class: "facts" }, "Opening …"));
    try {
      const regions = new Regions(name === "Emptied" ? "" : session.path); // shown with its sun, which its file is without
      const found = markup(await api.viewer(session.name, name), regions.control, ...aiming.controls);
      box.replaceChildren(found, regions.said);
      widget = await setUpPanorama(found, true);
      regions.on(widget);
      aiming.on(widget.view, found.querySelector(".stage")!);
      box.dataset.shown = name;
      downloads(name, widget.file.replace("stages/", ""));
      void compare();
      if (name.startsWith("Staged")) await model(name.replace("Staged ", ""));
    } catch (error) {
      note((error as Error).message, true);
    }
  }

  /** Two states side by side, in the same look: whoever turns one turns both. */
  async function compare(): Promise<void> {
    const [was] = beside;
    const from = was ?? widget?.view;
    beside.forEach((view) => view.dispose());
    pair.replaceChildren();
    pair.hidden = !other.value;
    delete pair.dataset.shown;
    if (!other.value) return void (beside = []);
    const names = [choice.value, other.value];
    beside = names.map((name) => {
      const stage = h("div", { class: "stage", role: "application", "aria-label": `${name}: drag or arrow keys to look around` });
      pair.append(h("figure", {}, stage, h("figcaption", {}, name)));
      const view = new PanoramaView(stage, { wheel: true, yaw: from?.yaw ?? 0 });
      view.changed = () => beside.forEach((one) => {
        if (one !== view && (one.yaw !== view.yaw || one.pitch !== view.pitch || one.field !== view.field)) one.look(view.yaw, view.pitch, view.field);
      });
      return view;
    });
    const views = beside;
    try {
      const pictures = await Promise.all(names.map(async (name) => {
        const image = new Image();
        image.src = api.picture(session.name, name, 4096, session.stamp);
        await image.decode();
        return image;
      }));
      if (views !== beside) return; // another was chosen meanwhile
      views.forEach((view, i) => view.picture(pictures[i]!, false));
      pair.dataset.shown = names.join(" | ");
    } catch (error) {
      note(`No comparison: ${(error as Error).message}`, true);
    }
  }

  async function model(number: string): Promise<void> {
    const answer = await fetch(api.file(session.name, `render/staged-${number}.glb`));
    if (!answer.ok) return;
    const stage = h("div", { class: "stage light", "data-part": "stage", role: "application", "aria-label": "Model to turn around: drag, or arrow keys" });
    box.append(h("h2", {}, "3D model"), stage);
    await new ModelView(stage).show(await answer.arrayBuffer(), `The room, staged, alternative ${number}`);
    stage.dataset.shown = number;
  }

  /** Show the stills that there are. */
  async function made(): Promise<void> {
    if (!(await api.overview(session.name)).stages?.includes("stills")) return;
    const answer = await fetch(api.file(session.name, "stills/stills.json"));
    if (!answer.ok) return;
    const { stills: all } = (await answer.json()) as { stills: { file: string; state: string; lens_mm: number; yaw_deg: number }[] };
    const at = Date.now();
    stills.replaceChildren(...all.map((one, i) => {
      const file = api.file(session.name, `stills/${one.file}`);
      return h("figure", {}, h("a", { href: file, download: one.file }, h("img", { src: `${file}?at=${at}`, alt: `Still ${i + 1}, ${one.state}`, loading: "lazy" })),
        h("figcaption", {}, `${one.state.replace("-", " ")}, ${one.lens_mm} mm`));
    }));
    stills.dataset.count = String(all.length);
  }

  function downloads(name: string, file: string): void {
    const link = (text: string, href: string, download: string): HTMLElement => h("li", {}, h("a", { href, download }, text));
    takeaway.replaceChildren(
      link("Panorama, JPEG", api.picture(session.name, name, 4096, session.stamp), `${session.name}-${name.toLowerCase().replace(" ", "-")}.jpg`),
      link(`Panorama, EXR${name === "Emptied" ? ", no direct sun put back" : ""}`, api.file(session.name, file), ""),
      ...(name.startsWith("Staged") ? [link("Model, GLB", api.file(session.name, `render/staged-${name.slice(7)}.glb`), "")] : []),
      ...(session.page ? [
        link("Client report, one HTML file", api.file(session.name, "report/index.html"), ""),
        link("Technical report with uncertainties, one HTML file", api.file(session.name, "report/lab.html"), "")] : []));
  }

  list(aims);
  if (session.states.length) await Promise.all([show(), made()]);
  else box.append(h("p", {}, "No picture yet: process the session."));
  return {
    element: h("section", { class: "wide" }, h("div", { class: "bar" }, h("label", {}, "State ", choice), h("label", {}, "Compare with ", other)), pair, box,
      h("h2", {}, "Stills"), frames, h("div", { class: "bar" }, make, button("Undo", () => undo.back(aims), { "data-part": "undo" }), button("Redo", () => undo.again(aims))), stills,
      h("h2", {}, "Downloads"), takeaway,
      h("p", { class: "facts" }, "Proof of the stills: originals beside results, what was added and removed, digests chained to the frames. ", prove)),
    refresh: made,
    undo: () => undo.back(aims),
    redo: () => undo.again(aims),
    command,
    run: { until: "report", text: "Bring all results up to date" },
    close: () => [widget?.view, ...beside].forEach((view) => view?.dispose()),
  };
}

/** A still's frame on the panorama: verticals stay upright, so that looking up and down shifts the lens instead. */
class Aiming {
  readonly controls: HTMLElement[];
  private view: PanoramaView | null = null;
  private readonly shape = h("div", { class: "frame aim", hidden: true });
  private readonly lens = h("select", { "aria-label": "Lens, mm", change: () => this.draw() }, ...LENSES_MM.map((mm) => h("option", { value: mm, selected: mm === 20 }, `${mm} mm`)));
  private readonly toggle = button("Aim a still", () => this.turn(), { "aria-pressed": "false", "data-part": "aim" });
  private readonly take: HTMLButtonElement;
  private drop = 0.08;
  private active = false;

  constructor(taken: (frame: string) => void) {
    this.take = button("Take this frame", () => taken([this.view!.yaw.toFixed(1), this.lens.value, this.drop.toFixed(2)].join(",")), { hidden: true, class: "main" });
    this.lens.hidden = true;
    this.controls = [this.toggle, this.lens, this.take];
  }

  /** Aim in this view from now on. */
  on(view: PanoramaView, stage: HTMLElement): void {
    this.view = view;
    stage.append(this.shape);
    const before = view.changed;
    view.changed = () => {
      this.draw();
      before();
    };
    this.draw();
  }

  private turn(): void {
    this.active = !this.active;
    this.toggle.setAttribute("aria-pressed", String(this.active));
    this.lens.hidden = this.take.hidden = this.shape.hidden = !this.active;
    if (this.active) this.view?.look(this.view.yaw, 0);
    this.draw();
  }

  private draw(): void {
    const { view } = this;
    if (!view || !this.active) return;
    const lens = Number(this.lens.value);
    if (view.pitch) {
      this.drop = Math.max(0, Math.min(MOST_DROP, this.drop - (Math.tan(view.pitch * RAD) * lens) / SENSOR_MM.high));
      view.pitch = 0;
      view.draw();
    }
    const { clientWidth: wide, clientHeight: high } = view.stage;
    // The whole frame is seen, however the page's shape and the lens change.
    const half = Math.max(SENSOR_MM.wide / 2 / lens, ((SENSOR_MM.high / lens) * (0.5 + this.drop) * wide) / Math.max(1, high));
    const needed = Math.min(140, (2 * Math.atan(1.05 * half)) / RAD);
    if (view.field < needed) {
      view.field = needed;
      view.draw();
    }
    const perTan = wide / 2 / Math.tan((view.field / 2) * RAD);
    const [w, t] = [(SENSOR_MM.wide / lens) * perTan, (SENSOR_MM.high / lens) * perTan];
    this.shape.setAttribute("style", `left: ${(wide - w) / 2}px; top: ${high / 2 + this.drop * t - t / 2}px; width: ${w}px; height: ${t}px`);
  }
}
