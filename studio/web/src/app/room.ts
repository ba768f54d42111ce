// Room: corners, walls, ceiling, windows and doors by hand, on the panorama and on the plan.
import { PanoramaView } from "../viewer/panorama";
import { api, type Corrected, type Opening, type Overview, type Point, Refused, type Room } from "./api";
import { button, h, note, svg } from "./dom";
import { Edges } from "./edges";
import { ARROWS, draggable, Plan } from "./plan";
import {
  area, holding, onLevel, onWall, onWallAt, type Ray, ray, round, wall, withCorner, withMore, withOpening, withoutCorner, withWall,
} from "./rooms";
import type { Screen } from "./screens";
import { Turns, Undo } from "./undo";

const read = async (answer: Response): Promise<Room> => (await answer.json()) as Room;

export async function roomScreen(session: Overview): Promise<Screen> {
  const draftName = `room ${session.name}`;
  let { value: room, digest, corrected }: Corrected<Room> = await api.read(session.name, "room", read);
  let plan!: Plan;
  let chosen = "";
  const turns = new Turns();
  const undo = new Undo<Room>((state) => void keep(state));
  const stage = h("div", { class: "stage opening", role: "application", "aria-label": "Panorama: drag to look around, drag the handles to correct the room" });
  const lines = svg("svg", { class: "overlay" });
  const plans = h("div", { class: "plans" });
  const facts = h("p", { class: "facts", "data-part": "facts" });
  const bar = h("div", { class: "bar" },
    button("Undo", () => undo.back(room), { "data-part": "undo" }), button("Redo", () => undo.again(room)),
    button("Add window", () => add("window")), button("Add door", () => add("door")), button("Add corner", more),
    button("Re-estimate the rest", () => void anew(), { "data-part": "anew", title: "What you have moved stays; all other walls, windows and doors are estimated around it" }),
    button("As estimated", () => void forget()),
  );
  const view = new PanoramaView(stage, { wheel: true, field: 110 });
  stage.append(lines);
  view.pitch = -12; // floor corners are what is corrected most
  view.changed = overlay;
  const picture = new Image();
  picture.src = api.picture(session.name, "Photograph", 4096, session.stamp);
  let edges: Edges | null = null;
  picture.decode().then(() => {
    view.picture(picture, false);
    stage.classList.remove("opening");
    edges = new Edges(picture);
  }, () => note("The picture cannot be shown", true));

  /** Show a room that is being changed, and remember it in this browser in case that the server goes. */
  function show(changed: Room, drafted = true): void {
    room = changed;
    if (drafted) localStorage.setItem(draftName, JSON.stringify(room));
    overlay();
    drawPlan();
    const sure = corrected ? "corrected by hand" : `estimated, confidence ${room.confidence.toFixed(2)}${room.confidence < 0.3 ? ", doubtful: not emptied or staged unless corrected here or requested" : ""}`;
    facts.textContent = `${area(room.floor).toFixed(2)} m², walls in metres, ${room.ceiling_height_m.toFixed(2)} m high, ${room.openings.length} windows and doors · ${sure}${room.held?.length ? ` · held: ${room.held.map((name) => name.replace(/\d+/, (n) => String(Number(n) + 1))).join(", ")}` : ""}`;
  }

  /** Save; where it cannot stand it stays on the screen, and the server says why. */
  async function keep(changed: Room): Promise<void> {
    show(changed);
    try {
      await turns.save(async () => {
        const kept = await api.write(session.name, "room", digest, JSON.stringify(changed), read);
        ({ digest, corrected } = kept);
        if (room !== changed) return; // it is being changed again
        localStorage.removeItem(draftName);
        show(kept.value, false);
        facts.dataset.saved = digest;
        note("Saved");
      });
    } catch (error) {
      note(`Not saved: ${(error as Error).message}`, true);
      if (error instanceof Refused && error.status === 409) await refresh();
    }
  }

  const refresh = (): Promise<void> => turns.take(async () => {
    const found = await api.read(session.name, "room", read);
    if (found.digest === digest) return;
    turns.foreign += 1;
    ({ value: room, digest, corrected } = found);
    show(room, false);
  });

  async function forget(): Promise<void> {
    if (!corrected) return;
    undo.step(room);
    await api.forget(session.name, "room");
    await refresh();
    note("Back to the estimate");
  }

  /** Estimate what has not been placed by hand around what has. */
  async function anew(): Promise<void> {
    if (!corrected) return note("Move what is wrong first: it will stay, and the rest is estimated around it");
    const asked = room;
    const control = bar.querySelector<HTMLButtonElement>("[data-part=anew]")!;
    control.disabled = true;
    try {
      const found = (await (await api.live(session.name, "room", { room: asked })).json()) as Room;
      if (room === asked) change({ ...found, source: "given", confidence: 1 });
    } catch (error) {
      note((error as Error).message, true);
    }
    control.disabled = false;
  }

  function change(changed: Room): void {
    undo.step(room);
    void keep(changed);
  }

  /** Begin a drag: what the room was, and what ends it. */
  function dragging(step: (event: PointerEvent, start: Room) => Room | null): () => { move: (event: PointerEvent) => void; end: () => void } {
    return () => {
      const start = room;
      view.held = true;
      return {
        move: (event) => {
          const found = step(event, start);
          if (found) show(found);
        },
        end: () => {
          view.held = false;
          if (room === start) return;
          undo.step(start);
          void keep(room);
        },
      };
    };
  }

  function facing(): number {
    const turn = (view.yaw * Math.PI) / 180;
    let [best, nearest] = [0, Infinity];
    room.floor.forEach((_, i) => {
      const { from, along, length } = wall(room, i);
      const across = Math.sin(turn) * along[1] - Math.cos(turn) * along[0];
      const away = (from[0] * along[1] - from[1] * along[0]) / across;
      const place = (away * Math.sin(turn) - from[0]) * along[0] + (away * Math.cos(turn) - from[1]) * along[1];
      if (away > 0 && away < nearest && place >= -0.01 && place <= length + 0.01) [best, nearest] = [i, away];
    });
    return best;
  }

  function add(kind: Opening["kind"]): void {
    const index = facing();
    const middle = onWallAt(room, index, view.yaw, 0)?.[0] ?? wall(room, index).length / 2;
    const half = kind === "door" ? 0.45 : 0.6;
    const size = kind === "door" ? { sill_m: 0, head_m: 2.05 } : { sill_m: 0.9, head_m: Math.min(2.1, room.ceiling_height_m) };
    const made: Opening = { kind, wall: index, start_m: Math.max(0, middle - half), end_m: middle + half, ...size, confidence: 1 };
    change(withOpening({ ...room, openings: [...room.openings, made] }, room.openings.length, {}));
  }

  function more(): void {
    change(withMore(room, facing()));
  }

  function remove(name: string): void {
    const [kind, index] = name.split(" ") as [string, string];
    if (kind === "corner") change(withoutCorner(room, Number(index)));
    else change({ ...room, openings: room.openings.filter((_, i) => i !== Number(index)) });
  }

  function keys(element: Element, name: string, move: (by: Point) => Room): void {
    element.addEventListener("focus", () => (chosen = name));
    element.addEventListener("keydown", (event) => {
      const { key, shiftKey } = event as KeyboardEvent;
      const arrow = ARROWS[key];
      if (arrow) change(move([arrow[0] * (shiftKey ? 0.1 : 0.01), arrow[1] * (shiftKey ? 0.1 : 0.01)]));
      else if (key === "Delete" || key === "Backspace") remove(name);
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  function overlay(): void {
    lines.replaceChildren();
    const top = room.ceiling_height_m;
    room.floor.forEach((corner, i) => {
      const to = room.floor[(i + 1) % room.floor.length]!;
      stroke([ray(room, corner, 0), ray(room, to, 0)], "edge");
      stroke([ray(room, corner, top), ray(room, to, top)], "edge");
      stroke([ray(room, corner, 0), ray(room, corner, top)], "edge");
    });
    room.openings.forEach((o, i) => {
      const corners = ([[o.start_m, o.sill_m], [o.end_m, o.sill_m], [o.end_m, o.head_m], [o.start_m, o.head_m]] as Point[])
        .map(([along, height]) => ray(room, onWall(room, o.wall, along), height));
      corners.forEach((one, k) => stroke([one, corners[(k + 1) % 4]!], `opening ${o.kind}`));
      const edit = (k: number) => dragging((event, start) => {
        const place = onWallAt(start, o.wall, ...view.directionAt(event));
        if (!place) return null;
        const moved = { ...(k === 0 || k === 3 ? { start_m: place[0] } : { end_m: place[0] }), ...(k < 2 ? { sill_m: place[1] } : { head_m: place[1] }) };
        return withOpening(start, i, event.shiftKey || !edges ? moved : { ...moved, ...edges.snapped(start, { ...o, ...moved }, k) });
      });
      corners.forEach((one, k) => handle(one, `${o.kind} ${i + 1}, corner ${k + 1}`, "opening", edit(k)));
    });
    room.floor.forEach((corner, i) => {
      handle(ray(room, corner, 0), `Corner ${i + 1} at the floor`, "floor", dragging((event, start) => {
        const place = onLevel(...view.directionAt(event), -start.camera_height_m);
        return place && holding(withCorner(start, i, place, event.shiftKey), `corner ${i}`);
      }));
      handle(ray(room, corner, top), `Corner ${i + 1} at the ceiling: height`, "ceiling", dragging((event, start) => {
        const slope = Math.tan((view.directionAt(event)[1] * Math.PI) / 180);
        const height = round(start.camera_height_m + Math.hypot(...corner) * slope);
        return height > start.camera_height_m + 0.05 ? holding(withOpening({ ...start, ceiling_height_m: height }, -1, {}), "ceiling") : null;
      }));
    });
  }

  function stroke([a, b]: [Ray, Ray], kind: string): void {
    const parts = 24;
    let last: Point | null = null;
    let path = "";
    for (let k = 0; k <= parts; k += 1) {
      const t = k / parts;
      const place = view.placeOf([a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t]);
      if (place) path += `${last ? "L" : "M"}${place[0].toFixed(1)} ${place[1].toFixed(1)}`;
      last = place;
    }
    if (path) lines.append(svg("path", { d: path, class: kind }));
  }

  function handle(where: Ray, label: string, kind: string, begin: Parameters<typeof draggable>[1]): void {
    const place = view.placeOf(where);
    if (!place || place[0] < -20 || place[1] < -20 || place[0] > stage.clientWidth + 20 || place[1] > stage.clientHeight + 20) return;
    const mark = svg("g", { class: `handle ${kind}`, "data-name": label, transform: `translate(${place[0]} ${place[1]})` },
      svg("circle", { r: 14, class: "reach" }), svg("circle", { r: 6 }), svg("title", {}, label));
    draggable(mark, begin);
    lines.append(mark);
  }

  function drawPlan(): void {
    const next = new Plan(room.floor, "Plan: corners, walls, windows and doors");
    // While something is dragged the frame stays, or the plan would flee from the pointer.
    if (view.held && plan) next.element.setAttribute("viewBox", plan.element.getAttribute("viewBox")!);
    plan = next;
    const { element, scale } = plan;
    element.append(svg("polygon", { class: "floor", points: room.floor.map(([x, y]) => `${x},${-y}`).join(" ") }));
    room.floor.forEach((_, i) => {
      const { from, to, length } = wall(room, i);
      const edge = svg("line", { class: room.held?.includes(`wall ${i}`) ? "wall held" : "wall", x1: from[0], y1: -from[1], x2: to[0], y2: -to[1], tabindex: 0, role: "button", "aria-label": `Wall ${i + 1}, ${length.toFixed(2)} m` });
      draggable(edge, (down) => {
        const begin = plan.at(down);
        return dragging((event, start) => {
          const here = plan.at(event);
          const { along } = wall(start, i);
          return holding(withWall(start, i, (here[0] - begin[0]) * along[1] - (here[1] - begin[1]) * along[0]), `wall ${i}`);
        })();
      });
      keys(edge, `wall ${i}`, ([x, y]) => holding(withWall(room, i, x * wall(room, i).along[1] - y * wall(room, i).along[0]), `wall ${i}`));
      const [[mx, my], { along }] = [onWall(room, i, length / 2), wall(room, i)];
      const [tx, ty] = [mx + along[1] * 5 * scale, my - along[0] * 3.5 * scale]; // outside
      element.append(edge, svg("text", { x: tx, y: -ty, "font-size": 3 * scale }, length.toFixed(2)));
    });
    room.openings.forEach((o, i) => {
      const [from, to] = [onWall(room, o.wall, o.start_m), onWall(room, o.wall, o.end_m)];
      const mark = svg("line", { class: `opening ${o.kind}`, x1: from[0], y1: -from[1], x2: to[0], y2: -to[1], tabindex: 0, role: "button", "aria-label": `${o.kind} ${i + 1}, ${(o.end_m - o.start_m).toFixed(2)} m wide` });
      draggable(mark, (down) => {
        const begin = plan.at(down);
        return dragging((event, start) => {
          const here = plan.at(event);
          const { along } = wall(start, o.wall);
          const by = (here[0] - begin[0]) * along[0] + (here[1] - begin[1]) * along[1];
          return withOpening(start, i, { start_m: o.start_m + by, end_m: o.end_m + by });
        })();
      });
      keys(mark, `opening ${i}`, ([x, y]) => withOpening(room, i, { start_m: o.start_m + x + y, end_m: o.end_m + x + y }));
      element.append(mark);
    });
    element.append(svg("circle", { class: "camera", r: 1.3 * scale, cx: 0, cy: 0 }));
    room.floor.forEach(([x, y], i) => {
      const mark = svg("circle", { class: room.held?.includes(`corner ${i}`) ? "corner held" : "corner", cx: x, cy: -y, r: 2 * scale, tabindex: 0, role: "button", "aria-label": `Corner ${i + 1}`, "data-corner": i });
      draggable(mark, dragging((event, start) => holding(withCorner(start, i, plan.at(event), event.shiftKey), `corner ${i}`)));
      keys(mark, `corner ${i}`, ([dx, dy]) => holding(withCorner(room, i, [x + dx, y + dy], true), `corner ${i}`));
      element.append(mark);
    });
    const focused = chosen;
    plans.replaceChildren(element);
    if (view.held || !focused) return;
    const [kind, index] = focused.split(" ");
    element.querySelectorAll<SVGElement>(kind === "wall" ? ".wall" : kind === "corner" ? ".corner" : ".opening")[Number(index)]?.focus();
  }

  const draft = localStorage.getItem(draftName);
  if (draft) {
    const left = JSON.parse(draft) as Room;
    undo.step(room);
    note("Your unsaved changes have been restored");
    await keep(left);
  } else show(room, false);
  const element = h("section", { class: "side-by-side" }, h("div", {}, bar, stage, facts), plans);
  element.addEventListener("focusin", (event) => {
    if (!(event.target as Element).closest(".plan")) chosen = "";
  });
  return {
    element,
    refresh,
    undo: () => undo.back(room),
    redo: () => undo.again(room),
    command: `daylit room ${session.path} --edit; daylit room ${session.path} --around`,
    close: () => view.dispose(),
    run: { until: "remove", text: "Empty the room with this shape" },
  };
}
