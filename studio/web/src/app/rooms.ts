// Geometry of a room (docs/reference/coordinates.md): metres, camera at (0, 0), x right, y ahead, z up.
import type { Opening, Point, Room } from "./api";

export type Ray = [number, number, number];

const SNAP_M = 0.08;

export const next = (room: Room, corner: number): number => (corner + 1) % room.floor.length;
export const before = (room: Room, corner: number): number => (corner + room.floor.length - 1) % room.floor.length;

export function wall(room: Room, index: number): { from: Point; to: Point; length: number; along: Point } {
  const [from, to] = [room.floor[index]!, room.floor[next(room, index)]!];
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1e-9;
  return { from, to, length, along: [(to[0] - from[0]) / length, (to[1] - from[1]) / length] };
}

export function onWall(room: Room, index: number, distance: number): Point {
  const { from, along } = wall(room, index);
  return [from[0] + along[0] * distance, from[1] + along[1] * distance];
}

/** A point of the floor or the ceiling as seen from the camera. */
export const ray = (room: Room, [x, y]: Point, height: number): Ray => [x, y, height - room.camera_height_m];

/** Where a direction (degrees) meets a level plane `height` above the camera; null where it never does. */
export function onLevel(longitude: number, latitude: number, height: number): Point | null {
  const slope = Math.tan((latitude * Math.PI) / 180);
  if (slope * height <= 1e-4) return null;
  const away = Math.min(30, height / slope);
  return [away * Math.sin((longitude * Math.PI) / 180), away * Math.cos((longitude * Math.PI) / 180)];
}

/** Where a direction meets a wall: distance along it, and height above the floor; null behind the camera. */
export function onWallAt(room: Room, index: number, longitude: number, latitude: number): Point | null {
  const { from, along } = wall(room, index);
  const [x, y] = [Math.sin((longitude * Math.PI) / 180), Math.cos((longitude * Math.PI) / 180)];
  const turn = x * along[1] - y * along[0];
  if (Math.abs(turn) < 1e-6) return null;
  const away = (from[0] * along[1] - from[1] * along[0]) / turn;
  if (away <= 0) return null;
  const distance = (away * x - from[0]) * along[0] + (away * y - from[1]) * along[1];
  return [distance, room.camera_height_m + away * Math.tan((latitude * Math.PI) / 180)];
}

/** The direction that most of the walls follow, radians modulo a quarter turn. */
function mainDirection(room: Room): number {
  let [s, c] = [0, 0];
  room.floor.forEach((_, i) => {
    const { along, length } = wall(room, i);
    const angle = 4 * Math.atan2(along[1], along[0]);
    s += length * Math.sin(angle);
    c += length * Math.cos(angle);
  });
  return Math.atan2(s, c) / 4;
}

/** The room with a corner elsewhere, square to its neighbours where it nearly is, unless `free`. */
export function withCorner(room: Room, corner: number, [x, y]: Point, free = false): Room {
  const turn = mainDirection({ ...room, floor: room.floor.filter((_, i) => i !== corner) });
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  let [u, v] = [c * x + s * y, c * y - s * x];
  for (const other of [room.floor[before(room, corner)]!, room.floor[next(room, corner)]!]) {
    if (free) break;
    const [ou, ov] = [c * other[0] + s * other[1], c * other[1] - s * other[0]];
    if (Math.abs(u - ou) < SNAP_M) u = ou;
    else if (Math.abs(v - ov) < SNAP_M) v = ov;
  }
  const place: Point = [round(c * u - s * v), round(s * u + c * v)];
  return tidy({ ...room, floor: room.floor.map((old, i) => (i === corner ? place : old)) });
}

/** The room with a wall moved along its normal by metres (outwards positive). */
export function withWall(room: Room, index: number, by: number): Room {
  const { along } = wall(room, index);
  const move = ([x, y]: Point): Point => [round(x + along[1] * by), round(y - along[0] * by)];
  const ends = [index, next(room, index)];
  return tidy({ ...room, floor: room.floor.map((old, i) => (ends.includes(i) ? move(old) : old)) });
}

/** The room with a corner more, in the middle of a wall; what is in that wall goes to the half where its middle is. */
export function withMore(room: Room, index: number): Room {
  const half = wall(room, index).length / 2;
  const floor = [...room.floor.slice(0, index + 1), onWall(room, index, half).map(round) as Point, ...room.floor.slice(index + 1)];
  const openings = room.openings.map((o) => {
    const later = o.wall > index || (o.wall === index && (o.start_m + o.end_m) / 2 > half);
    const shift = o.wall === index && later ? half : 0;
    return { ...o, wall: o.wall + (later ? 1 : 0), start_m: o.start_m - shift, end_m: o.end_m - shift };
  });
  return tidy({ ...room, floor, openings, ...renumbered(room, (_, one) => one + Number(one > index)) });
}

/** The room without a corner; what was in its second wall is left out. */
export function withoutCorner(room: Room, corner: number): Room {
  if (room.floor.length <= 3) return room;
  const openings = room.openings.filter((o) => o.wall !== corner).map((o) => ({ ...o, wall: o.wall > corner ? o.wall - 1 : o.wall }));
  return tidy({ ...room, floor: room.floor.filter((_, i) => i !== corner), openings, ...renumbered(room, (_, one) => (one === corner ? -1 : one - Number(one > corner))) });
}

export function withOpening(room: Room, index: number, changed: Partial<Opening>): Room {
  return tidy({ ...room, openings: room.openings.map((o, i) => (i === index ? { ...o, ...changed, confidence: 1 } : o)) });
}

/** The room with more of it held, where it says what is. */
export const holding = (room: Room, ...names: string[]): Room => (room.held?.length ? { ...room, held: [...new Set([...room.held, ...names])] } : room);

/** What is held, of walls and corners with other numbers; -1: gone. */
const renumbered = ({ held }: Room, to: (part: string, index: number) => number): { held?: string[] } => held ? {
  held: held.flatMap((name) => {
    const [part, index] = name.split(" ") as [string, string?];
    if (index === undefined) return [name];
    const now = to(part, Number(index));
    return now < 0 ? [] : [`${part} ${now}`];
  }),
} : {};

export const round = (metres: number): number => Math.round(metres * 1000) / 1000;

/** Openings within their walls and under the ceiling; edges that nearly meet another's, or the wall's, do meet it. */
function tidy(room: Room): Room {
  const near = (value: number, others: number[]): number => others.find((other) => Math.abs(other - value) < 0.04) ?? value;
  const openings = room.openings.map((o, i) => {
    const { length } = wall(room, o.wall);
    const others = room.openings.filter((_, k) => k !== i);
    const [top, sill] = [near(o.head_m, [...others.map((p) => p.head_m), room.ceiling_height_m]), near(o.sill_m, [0, ...others.map((p) => p.sill_m)])];
    const start = Math.max(0, Math.min(near(o.start_m, [0]), length - 0.1));
    const head = Math.min(room.ceiling_height_m, Math.max(0.2, top));
    return {
      ...o,
      start_m: round(start),
      end_m: Math.floor(Math.min(length, Math.max(start + 0.1, near(o.end_m, [length]))) * 1000) / 1000,
      sill_m: o.kind === "window" ? round(Math.max(0, Math.min(sill, head - 0.1))) : 0,
      head_m: round(head),
    };
  });
  return { ...room, openings };
}

export function area(floor: Point[]): number {
  return floor.reduce((sum, [x, y], i) => {
    const [nx, ny] = floor[(i + 1) % floor.length]!;
    return sum + (x * ny - nx * y) / 2;
  }, 0);
}
