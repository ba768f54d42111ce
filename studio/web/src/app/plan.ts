// A plan to drag things on: SVG in metres, ahead of the camera up, everything with a name and a keyboard.
import type { Point, Room } from "./api";
import { svg } from "./dom";
import { onWall } from "./rooms";

export class Plan {
  readonly element: SVGSVGElement;
  readonly scale: number;

  constructor(floor: Point[], label: string) {
    const [xs, ys] = [floor.map((p) => p[0]), floor.map((p) => p[1])];
    const [left, right, low, high] = [Math.min(0, ...xs), Math.max(0, ...xs), Math.min(0, ...ys), Math.max(0, ...ys)];
    const margin = 0.12 * Math.max(right - left, high - low);
    const [wide, tall] = [right - left + 2 * margin, high - low + 2 * margin];
    /** Metres that a hundredth of the plan's larger side is: strokes and handles are sized by it. */
    this.scale = Math.max(wide, tall) / 100;
    this.element = svg("svg", { class: "plan", viewBox: `${left - margin} ${-high - margin} ${wide} ${tall}`, role: "group", "aria-label": label });
  }

  /** Draw the floor, and walls and openings that stay. */
  showing(room: Room): this {
    const line = (kind: string, from: Point, to: Point): void => this.element.append(svg("line", { class: kind, x1: from[0], y1: -from[1], x2: to[0], y2: -to[1] }));
    this.element.append(svg("polygon", { class: "floor", points: room.floor.map(([x, y]) => `${x},${-y}`).join(" ") }));
    room.floor.forEach((from, i) => line("wall still", from, room.floor[(i + 1) % room.floor.length]!));
    for (const o of room.openings) line(`opening still ${o.kind}`, onWall(room, o.wall, o.start_m), onWall(room, o.wall, o.end_m));
    return this;
  }

  /** Metres of the room at a place of the page. */
  at(event: { clientX: number; clientY: number }): Point {
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.element.getScreenCTM()!.inverse());
    return [place.x, -place.y];
  }
}

/** Drag by pointer; `end` is called once, however it ends. */
export function draggable(element: Element, begin: (event: PointerEvent) => { move: (event: PointerEvent) => void; end: () => void }): void {
  element.addEventListener("pointerdown", (down) => {
    const event = down as PointerEvent;
    if (event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    (element as SVGElement).focus();
    const { move, end } = begin(event);
    const moved = (e: PointerEvent): void => move(e);
    const done = (): void => {
      for (const [name, handler] of Object.entries({ pointermove: moved, pointerup: done, pointercancel: done }))
        window.removeEventListener(name, handler as EventListener);
      end();
    };
    window.addEventListener("pointermove", moved);
    window.addEventListener("pointerup", done);
    window.addEventListener("pointercancel", done);
  });
}

export const ARROWS: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
