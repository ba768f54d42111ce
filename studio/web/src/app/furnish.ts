// Furnish: pieces on the plan, dragged, turned and exchanged, with the judge's verdict and their light while they move.
import { PanoramaView, RAD } from "../viewer/panorama";
import { api, factsOf, type Overview, type Piece, type Point, type Pose, type Room } from "./api";
import { button, h, note, svg } from "./dom";
import { ARROWS, draggable, Plan } from "./plan";
import { round } from "./rooms";
import type { Screen } from "./screens";
import { Latest, Turns, Undo } from "./undo";

interface Arranged {
  arrangements: { items: Piece[] }[];
}
type Places = Record<string, Pose>;

const TURN = Math.PI / 12;
const SNAP_RAD = 0.07;
const read = async (answer: Response): Promise<Piece[]> => ((await answer.json()) as Arranged).arrangements[0]?.items ?? [];
const placesOf = (pieces: Piece[]): Places => Object.fromEntries(pieces.map((one) => [one.id, [one.t_m[0], one.t_m[1], one.theta_rad, one.model]]));
const named = (text: string): string => text.replaceAll("-", " ");
/** Beyond this to the side, degrees, a piece that is chosen is turned to. */
const ASIDE = 35;

export async function furnishScreen(session: Overview): Promise<Screen> {
  const room = (await api.read<Room>(session.name, "room", async (answer) => (await answer.json()) as Room)).value;
  const designs = await api.designs(session.name);
  let found = await api.read(session.name, "arrangement", read);
  let pieces = found.value;
  let places = placesOf(pieces);
  let broken: string[] = [];
  let focused = "";
  let kept = 0;
  const turns = new Turns();
  const verdicts = new Latest();
  const lights = new Latest();
  const undo = new Undo<Places>((before) => void keep(before, places));
  /** Once what was done before is judged and saved: only then is it a step. */
  const back = (): void => void turns.take(async () => undo.back(places));
  const again = (): void => void turns.take(async () => undo.again(places));
  const verdict = h("p", { class: "verdict", "data-part": "verdict", role: "status" });
  const plan = new Plan(room.floor, "Plan: drag pieces; R rotates, Delete removes").showing(room);
  const layer = svg("g");
  const bar = h("div", { class: "bar" },
    button("Undo", back, { "data-part": "undo" }), button("Redo", again),
    button("Rotate (R)", () => turn(TURN)), button("Remove", away), button("As arranged", () => void forget()));
  const list = h("ul", { class: "pieces" });
  const stage = h("div", { class: "stage preview opening", role: "application", "aria-label": "Preview: drag or arrow keys to look around" });
  const said = h("p", { class: "facts", "data-part": "lit", role: "status" }, "Computing the room's light: the first time takes a few seconds …");
  const view = new PanoramaView(stage, { wheel: true, field: 115 });
  const middle = [0, 1].map((k) => pieces.reduce((sum, one) => sum + one.t_m[k]!, 0)) as Point;
  view.look(Math.atan2(...middle) / RAD, -14);
  const empty = new Image();
  empty.src = api.picture(session.name, session.states.includes("Emptied") ? "Emptied" : "Photograph", 2048, session.stamp);
  empty.decode().then(() => said.dataset.seconds ?? show(empty), () => undefined);
  const show = (picture: TexImageSource): void => {
    view.picture(picture, false);
    stage.classList.remove("opening");
  };

  plan.element.append(svg("circle", { class: "camera", r: 1.3 * plan.scale }), layer);

  function place(mark: SVGGElement, id: string): void {
    const [x, y, theta] = places[id]!;
    mark.setAttribute("transform", `translate(${x} ${-y}) rotate(${(-theta * 180) / Math.PI})`);
    const upside = Math.cos(theta) < -0.01;
    mark.querySelector("text")!.setAttribute("transform", upside ? "rotate(180)" : "");
  }

  const marks = (): SVGGElement[] => [...layer.querySelectorAll<SVGGElement>(".piece")];

  function draw(): void {
    layer.replaceChildren(...pieces.filter((one) => places[one.id]).map((one) => {
      const [w, d] = one.size_m;
      const name = named(one.id);
      const mark = svg("g", { class: "piece", tabindex: 0, role: "button", "aria-label": name, "data-id": one.id },
        svg("rect", { x: -w / 2, y: -d / 2, width: w, height: d, rx: 0.04 }),
        svg("line", { class: "front", x1: -w / 2 + 0.05, x2: w / 2 - 0.05, y1: -d / 2 + 0.05, y2: -d / 2 + 0.05 }),
        svg("text", { "font-size": Math.max(1.6 * plan.scale, Math.min(2.6 * plan.scale, (1.7 * w) / name.length)) }, name));
      place(mark, one.id);
      mark.addEventListener("focus", () => choose(one.id));
      mark.addEventListener("keydown", (event) => key(event, one.id));
      draggable(mark, (down) => drag(down, one.id));
      return mark;
    }));
    list.replaceChildren(...pieces.map((one) => {
      const design = places[one.id]?.[3] ?? one.model;
      const kinds = Object.keys(designs[one.category] ?? {});
      const within = (kind: string): string => kinds.find((base) => base !== one.category && kind.startsWith(`${base}/`)) ?? kind;
      const shape = within(design);
      const last = (kind: string): string => named(kind.split("/").at(-1)!);
      const pick = h("select", { "aria-label": `Design of ${named(one.id)}`, disabled: !places[one.id], change: () => exchange(one.id, pick.value) },
        ...[...new Set([...kinds.map(within), shape])].map((kind) => h("option", { value: kind, selected: kind === shape }, kind === one.category ? "Room's style" : last(kind))));
      const finishes = kinds.filter((kind) => kind !== shape && within(kind) === shape);
      const finish = h("select", { "aria-label": `Finish of ${named(one.id)}`, title: finishes.length ? "" : "Choose a design, then its finish", disabled: !places[one.id] || !finishes.length, change: () => exchange(one.id, finish.value) },
        h("option", { value: shape }, "As designed"),
        ...finishes.map((kind) => h("option", { value: kind, selected: kind === design }, `As ${last(kind)}`)));
      return h("li", { "data-piece": one.id }, h("label", {},
        h("input", { type: "checkbox", checked: Boolean(places[one.id]), change: () => putBack(one) }), named(one.id)),
        h("span", { class: "facts" }, `${one.size_m.map((m) => m.toFixed(2)).join(" × ")} m`), pick, finish);
    }));
    say();
  }

  function say(): void {
    verdict.textContent = broken.length ? `Not allowed: ${broken.join("; ")}` : "All rules met";
    verdict.classList.toggle("bad", broken.length > 0);
    for (const mark of marks()) mark.classList.toggle("wrong", broken.some((line) => new RegExp(`\\b${mark.dataset.id}\\b`).test(line)));
  }

  /** Turn to a piece that is out of sight. */
  function choose(id: string): void {
    focused = id;
    const [x, y] = places[id]!;
    const yaw = Math.atan2(x, y) / RAD;
    if (Math.abs(((yaw - view.yaw + 540) % 360) - 180) > ASIDE) view.look(yaw, view.pitch);
  }

  /** Places with a piece where it is put, or taken away, and all that stands on it with it. */
  function put(from: Places, id: string, to: Pose | null): Places {
    const { [id]: was, ...others } = from;
    const now: Places = to ? { ...others, [id]: to } : others;
    for (const top of pieces.filter((one) => one.group === id && one.t_m[2] > 0 && others[one.id])) {
      const [x, y, theta, design] = others[top.id]!;
      delete now[top.id];
      if (!to || !was) continue;
      const [dx, dy, by] = [x - was[0], y - was[1], to[2] - was[2]];
      const [c, s] = [Math.cos(by), Math.sin(by)];
      now[top.id] = [round(to[0] + c * dx - s * dy), round(to[1] + s * dx + c * dy), theta + by, design];
    }
    return now;
  }

  const exchange = (id: string, design: string): void => {
    const [x, y, theta] = places[id]!;
    void keep({ ...places, [id]: [x, y, theta, design] }, places, true);
  };

  /** Show the furniture that stands so, with its light. */
  const light = (asked: Places): Promise<void> => lights.ask(async () => {
    const begin = performance.now();
    try {
      const answer = await api.live(session.name, "staged", { places: asked });
      const picture = await createImageBitmap(await answer.blob());
      show(picture);
      said.classList.remove("bad");
      said.dataset.seconds = String((performance.now() - begin) / 1000);
      said.dataset.worked = String(factsOf<{ seconds: number }>(answer).seconds);
      said.textContent = "Preview in the captured light: furniture only, with soft shading. Decor, mirrors and full sharpness come with the render.";
    } catch (error) {
      said.classList.add("bad");
      said.textContent = `No preview: ${(error as Error).message}`;
    }
  });

  /** While pieces move; a verdict that comes when something else has been kept is of no place that stands. */
  const judge = (asked: Places): Promise<void> => {
    const then = kept;
    return verdicts.ask(async () => {
      const found = await api.judge(session.name, asked);
      if (then !== kept) return;
      broken = found;
      say();
    });
  };

  function drag(down: PointerEvent, id: string): { move: (event: PointerEvent) => void; end: () => void } {
    const [start, before] = [plan.at(down), places];
    const [x, y, ...rest] = before[id]!;
    return {
      move: (event) => {
        const here = plan.at(event);
        places = put(before, id, [round(x + here[0] - start[0]), round(y + here[1] - start[1]), ...rest]);
        for (const mark of marks()) place(mark, mark.dataset.id!);
        void judge(places);
        void light(places);
      },
      end: () => {
        if (places !== before) void keep(places, before, true);
      },
    };
  }

  function key(event: KeyboardEvent, id: string): void {
    const arrow = ARROWS[event.key];
    const [x, y, ...rest] = places[id]!;
    const by = event.shiftKey ? 0.1 : 0.02;
    if (arrow) move(id, [round(x + arrow[0] * by), round(y + arrow[1] * by), ...rest]);
    else if (event.key === "r" || event.key === "R") turn(event.shiftKey ? -TURN : TURN);
    else if (event.key === "Delete" || event.key === "Backspace") away();
    else return;
    event.preventDefault();
  }

  const move = (id: string, to: Pose): void => void keep(put(places, id, to), places, true);

  /** Turn by a step; nearly along a wall it is along it. */
  function turn(by: number): void {
    const at = places[focused];
    if (!at) return note("Select a piece first");
    let theta = at[2] + by;
    room.floor.forEach(([x, y], i) => {
      const to = room.floor[(i + 1) % room.floor.length]!;
      const off = (theta - Math.atan2(to[1] - y, to[0] - x)) / (Math.PI / 2);
      if (Math.abs(off - Math.round(off)) * (Math.PI / 2) < SNAP_RAD) theta -= (off - Math.round(off)) * (Math.PI / 2);
    });
    move(focused, [at[0], at[1], theta, at[3]]);
  }

  function away(): void {
    if (!places[focused]) return note("Select a piece first");
    void keep(put(places, focused, null), places, true);
  }

  function putBack(one: Piece): void {
    if (places[one.id]) {
      focused = one.id;
      away();
    } else void keep({ ...places, [one.id]: placesOf([one])[one.id]! }, places, true);
  }

  /** Save; where a rule is broken the pieces go back to where they were saved last, and the reason is said.
   * Judged in its turn: an answer that comes late must not bring an older state back over a newer one. */
  async function keep(changed: Places, before: Places, step = false): Promise<void> {
    places = changed;
    const mine = ++kept;
    try {
      await turns.save(async () => {
        const now = await api.judge(session.name, changed);
        if (mine === kept) broken = now;
        say();
        if (now.length) throw new Error(now[0]);
        if (step) undo.step(before);
        found = await api.write(session.name, "arrangement", found.digest, JSON.stringify(changed), read);
      });
      verdict.dataset.saved = found.digest;
      note("Saved");
    } catch (error) {
      note(`Rejected: ${(error as Error).message}`, true);
      if (mine === kept) {
        places = placesOf(found.value);
        broken = [];
      }
    }
    draw();
    void light(places);
    if (focused) marks().find((mark) => mark.dataset.id === focused)?.focus();
  }

  const refresh = (): Promise<void> => turns.take(async () => {
    const now = await api.read(session.name, "arrangement", read);
    if (now.digest === found.digest) return;
    turns.foreign += 1;
    found = now;
    const gone = pieces.filter((one) => !now.value.some((other) => other.id === one.id));
    pieces = [...now.value, ...gone];
    places = placesOf(now.value);
    draw();
    void light(places);
  });

  async function forget(): Promise<void> {
    if (!found.corrected) return;
    undo.step(places);
    await api.forget(session.name, "arrangement");
    await refresh();
  }

  draw();
  void judge(places);
  void light(places);
  return {
    element: h("section", { class: "side-by-side even" }, h("div", {}, bar, plan.element, verdict), h("div", {}, stage, said, h("h2", {}, "Pieces"), list)),
    refresh,
    undo: back,
    redo: again,
    close: () => view.dispose(),
    command: `daylit process ${session.path}`,
    run: { until: "report", text: "Render with these places" },
  };
}
